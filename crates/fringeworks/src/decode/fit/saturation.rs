//! The fit without samples at the sensor's limit.

use super::angle::angle;
use super::harmonics::with_harmonics;
use super::set::PhaseSet;
use super::solver::{Matrix, Solution, amplitudes, solution};
use super::sums::{Saturated, Sums, SumsAt};
use super::{Fitted, NO_PRECISION};
use crate::decode::{BLOCK_PIXELS, Frames, Sample};

/// Choices of samples that are kept in mind: all of four steps, and few enough to look through.
const MOST_SOLUTIONS: usize = 16;

/// Whether leaving one sample out is a short update: equal steps without harmonics, and enough
/// samples left.
#[inline(always)]
fn can_update(set: &PhaseSet) -> bool {
    set.solver.balanced && set.steps() > 3 && set.harmonics.shares.is_empty()
}

/// Correct the fit of a block's pixels that have one saturated sample, whose sums lack it. Returns
/// the pixels that need [`refit`].
///
/// Equal steps have the leverage 3/N each, so leaving one of N out is a short update: its residual r
/// shifts the amplitudes by r / (N − 3) times (1, 2 cos δ, 2 sin δ).
#[inline(always)]
pub fn leave_out(
    set: &PhaseSet,
    saturated: &Saturated,
    sums: &Sums,
    out: &mut Fitted,
) -> Vec<usize> {
    let most = if can_update(set) { 1.0 } else { 0.0 };
    if most > 0.0 {
        update(set, saturated, sums, out);
    }
    let count = |i: &usize| saturated.count[*i] > most;
    (0..BLOCK_PIXELS).filter(count).collect()
}

#[inline(always)]
fn update(set: &PhaseSet, saturated: &Saturated, sums: &Sums, out: &mut Fitted) {
    let (n, m) = (set.steps() as f32, set.solver.inverse);
    let (leverage, share) = (1.0 / (n - 3.0), 4.0 / (n * (n - 3.0)));
    for i in 0..BLOCK_PIXELS {
        let (k, q) = (saturated.cos[i], saturated.sin[i]);
        let (a, c, s) = amplitudes::<true>(&m, sums.at(i));
        // The sums hold a zero in place of the sample, so its residual is minus the model.
        let shift = leverage * (a + c * k + s * q);
        let (a, c, s) = (a + shift, c + 2.0 * k * shift, s + 2.0 * q * shift);
        let power = c * c + s * s;
        let across = c * q - s * k;
        let precision = power * power / (2.0 / n * power + share * (across * across));
        let turns = angle(s, c);
        let changed = saturated.count[i] > 0.0;
        let choose = |new: f32, old: f32| if changed { new } else { old };
        out.turns[i] = choose(turns, out.turns[i]);
        out.precision[i] = choose(precision, out.precision[i]);
        out.power[i] = choose(power, out.power[i]);
        out.background[i] = choose(a, out.background[i]);
        out.brightness[i] = choose(a, out.brightness[i]);
    }
}

/// Clear the pixels of a block with a saturated sample.
pub fn clear(saturated: &Saturated, out: &mut Fitted) {
    for i in (0..BLOCK_PIXELS).filter(|&i| saturated.count[i] > 0.0) {
        clear_pixel(i, out);
    }
}

/// Fit pixels of a block with saturated samples one by one.
///
/// Harmonics that all samples of a set leave over, the others take for a phase: they are fitted with
/// it, so that the phase is what all samples would have shown.
#[cold]
pub fn refit<T: Sample>(
    frames: &Frames<'_, T>,
    set: &PhaseSet,
    (at, limit): (usize, f32),
    pixels: &[usize],
    out: &mut Fitted,
) {
    let mut known = Solutions::default();
    for &i in pixels {
        let (kept, sums) = frames.kept(set, at + i, limit);
        let found = known.of(set, kept).map(|m| (solved(m, sums), m.covariance));
        let found = if found.is_some() && !set.harmonics.shares.is_empty() {
            let value = |n: usize| {
                let sample = frames.planes[set.frames[n]][at + i].value();
                f64::from(if sample >= limit { limit } else { sample })
            };
            with_harmonics(set, kept, value)
        } else {
            found
        };
        match found {
            Some((amplitudes, covariance)) => {
                let own = |j: usize| amplitudes[j] - f64::from(set.offset[j]);
                store_pixel([own(0), own(1), own(2)], &covariance, i, out);
            }
            None => clear_pixel(i, out),
        }
    }
}

/// Solutions of the last few choices of samples: the pixels of a highlight lack the same ones.
#[derive(Default)]
struct Solutions(Vec<(u64, Option<Solution>)>);

impl Solutions {
    /// The solution for the kept frames, one bit each; `None` where they do not determine the phase.
    fn of(&mut self, set: &PhaseSet, kept: u64) -> Option<&Solution> {
        let at = self.0.iter().position(|(frames, _)| *frames == kept);
        let at = at.unwrap_or_else(|| {
            if self.0.len() == MOST_SOLUTIONS {
                self.0.clear();
            }
            let planned = |n: usize| [1.0, set.phasor(n).0.into(), set.phasor(n).1.into()];
            let enough = kept.count_ones() >= 3;
            let found = enough.then(|| solution(kept, planned, |n| set.design[n]));
            self.0.push((kept, found.flatten()));
            self.0.len() - 1
        });
        self.0[at].1.as_ref()
    }
}

/// A, c and s from the sums of the kept frames.
fn solved(solution: &Solution, sums: [f32; 3]) -> [f64; 3] {
    let product = |row: [f64; 3]| (0..3).map(|j| row[j] * f64::from(sums[j])).sum();
    solution.inverse.map(product)
}

fn store_pixel([a, c, s]: [f64; 3], m: &Matrix, i: usize, out: &mut Fitted) {
    let power = c * c + s * s;
    let spread = m[2][2] * c * c + m[1][1] * s * s - 2.0 * m[1][2] * c * s;
    out.turns[i] = angle(s as f32, c as f32);
    out.precision[i] = (power * power / spread) as f32;
    out.power[i] = power as f32;
    (out.background[i], out.brightness[i]) = (a as f32, a as f32);
}

fn clear_pixel(i: usize, out: &mut Fitted) {
    out.precision[i] = NO_PRECISION;
    (out.turns[i], out.power[i]) = (f32::NAN, f32::NAN);
    (out.background[i], out.brightness[i]) = (f32::NAN, f32::NAN);
}
