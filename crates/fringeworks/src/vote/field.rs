//! The phases of all pixels, and which of them continue the finest phase of another one.

use super::{PER_RAD2, PER_TURN};
use crate::decode::DecodeSettings;
use crate::{Image, Reason};
use rayon::prelude::*;

/// Largest number of sets along an axis, that of the decoder.
pub const MAX_SETS: usize = 16;

/// Largest number of sets beside the finest.
pub const MAX_OTHERS: usize = MAX_SETS - 1;

/// Standard deviations by which the finest phase of a neighbour may miss the one that the slope
/// predicts: noise exceeds them once in 16,000 neighbours.
const SMOOTH_SIGMAS: f32 = 4.0;

/// Relative change of the slope over a pixel that a smooth surface may have.
const SMOOTH_CHANGE: f32 = 0.25;

/// Largest miss, turns: twice of it is the distance of two orders.
const LARGEST_MISS: f32 = 0.25;

/// Largest whole number of turns between a pixel and one of its window.
const MOST_TURNS: f32 = 16.0;

/// Share of the modulation of a neighbour below which a pixel beside a shadow only shows light that the
/// lens spreads from there, squared: a blurred edge of light falls to half at the edge.
const OWN_LIGHT: f32 = 0.25;

/// The phases of all pixels.
pub struct Field<'a> {
    pub sets: usize,
    pub finest: usize,
    /// Frequency of every set, turns per px.
    pub frequency: [f32; MAX_SETS],
    /// The sets other than the finest, and their frequencies over its own.
    pub other_sets: [usize; MAX_OTHERS],
    pub other_ratio: [f32; MAX_OTHERS],
    /// Variance that windows do not average out, rad².
    pub floor: [f32; MAX_SETS],
    pub settings: &'a DecodeSettings,
    /// Usual squared scatter in a window over that of noise, at least 1.
    pub usual_scatter: f32,
    /// Floor of σ, rad²: that of the settings.
    pub sigma_floor: [f32; MAX_SETS],
    pub phases: &'a [Image<'a, f32>],
    pub variances: &'a [Image<'a, f32>],
    lit: Vec<bool>,
    height: usize,
    width: usize,
}

/// Whole turns by which the finest phase of a pixel differs from the one that another pixel predicts
/// (`off`, turns), and whether it continues that one. `variance`: of the difference, turns²; `bent`: by
/// how much the surface may bend, turns.
#[inline(always)]
pub fn continues(off: f32, variance: f32, bent: f32) -> (f32, bool) {
    let allowed = SMOOTH_SIGMAS * variance.sqrt() + bent;
    let most = if allowed < LARGEST_MISS {
        allowed
    } else {
        LARGEST_MISS
    };
    let whole = off.round_ties_even();
    // False for a pixel that is not lit.
    (
        whole,
        ((off - whole).abs() <= most) & (whole.abs() <= MOST_TURNS),
    )
}

/// By how much a surface may bend over a step to the right and down, turns.
#[inline(always)]
pub fn bend(slope: [f32; 2], across: f32, along: f32) -> f32 {
    SMOOTH_CHANGE * (slope[0].abs() * across.abs() + slope[1].abs() * along.abs())
}

/// Pixels that show fringes and have finite phases.
fn lit(phases: &[Image<f32>], variances: &[Image<f32>], reason: &[u8]) -> Vec<bool> {
    let shows = [Reason::Ok, Reason::OrderAmbiguous, Reason::Isolated].map(u8::from);
    let width = phases[0].width().max(1);
    let mut lit = vec![false; reason.len()];
    let rows = lit.par_chunks_mut(width).zip(reason.par_chunks(width));
    rows.enumerate().for_each(|(y, (lit, reason))| {
        for (lit, reason) in lit.iter_mut().zip(reason) {
            *lit = shows.contains(reason);
        }
        for map in phases.iter().chain(variances) {
            for (lit, value) in lit.iter_mut().zip(map.row(y)) {
                *lit &= value.is_finite();
            }
        }
    });
    lit
}

impl<'a> Field<'a> {
    /// For checked maps.
    pub fn new(
        settings: &'a DecodeSettings,
        phases: &'a [Image<'a, f32>],
        variances: &'a [Image<'a, f32>],
        reason: &[u8],
    ) -> Self {
        let (height, width) = phases[0].shape();
        let sets = settings.sets.len();
        let of_sets = |value: &dyn Fn(usize) -> f32| {
            std::array::from_fn(|k| if k < sets { value(k) } else { 0.0 })
        };
        let finest = settings.finest();
        let frequency: [f32; MAX_SETS] = of_sets(&|k| settings.sets[k].frequency);
        let floor = of_sets(&|k| settings.sets[k].floor);
        let (mut other_sets, mut other_ratio) = ([0; MAX_OTHERS], [0.0; MAX_OTHERS]);
        for (j, k) in (0..sets).filter(|&k| k != finest).enumerate() {
            (other_sets[j], other_ratio[j]) = (k, frequency[k] / frequency[finest]);
        }
        Self {
            sets,
            finest,
            frequency,
            other_sets,
            other_ratio,
            floor,
            settings,
            usual_scatter: 1.0,
            sigma_floor: floor,
            phases,
            variances,
            lit: lit(phases, variances, reason),
            height,
            width,
        }
    }

    /// Add a variance to the floors of all sets but the finest.
    pub fn add_floor(&mut self, variance: f32) {
        for k in (0..self.sets).filter(|&k| k != self.finest) {
            self.floor[k] += variance;
        }
    }

    pub fn len(&self) -> usize {
        self.lit.len()
    }

    pub fn height(&self) -> usize {
        self.height
    }

    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of sets beside the finest.
    pub fn others(&self) -> usize {
        self.sets - 1
    }

    pub fn is_lit(&self, i: usize) -> bool {
        self.lit[i]
    }

    /// Which pixels of a row are lit, and the phases and variances of a set there.
    pub fn row(&self, set: usize, y: usize) -> (&[bool], &[f32], &[f32]) {
        let lit = &self.lit[y * self.width..][..self.width];
        (lit, self.phases[set].row(y), self.variances[set].row(y))
    }

    /// Turns per px.
    pub fn finest_frequency(&self) -> f32 {
        self.frequency[self.finest]
    }

    /// Wrapped finest phase, turns.
    #[inline(always)]
    pub fn finest_turns(&self, i: usize) -> f32 {
        self.phases[self.finest][i] * PER_TURN
    }

    /// Variance of the finest phase by noise, turns².
    #[inline(always)]
    fn finest_variance(&self, i: usize) -> f32 {
        self.variances[self.finest][i] * PER_RAD2
    }

    /// Whole turns from the finest phase of a pixel to that of another one, if it continues it along the
    /// slope at the first.
    #[inline(always)]
    fn turns_to(
        &self,
        from: usize,
        slope: [f32; 2],
        to: usize,
        (down, right): (isize, isize),
    ) -> Option<i32> {
        if !self.lit[to] {
            return None;
        }
        let (across, along) = (right as f32, down as f32);
        let variance = self.finest_variance(from) + self.finest_variance(to);
        let predicted = slope[0] * across + slope[1] * along;
        let off = self.finest_turns(to) - self.finest_turns(from) - predicted;
        let (whole, near) = continues(off, variance, bend(slope, across, along));
        near.then_some(-whole as i32)
    }

    /// Call a function with every pixel of the window around a lit one that continues its finest phase
    /// along the slope there, and the whole turns to it.
    #[inline(always)]
    pub fn for_window(
        &self,
        (y, x): (usize, usize),
        slope: [f32; 2],
        radius: usize,
        mut call: impl FnMut(usize, i32),
    ) {
        let here = y * self.width + x;
        for v in y.saturating_sub(radius)..self.height.min(y + radius + 1) {
            for u in x.saturating_sub(radius)..self.width.min(x + radius + 1) {
                let there = v * self.width + u;
                let step = (v as isize - y as isize, u as isize - x as isize);
                if let Some(turns) = self.turns_to(here, slope, there, step) {
                    call(there, turns);
                }
            }
        }
    }

    /// Number of lit pixels of the window around a pixel.
    pub fn lit_in_window(&self, y: usize, x: usize, radius: usize) -> usize {
        let columns = x.saturating_sub(radius)..self.width.min(x + radius + 1);
        let rows = y.saturating_sub(radius)..self.height.min(y + radius + 1);
        rows.map(|v| {
            let row = &self.lit[v * self.width..][columns.clone()];
            row.iter().filter(|&&lit| lit).count()
        })
        .sum()
    }

    /// Whether a pixel beside a shadow is so dim against its brightest neighbour that its light is that of
    /// its neighbours.
    pub fn is_borrowed(&self, y: usize, x: usize) -> bool {
        let variances = &self.variances[self.finest];
        let (mut least, mut beside) = (f32::INFINITY, false);
        for v in y.saturating_sub(1)..self.height.min(y + 2) {
            for u in x.saturating_sub(1)..self.width.min(x + 2) {
                let i = v * self.width + u;
                beside |= !self.lit[i];
                least = if self.lit[i] {
                    least.min(variances[i])
                } else {
                    least
                };
            }
        }
        beside && least < OWN_LIGHT * variances[y * self.width + x]
    }

    /// Standard deviation of a coordinate by noise of its finest phase, px.
    pub fn sigma(&self, i: usize) -> f32 {
        self.finest_variance(i).sqrt() / self.finest_frequency()
    }

    /// By how much a coordinate may lie beyond the range, px.
    pub fn slack(&self, i: usize) -> f32 {
        self.settings.limits.confidence * self.sigma(i)
    }
}
