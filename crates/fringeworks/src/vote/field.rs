//! The phases of all pixels, the slope of the finest one, and means of windows.

use super::{PER_RAD2, wrap};
use crate::decode::DecodeSettings;
use crate::{Image, Reason};
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Largest number of sets along an axis, that of the decoder.
const MAX_SETS: usize = 16;

/// Pixels from the middle of the box that the slope is averaged in to its edges.
const SLOPE_REACH: usize = 2;

/// Standard deviations by which the finest phase of a neighbour may miss the one that the slope
/// predicts: noise exceeds them once in 16,000 neighbours.
const SMOOTH_SIGMAS: f32 = 4.0;

/// Relative change of the slope over a pixel that a smooth surface may have.
const SMOOTH_CHANGE: f32 = 0.25;

/// Largest miss, turns: twice of it is the distance of two orders.
const LARGEST_MISS: f32 = 0.25;

/// Largest whole number of turns between a pixel and one of its window.
const MOST_TURNS: i32 = 16;

/// Share of the modulation of a neighbour below which a pixel beside a shadow only shows light that the
/// lens spreads from there, squared: a blurred edge of light falls to half at the edge.
const OWN_LIGHT: f32 = 0.25;

/// Standard deviations by which the squared scatter in a window may exceed that of noise. Two surfaces in
/// it scatter more, even where their mean is the phase of an order between them.
const SCATTER_SIGMAS: f32 = 4.0;

/// Least pixels of a window that can vote: those of the smallest window in a right-angled corner.
const LEAST_PIXELS: f32 = 4.0;

/// Phases less the share that the finest one explains, averaged over a window; or those of one pixel.
pub struct Mean {
    /// Turns; 0 for the finest set.
    pub turns: [f32; MAX_SETS],
    /// By noise, rad².
    pub variance: [f32; MAX_SETS],
    /// Number of pixels.
    pub pixels: f32,
    /// Squared scatter of their phases over that of noise.
    pub scatter: f32,
}

/// Factors for whole turns from −`MOST_TURNS` on.
type Turns = [[f32; 2]; 2 * MOST_TURNS as usize + 1];

/// The phases of all pixels.
pub struct Field<'a> {
    pub sets: usize,
    pub finest: usize,
    /// Frequency of every set, turns per px, and over that of the finest.
    pub frequency: [f32; MAX_SETS],
    pub ratio: [f32; MAX_SETS],
    /// Variance that windows do not average out, rad².
    pub floor: [f32; MAX_SETS],
    pub settings: &'a DecodeSettings,
    /// Usual squared scatter in a window over that of noise, at least 1.
    pub usual_scatter: f32,
    /// Floor of σ, rad²: that of the settings.
    pub sigma_floor: [f32; MAX_SETS],
    phases: &'a [Image<'a, f32>],
    variances: &'a [Image<'a, f32>],
    lit: Vec<bool>,
    /// Change of the finest phase from pixel to pixel, to the right and down, turns.
    slope: Vec<[f32; 2]>,
    /// exp(i φ) of every set without the share that the finest phase explains, set after set.
    rest: Vec<Vec<[f32; 2]>>,
    /// By what whole turns of the finest phase turn each set.
    turn: Vec<Turns>,
    height: usize,
    width: usize,
}

#[inline(always)]
fn times([a, b]: [f32; 2], [c, d]: [f32; 2]) -> [f32; 2] {
    [a * c - b * d, a * d + b * c]
}

#[inline(always)]
fn phasor(turns: f32) -> [f32; 2] {
    let (sin, cos) = (TAU * turns).sin_cos();
    [cos, sin]
}

/// Pixels that show fringes and have finite phases.
fn lit(phases: &[Image<f32>], variances: &[Image<f32>], reason: &[u8]) -> Vec<bool> {
    let shows = [Reason::Ok, Reason::OrderAmbiguous, Reason::Isolated].map(u8::from);
    let known = |i: usize| phases.iter().chain(variances).all(|map| map[i].is_finite());
    let pixels = reason.par_iter().enumerate();
    pixels
        .map(|(i, reason)| shows.contains(reason) && known(i))
        .collect()
}

/// exp(i φ) of a phase without the share that the finest phase explains.
fn rest(own: &[f32], finest: &[f32], share: f32) -> Vec<[f32; 2]> {
    let pairs = own.par_iter().zip(finest.par_iter());
    pairs
        .map(|(own, fine)| phasor((own - share * fine) / TAU))
        .collect()
}

/// By what whole turns of the finest phase turn a set.
fn whole_turns(share: f32) -> Turns {
    std::array::from_fn(|d| phasor(-share * (d as i32 - MOST_TURNS) as f32))
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
        let ratio = frequency.map(|f| f / frequency[finest]);
        let floor = of_sets(&|k| settings.sets[k].floor);
        let mut field = Self {
            sets,
            finest,
            frequency,
            ratio,
            floor,
            settings,
            usual_scatter: 1.0,
            sigma_floor: floor,
            phases,
            variances,
            lit: lit(phases, variances, reason),
            slope: vec![],
            rest: ratio[..sets]
                .iter()
                .zip(phases)
                .map(|(&share, own)| rest(own, &phases[finest], share))
                .collect(),
            turn: ratio[..sets]
                .iter()
                .map(|&share| whole_turns(share))
                .collect(),
            height,
            width,
        };
        field.slope = field.slopes();
        field
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

    pub fn is_lit(&self, i: usize) -> bool {
        self.lit[i]
    }

    /// Turns per px.
    pub fn finest_frequency(&self) -> f32 {
        self.frequency[self.finest]
    }

    /// Wrapped finest phase, turns.
    #[inline(always)]
    pub fn finest_turns(&self, i: usize) -> f32 {
        self.phases[self.finest][i] * (1.0 / TAU)
    }

    /// Variance of the finest phase by noise, turns².
    #[inline(always)]
    fn finest_variance(&self, i: usize) -> f32 {
        self.variances[self.finest][i] * PER_RAD2
    }

    /// Mean direction of the steps of the finest phase to the right and down, in a box around each pixel.
    fn slopes(&self) -> Vec<[f32; 2]> {
        let fine: Vec<[f32; 2]> = (0..self.len())
            .into_par_iter()
            .map(|i| {
                if self.lit[i] {
                    phasor(self.finest_turns(i))
                } else {
                    [0.0; 2]
                }
            })
            .collect();
        let step = |from: usize, to: usize| times(fine[to], [fine[from][0], -fine[from][1]]);
        let rows = (0..self.height).into_par_iter();
        rows.flat_map_iter(|y| {
            let step = &step;
            (0..self.width).map(move |x| {
                let (mut right, mut down) = ([0.0f32; 2], [0.0f32; 2]);
                for v in self.reach(y, self.height) {
                    for u in self.reach(x, self.width) {
                        let i = v * self.width + u;
                        if u < x + SLOPE_REACH && u + 1 < self.width {
                            let z = step(i, i + 1);
                            right = [right[0] + z[0], right[1] + z[1]];
                        }
                        if v < y + SLOPE_REACH && v + 1 < self.height {
                            let z = step(i, i + self.width);
                            down = [down[0] + z[0], down[1] + z[1]];
                        }
                    }
                }
                [right, down].map(|z| z[1].atan2(z[0]) / TAU)
            })
        })
        .collect()
    }

    fn reach(&self, middle: usize, end: usize) -> std::ops::Range<usize> {
        middle.saturating_sub(SLOPE_REACH)..end.min(middle + SLOPE_REACH + 1)
    }

    /// Whole turns from the finest phase of a pixel to that of another one, if it continues it along the
    /// slope at the first.
    #[inline(always)]
    pub fn turns_to(&self, from: usize, to: usize, (down, right): (isize, isize)) -> Option<i32> {
        if !self.lit[to] {
            return None;
        }
        let (across, along) = (right as f32, down as f32);
        let slope = self.slope[from];
        let bent = SMOOTH_CHANGE * (slope[0].abs() * across.abs() + slope[1].abs() * along.abs());
        let variance = self.finest_variance(from) + self.finest_variance(to);
        let most = (SMOOTH_SIGMAS * variance.sqrt() + bent).min(LARGEST_MISS);
        let predicted = slope[0] * across + slope[1] * along;
        let off = self.finest_turns(to) - self.finest_turns(from) - predicted;
        let whole = off.round_ties_even();
        let near = (off - whole).abs() <= most && whole.abs() <= MOST_TURNS as f32;
        near.then_some(-whole as i32)
    }

    /// Call a function with every pixel of the window around a lit one that continues its finest phase,
    /// and the whole turns to it.
    #[inline(always)]
    pub fn for_window(&self, y: usize, x: usize, radius: usize, mut call: impl FnMut(usize, i32)) {
        let here = y * self.width + x;
        for v in y.saturating_sub(radius)..self.height.min(y + radius + 1) {
            for u in x.saturating_sub(radius)..self.width.min(x + radius + 1) {
                let there = v * self.width + u;
                let step = (v as isize - y as isize, u as isize - x as isize);
                if let Some(turns) = self.turns_to(here, there, step) {
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

    /// Mean of the window around a pixel; none for a pixel that is not lit.
    pub fn mean(&self, y: usize, x: usize, radius: usize) -> Option<Mean> {
        if !self.lit[y * self.width + x] {
            return None;
        }
        let mut sum = [[0.0f32; 2]; MAX_SETS];
        let (mut weight, mut pixels, mut expected) = ([0.0f32; MAX_SETS], 0.0, 0.0);
        self.for_window(y, x, radius, |i, turns| {
            let place = (turns + MOST_TURNS) as usize;
            pixels += 1.0;
            for k in 0..self.sets {
                let w = 1.0 / self.variances[k][i];
                let z = times(self.rest[k][i], self.turn[k][place]);
                sum[k] = [sum[k][0] + w * z[0], sum[k][1] + w * z[1]];
                weight[k] += w;
                if k != self.finest {
                    expected += w * self.expected_square(k, i);
                }
            }
        });
        let length = |k: usize| (sum[k][0] * sum[k][0] + sum[k][1] * sum[k][1]).sqrt();
        let others = (0..self.sets).filter(|&k| k != self.finest);
        let square: f32 = others.map(|k| 2.0 * (weight[k] - length(k))).sum();
        // The mean takes a degree of freedom.
        let free = expected * (pixels - 1.0) / pixels;
        Some(Mean {
            turns: sum.map(|z| z[1].atan2(z[0]) / TAU),
            variance: weight.map(|w| 1.0 / w),
            pixels,
            scatter: if pixels > 1.0 { square / free } else { 0.0 },
        })
    }

    /// Expected |z − 1|² of a set's phasor with the noise of a pixel, without the share of the finest phase.
    #[inline(always)]
    fn expected_square(&self, k: usize, i: usize) -> f32 {
        let ratio = self.ratio[k];
        let variance = self.variances[k][i] + ratio * ratio * self.variances[self.finest][i];
        // 2 (1 − exp(−v/2)) within 2 % up to v = 1.
        variance * (1.0 - variance * (0.25 - variance / 28.0))
    }

    /// Whether a window has pixels enough, whose phases scatter as those of one surface.
    pub fn is_even(&self, mean: &Mean) -> bool {
        let freedom = (mean.pixels - 1.0).max(1.0) * (self.sets - 1) as f32;
        let most = 1.0 + SCATTER_SIGMAS * (2.0 / freedom).sqrt();
        mean.pixels >= LEAST_PIXELS && mean.scatter <= self.usual_scatter * most
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

    /// The phases of one pixel, in the same form.
    pub fn alone(&self, i: usize) -> Mean {
        let fine = self.finest_turns(i);
        let mut mean = Mean {
            turns: [0.0; MAX_SETS],
            variance: [f32::INFINITY; MAX_SETS],
            pixels: 1.0,
            scatter: 0.0,
        };
        for k in 0..self.sets {
            mean.turns[k] = wrap(self.phases[k][i] / TAU - self.ratio[k] * fine);
            mean.variance[k] = self.variances[k][i];
        }
        mean
    }

    /// Mean variance of the sets but the finest, rad².
    pub fn coarse_variance(&self, mean: &Mean) -> f32 {
        let others = (0..self.sets).filter(|&k| k != self.finest);
        others.map(|k| mean.variance[k]).sum::<f32>() / (self.sets - 1) as f32
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
