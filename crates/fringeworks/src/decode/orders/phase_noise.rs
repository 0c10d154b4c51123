//! Variance of every phase, and the pixels whose fringes are too weak.

use super::{part, part_mut, Scratch};
use crate::decode::fit::{Fitted, NO_PRECISION};
use crate::decode::{Lanes, Plan, LANES};
use crate::reason;
use std::f32::consts::TAU;

/// Sets of a pixel whose phase cannot be used.
struct Unusable {
    /// Number of sets whose fringe is too weak.
    weak: [u32; LANES],
    /// Non-zero where saturation leaves some phase undetermined.
    saturated: [u32; LANES],
}

/// Turn the precision of every phase into 1/turns², and its brightness into its variance, in place.
///
/// Returns the reason of each pixel of the group: why its phases cannot be used, or OK.
#[inline(always)]
pub fn phase_noise(plan: &Plan, start: usize, scratch: &mut Scratch) -> [u32; LANES] {
    let mut unusable = Unusable {
        weak: [0; LANES],
        saturated: [0; LANES],
    };
    for (fitted, set) in scratch.sets.iter_mut().zip(&plan.sets) {
        let factor = scratch.inflation.as_ref().map(|line| *part(line, start));
        let usual = plan.limits.usual_inflation;
        if let Some(factor) = factor {
            divide_precision(&factor.map(|f| (f / usual).max(1.0)), start, fitted);
        }
        if plan.noise.gain > 0.0 {
            set_noise::<true>(plan, start, fitted, &mut unusable);
        } else {
            set_noise::<false>(plan, start, fitted, &mut unusable);
        }
        if set.floor > 0.0 {
            add_floor(set.floor, start, fitted);
        }
        if let Some(factor) = factor {
            divide_precision(&factor.map(|f| f.min(usual)), start, fitted);
        }
    }
    let background = part(&scratch.background, start);
    let modulation = part(&scratch.modulation, start);
    reasons(plan, background, modulation, &unusable)
}

/// The same for one set; SHOT says whether there is shot noise.
#[inline(always)]
fn set_noise<const SHOT: bool>(
    plan: &Plan,
    start: usize,
    fitted: &mut Fitted,
    unusable: &mut Unusable,
) {
    let min_precision = plan.limits.min_snr * plan.limits.min_snr;
    let precision = part_mut(&mut fitted.precision, start);
    let brightness_or_variance = part_mut(&mut fitted.brightness_or_variance, start);
    let [second, third] = plan.chain.order_variance;
    let per_read_noise = 1.0 / plan.noise.read_variance;
    for i in 0..LANES {
        let per_noise = if SHOT {
            1.0 / plan.noise.variance(brightness_or_variance[i])
        } else {
            per_read_noise
        };
        let unit = precision[i];
        let q = unit * per_noise;
        let strong = q >= min_precision;
        unusable.weak[i] += u32::from(!strong);
        unusable.saturated[i] |= u32::from(unit == NO_PRECISION);
        // 1/q underestimates the variance by about 1/q²: half because B comes from the same noisy
        // samples, half because the phase of a weak fringe is not Gaussian. Fringe orders are judged by
        // a larger variance, see `Chain::order_variance`.
        let u = 1.0 / q;
        let v = u * (1.0 + u * (second + third * u));
        precision[i] = q * (1.0 - u + u * u) * (TAU * TAU);
        brightness_or_variance[i] = v * (1.0 / (TAU * TAU));
    }
}

/// Divide the precision of a group by a factor on its variances.
///
/// Before the noise is computed, the factor counts for the roundings, too. What is usual in a scene
/// counts for the coordinate only: the caller lowers the margins of the roundings by it.
#[inline(always)]
fn divide_precision(factor: &Lanes, start: usize, fitted: &mut Fitted) {
    let precision = part_mut(&mut fitted.precision, start);
    for i in 0..LANES {
        let known = precision[i] > 0.0;
        precision[i] /= if known { factor[i] } else { 1.0 };
    }
}

/// Add the variance that does not shrink with the modulation, rad², to that of the coordinate.
///
/// The roundings do not use it: it is no noise, and the caller lowers their margins by the errors
/// that the sets show.
#[inline(always)]
fn add_floor(floor: f32, start: usize, fitted: &mut Fitted) {
    let turns = floor * (1.0 / (TAU * TAU));
    let precision = part_mut(&mut fitted.precision, start);
    for i in 0..LANES {
        precision[i] /= 1.0 + turns * precision[i];
    }
}

#[inline(always)]
fn reasons(
    plan: &Plan,
    background: &Lanes,
    modulation: &Lanes,
    Unusable { weak, saturated }: &Unusable,
) -> [u32; LANES] {
    let all = plan.sets.len() as u32;
    let mut reasons = [0u32; LANES];
    for i in 0..LANES {
        let faint = modulation[i] < plan.limits.min_modulation || weak[i] > 0;
        let dark = if weak[i] == all {
            u32::from(reason::SHADOW)
        } else {
            u32::from(reason::LOW_MODULATION)
        };
        let lit = if faint { dark } else { u32::from(reason::OK) };
        let reason = if background[i].is_finite() {
            lit
        } else {
            u32::from(reason::MASKED)
        };
        reasons[i] = if saturated[i] > 0 {
            u32::from(reason::SATURATED)
        } else {
            reason
        };
    }
    reasons
}
