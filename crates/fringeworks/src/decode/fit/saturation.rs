//! The fit without samples at the sensor's limit.

use super::angle::angle;
use super::set::PhaseSet;
use super::solver::{precision, solution, solve, Solution};
use super::sums::{Saturated, Sums};
use super::{store, Fitted, NO_PRECISION};
use crate::decode::{Frames, Plan, Sample, LANES};
use std::ops::Range;

/// What the fit of a group found out about saturation.
pub struct Saturation {
    /// Whether any sample of the group is saturated.
    pub any: bool,
    /// Whether some pixel needs [`refit`].
    pub needs_refit: bool,
}

/// Whether leaving one sample out is a short update: equal steps, and enough samples left.
#[inline(always)]
fn can_update(set: &PhaseSet) -> bool {
    set.solver.balanced && set.steps() > 3
}

/// Fit a group without its saturated samples, where each pixel has one at most.
///
/// Equal steps have the leverage 3/N each, so leaving one of N out is a short update: its residual r
/// shifts the amplitudes by r / (N − 3) times (1, 2 cos δ, 2 sin δ).
#[inline(always)]
pub fn fit_unsaturated(
    set: &PhaseSet,
    sums: Sums,
    saturated: &Saturated,
    start: usize,
    out: &mut Fitted,
) -> Saturation {
    let mut fitted = solve(set, &sums);
    let mut precision = precision(set, &fitted);
    let n = set.steps() as f32;
    let updated = can_update(set);
    if updated {
        let (leverage, share) = (1.0 / (n - 3.0), 4.0 / (n * (n - 3.0)));
        for i in 0..LANES {
            let (k, q) = (saturated.cos[i], saturated.sin[i]);
            let (a, c, s) = (fitted.plain[i], fitted.cos[i], fitted.sin[i]);
            // The sums hold a zero in place of the sample, so its residual is minus the model.
            let shift = saturated.count[i] * leverage * (a + c * k + s * q);
            let (a, c, s) = (a + shift, c + 2.0 * k * shift, s + 2.0 * q * shift);
            (fitted.plain[i], fitted.cos[i], fitted.sin[i]) = (a, c, s);
            let power = c * c + s * s;
            let across = c * q - s * k;
            precision[i] = power * power / (2.0 / n * power + share * (across * across));
        }
    }
    store(set, &fitted, &precision, start, out);
    let most = if updated { 1.0 } else { 0.0 };
    let (mut any, mut more) = (0, 0);
    for i in 0..LANES {
        any |= u32::from(saturated.count[i] > 0.0);
        more |= u32::from(saturated.count[i] > most);
    }
    Saturation {
        any: any > 0,
        needs_refit: more > 0,
    }
}

/// Fit pixels with several saturated samples one by one.
#[cold]
pub fn refit<T: Sample>(
    frames: &Frames<'_, T>,
    plan: &Plan,
    index: usize,
    at: Range<usize>,
    out: &mut Fitted,
) {
    let (set, limit) = (&plan.sets[index], plan.limits.saturation);
    let all = set.all_steps();
    for (i, pixel) in at.enumerate() {
        let (kept, sums) = frames.kept(set, pixel, limit);
        let updated = can_update(set) && (all ^ kept).count_ones() <= 1;
        if kept == all || updated {
            continue;
        }
        let planned = |n: usize| [1.0, set.phasor(n).0.into(), set.phasor(n).1.into()];
        let solvable = if kept.count_ones() >= 3 {
            solution(kept, planned, |n| set.design[n])
        } else {
            None
        };
        match solvable {
            Some(solution) => store_pixel(&solution, sums, i, out),
            None => clear_pixel(i, out),
        }
    }
}

fn store_pixel(solution: &Solution, sums: [f32; 3], i: usize, out: &mut Fitted) {
    let m = &solution.inverse;
    let solve = |row: &[f64; 3]| (0..3).map(|j| row[j] * f64::from(sums[j])).sum::<f64>();
    let (a, c, s) = (solve(&m[0]), solve(&m[1]), solve(&m[2]));
    let power = c * c + s * s;
    let m = &solution.covariance;
    let spread = m[2][2] * c * c + m[1][1] * s * s - 2.0 * m[1][2] * c * s;
    out.turns[i] = angle(s as f32, c as f32);
    out.precision[i] = (power * power / spread) as f32;
    out.power[i] = power as f32;
    (out.background[i], out.brightness_or_variance[i]) = (a as f32, a as f32);
}

fn clear_pixel(i: usize, out: &mut Fitted) {
    out.precision[i] = NO_PRECISION;
    (out.turns[i], out.power[i]) = (f32::NAN, f32::NAN);
    (out.background[i], out.brightness_or_variance[i]) = (f32::NAN, f32::NAN);
}
