//! Whether a coordinate can be trusted: margins of the roundings, range, and agreement of the sets.

use super::resolve::Resolved;
use super::{nearest, part};
use crate::decode::fit::Fitted;
use crate::decode::{Lanes, Plan, LANES};

/// Bring the coordinates of a group into the range. Returns non-zero where the fringe order is
/// ambiguous: a rounding without its margin, or sets and Gray code that disagree.
#[inline(always)]
pub fn judge(plan: &Plan, at: usize, sets: &[Fitted], resolved: Resolved) -> [u32; LANES] {
    let mut ambiguous = [0u32; LANES];
    check_roundings(plan, at, sets, resolved.remainders, &mut ambiguous);
    if plan.chain.circular && plan.chain.repeats.is_infinite() {
        check_ends(plan, at, sets, resolved.coordinate, &mut ambiguous);
    }
    check_range(plan, plan.gray_code.is_some(), resolved, &mut ambiguous);
    ambiguous
}

/// The error of every rounding must stay within its margin, and away from the distance between its
/// remainder and that of the nearest other coordinate in the range.
///
/// The second test uses what the pixel shows: the closer a remainder is to half a turn, or the first
/// estimate to the place where it wraps, the smaller its error must be.
#[inline(always)]
fn check_roundings(
    plan: &Plan,
    at: usize,
    sets: &[Fitted],
    remainders: &[Lanes],
    ambiguous: &mut [u32; LANES],
) {
    let chain = &plan.chain;
    let per_sigma = 1.0 / plan.limits.order_confidence;
    for (k, row) in chain.amplification.chunks_exact(sets.len()).enumerate() {
        let (margin, alternative) = (chain.margin[k], chain.alternative[k] * per_sigma);
        let remainder = &remainders[chain.remainder[k]];
        let mut error = [0.0; LANES];
        for (fitted, &a) in sets.iter().zip(row) {
            let variance = part(&fitted.brightness_or_variance, at);
            for i in 0..LANES {
                error[i] += a * variance[i];
            }
        }
        for i in 0..LANES {
            let away = alternative - remainder[i].abs() * per_sigma;
            let fits = (error[i] <= margin) & (error[i] <= away * away);
            ambiguous[i] |= u32::from(!fits);
        }
    }
}

/// Relative coordinates without a finite repeat distance can lie outside the first combination's period.
/// Such a coordinate often leaves that period when the chain refines it.
#[inline(always)]
fn check_ends(plan: &Plan, at: usize, sets: &[Fitted], x: &Lanes, ambiguous: &mut [u32; LANES]) {
    let (chain, limits) = (&plan.chain, &plan.limits);
    let half_range = 0.5 / chain.frequencies[0];
    let mut coarsest = [0.0; LANES];
    for (fitted, &c) in sets.iter().zip(&chain.combinations) {
        let variance = part(&fitted.brightness_or_variance, at);
        for i in 0..LANES {
            coarsest[i] += c * c * variance[i];
        }
    }
    for i in 0..LANES {
        let reach = half_range - limits.confidence * 2.0 * half_range * coarsest[i].sqrt();
        let inside = (x[i] - chain.middle).abs() <= reach;
        ambiguous[i] |= u32::from(!inside);
    }
}

/// Coordinates modulo the repeat distance must lie in the range and near the Gray-code cell, and the
/// sets must agree.
#[inline(always)]
fn check_range(plan: &Plan, coded: bool, resolved: Resolved, ambiguous: &mut [u32; LANES]) {
    let (chain, limits) = (&plan.chain, &plan.limits);
    let allowed = limits.max_disagreement;
    let periodic = chain.repeats.is_finite() && !coded;
    let (repeats, turn, seam) = if periodic {
        (chain.repeats, 1.0 / chain.repeats, 0.5 * chain.repeats)
    } else {
        (0.0, 0.0, f32::INFINITY)
    };
    let reach = if coded {
        chain.code_reach
    } else {
        f32::INFINITY
    };
    let bounded = u32::from(!chain.circular);
    let x = resolved.coordinate;
    for i in 0..LANES {
        x[i] -= repeats * nearest((x[i] - chain.middle) * turn);
        let sigma = resolved.variance[i].sqrt();
        let margin = limits.confidence * sigma;
        let from_middle = (x[i] - chain.middle).abs();
        let inside =
            from_middle <= (chain.half + margin).min(seam - limits.order_confidence * sigma);
        let near = (x[i] - resolved.start[i]).abs() <= reach + margin;
        let agree = resolved.disagreement[i] <= allowed;
        ambiguous[i] |= u32::from(!agree) | u32::from(!near) | (bounded & u32::from(!inside));
    }
}
