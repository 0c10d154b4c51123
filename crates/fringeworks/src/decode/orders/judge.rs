//! Whether a coordinate can be trusted: margins of the roundings, range, and agreement of the sets.

use super::resolve::Resolved;
use super::{nearest, part};
use crate::decode::fit::Fitted;
use crate::decode::{GrayCode, Lanes, Plan, LANES};

/// Bring the coordinates of a group into the range. Returns non-zero where the fringe order is
/// ambiguous: a rounding without its margin, or sets and Gray code that disagree.
#[inline(always)]
pub fn judge(plan: &Plan, at: usize, sets: &[Fitted], resolved: Resolved) -> [u32; LANES] {
    let mut ambiguous = [0u32; LANES];
    check_roundings(plan, at, sets, resolved.remainders, &mut ambiguous);
    if let Some(code) = &plan.gray_code {
        let coarsest = coarsest_variance(plan, at, sets);
        check_code(plan, code, &coarsest, &resolved, &mut ambiguous);
    } else if plan.chain.circular && plan.chain.repeats.is_infinite() {
        check_ends(plan, at, sets, resolved.coordinate, &mut ambiguous);
    }
    check_range(plan, resolved, &mut ambiguous);
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
    let coarsest = coarsest_variance(plan, at, sets);
    for i in 0..LANES {
        let reach = half_range - limits.confidence * 2.0 * half_range * coarsest[i].sqrt();
        let inside = (x[i] - chain.middle).abs() <= reach;
        ambiguous[i] |= u32::from(!inside);
    }
}

/// Variance of the first combination of the chain, turns².
#[inline(always)]
fn coarsest_variance(plan: &Plan, at: usize, sets: &[Fitted]) -> Lanes {
    let mut coarsest = [0.0; LANES];
    for (fitted, &c) in sets.iter().zip(&plan.chain.combinations) {
        let variance = part(&fitted.brightness_or_variance, at);
        for i in 0..LANES {
            coarsest[i] += c * c * variance[i];
        }
    }
    coarsest
}

/// The coordinate must lie where the Gray code allows it, and the next one, a period of the first
/// combination away, must not.
///
/// With cells of half a period the first condition decides, with cells of one period the second.
#[inline(always)]
fn check_code(
    plan: &Plan,
    code: &GrayCode,
    coarsest: &Lanes,
    resolved: &Resolved,
    ambiguous: &mut [u32; LANES],
) {
    let period = 1.0 / plan.chain.frequencies[0];
    for i in 0..LANES {
        let sigma = period * coarsest[i].sqrt();
        let half_width = resolved.half_width[i];
        let allowed = half_width + code.slack + plan.limits.confidence * sigma;
        let unique = period - half_width - code.guard - code.confidence * sigma;
        let off = (resolved.coordinate[i] - resolved.start[i]).abs();
        let near = off <= allowed && off <= unique;
        ambiguous[i] |= u32::from(!near);
    }
}

/// Coordinates modulo the repeat distance must lie in the range, and the sets must agree.
#[inline(always)]
fn check_range(plan: &Plan, resolved: Resolved, ambiguous: &mut [u32; LANES]) {
    let (chain, limits) = (&plan.chain, &plan.limits);
    let allowed = limits.max_disagreement;
    let periodic = chain.repeats.is_finite() && plan.gray_code.is_none();
    let (repeats, turn, seam) = if periodic {
        (chain.repeats, 1.0 / chain.repeats, 0.5 * chain.repeats)
    } else {
        (0.0, 0.0, f32::INFINITY)
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
        let agree = resolved.disagreement[i] <= allowed;
        ambiguous[i] |= u32::from(!agree) | (bounded & u32::from(!inside));
    }
}
