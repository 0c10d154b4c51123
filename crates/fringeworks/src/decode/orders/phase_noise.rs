//! Variance of every phase, and the pixels whose fringes are too weak.

use super::Scratch;
use crate::decode::fit::{Fitted, NO_PRECISION};
use crate::decode::{Line, Plan, BLOCK_PIXELS};
use crate::reason;
use std::f32::consts::TAU;

/// More than the number of sets.
const UNDETERMINED: u32 = 1 << 16;

/// Sets of a pixel whose phase cannot be used.
pub struct Unusable {
    /// Number of sets whose fringe is too weak, plus [`UNDETERMINED`] for each whose phase saturation
    /// leaves undetermined: one array, because loading and storing take as long as the sums.
    weak: Line<u32>,
    /// Why the phases of a pixel cannot be used, or OK.
    pub reason: Line<u32>,
}

impl Unusable {
    pub const fn none() -> Self {
        let zero = Line::of(0);
        Self {
            weak: zero,
            reason: zero,
        }
    }
}

/// Turn the precision of every phase into 1/turns², and its brightness into its variance, in place;
/// and find the pixels whose phases cannot be used.
#[inline(always)]
pub fn phase_noise(plan: &Plan, scratch: &mut Scratch) {
    let unusable = &mut scratch.unusable;
    unusable.weak = Line::of(0);
    let usual = plan.limits.usual_inflation;
    for (fitted, set) in scratch.sets.iter_mut().zip(&plan.sets) {
        if let Some(factor) = &scratch.inflation {
            divide_precision(factor, |f| (f / usual).max(1.0), &mut fitted.precision);
        }
        if plan.noise.gain > 0.0 {
            set_noise::<true>(plan, fitted, unusable);
        } else {
            set_noise::<false>(plan, fitted, unusable);
        }
        if set.floor > 0.0 {
            add_floor(set.floor, &mut fitted.precision);
        }
        if let Some(factor) = &scratch.inflation {
            divide_precision(factor, |f| f.min(usual), &mut fitted.precision);
        }
    }
    reasons(plan, &scratch.background, &scratch.modulation, unusable);
}

/// The same for one set; SHOT says whether there is shot noise.
#[inline(always)]
fn set_noise<const SHOT: bool>(plan: &Plan, fitted: &mut Fitted, unusable: &mut Unusable) {
    let min_precision = plan.limits.min_snr * plan.limits.min_snr;
    let [second, third] = plan.chain.order_variance;
    let (read_variance, gain) = (plan.noise.read_variance, plan.noise.gain);
    let per_read_noise = 1.0 / read_variance;
    let (precision, variance) = (&mut fitted.precision, &mut fitted.brightness_or_variance);
    for i in 0..BLOCK_PIXELS {
        let per_noise = if SHOT {
            1.0 / (read_variance + gain * variance[i].max(0.0))
        } else {
            per_read_noise
        };
        let unit = precision[i];
        let q = unit * per_noise;
        let strong = q >= min_precision;
        let undetermined = unit == NO_PRECISION;
        unusable.weak[i] += u32::from(!strong) + if undetermined { UNDETERMINED } else { 0 };
        // 1/q underestimates the variance by about 1/q²: half because B comes from the same noisy
        // samples, half because the phase of a weak fringe is not Gaussian. Fringe orders are judged by
        // a larger variance, see `Chain::order_variance`.
        let u = 1.0 / q;
        let v = u * (1.0 + u * (second + third * u));
        precision[i] = q * (1.0 - u + u * u) * (TAU * TAU);
        variance[i] = v * (1.0 / (TAU * TAU));
    }
}

/// Divide the precision of a block by a function of a factor on its variances.
///
/// Before the noise is computed, the factor counts for the roundings, too. What is usual in a scene
/// counts for the coordinate only: the caller lowers the margins of the roundings by it.
#[inline(always)]
fn divide_precision(factor: &Line, of: impl Fn(f32) -> f32, precision: &mut Line) {
    for i in 0..BLOCK_PIXELS {
        let known = precision[i] > 0.0;
        precision[i] /= if known { of(factor[i]) } else { 1.0 };
    }
}

/// Add the variance that does not shrink with the modulation, rad², to that of the coordinate.
///
/// The roundings do not use it: it is no noise, and the caller lowers their margins by the errors
/// that the sets show.
#[inline(always)]
fn add_floor(floor: f32, precision: &mut Line) {
    let turns = floor * (1.0 / (TAU * TAU));
    for i in 0..BLOCK_PIXELS {
        precision[i] /= 1.0 + turns * precision[i];
    }
}

#[inline(always)]
fn reasons(plan: &Plan, background: &Line, modulation: &Line, unusable: &mut Unusable) {
    let (all, min_modulation) = (plan.sets.len() as u32, plan.limits.min_modulation);
    for i in 0..BLOCK_PIXELS {
        let weak = unusable.weak[i] % UNDETERMINED;
        let faint = (modulation[i] < min_modulation) | (weak > 0);
        let dark = if weak == all {
            u32::from(reason::SHADOW)
        } else {
            u32::from(reason::LOW_MODULATION)
        };
        let lit = if faint { dark } else { u32::from(reason::OK) };
        let finite = background[i].is_finite();
        let reason = if finite {
            lit
        } else {
            u32::from(reason::MASKED)
        };
        let saturated = unusable.weak[i] >= UNDETERMINED;
        unusable.reason[i] = if saturated {
            u32::from(reason::SATURATED)
        } else {
            reason
        };
    }
}
