//! Whether a coordinate can be trusted: margins of the roundings, range, and agreement of the sets.

use super::{nearest, weighted_sum, Scratch};
use crate::decode::fit::Fitted;
use crate::decode::{GrayCode, Line, Plan, BLOCK_PIXELS};

/// Bring the coordinates of a block into the range, and mark those whose fringe order is ambiguous: a
/// rounding without its margin, or sets and Gray code that disagree.
#[inline(always)]
pub fn judge(plan: &Plan, scratch: &mut Scratch) {
    scratch.ambiguous = Line::of(0);
    check_roundings(plan, scratch);
    if let Some(code) = &plan.gray_code {
        check_code(plan, code, scratch);
    } else if plan.chain.circular && plan.chain.repeats.is_infinite() {
        check_ends(plan, scratch);
    }
    check_range(plan, scratch);
}

/// The error of every rounding must stay within its margin, and away from the distance between its
/// remainder and that of the nearest other coordinate in the range.
///
/// The second test uses what the pixel shows: the closer a remainder is to half a turn, or the first
/// estimate to the place where it wraps, the smaller its error must be.
#[inline(always)]
fn check_roundings(plan: &Plan, scratch: &mut Scratch) {
    let chain = &plan.chain;
    let (per_sigma, sets) = (1.0 / plan.limits.order_confidence, &scratch.sets);
    for (k, row) in chain.amplification.chunks_exact(sets.len()).enumerate() {
        let (margin, alternative) = (chain.margin[k], chain.alternative[k] * per_sigma);
        let remainder = &scratch.remainders[chain.remainder[k]];
        let mut error = Line::of(0.0);
        weighted_sum(variances(sets).zip(row.iter().copied()), &mut error);
        for i in 0..BLOCK_PIXELS {
            let away = alternative - remainder[i].abs() * per_sigma;
            let fits = (error[i] <= margin) & (error[i] <= away * away);
            scratch.ambiguous[i] |= u32::from(!fits);
        }
    }
}

/// Relative coordinates without a finite repeat distance can lie outside the first combination's period.
/// Such a coordinate often leaves that period when the chain refines it.
#[inline(always)]
fn check_ends(plan: &Plan, scratch: &mut Scratch) {
    let (middle, confidence) = (plan.chain.middle, plan.limits.confidence);
    let half_range = 0.5 / plan.chain.frequencies[0];
    let coarsest = coarsest_variance(plan, &scratch.sets);
    for i in 0..BLOCK_PIXELS {
        let reach = half_range - confidence * 2.0 * half_range * coarsest[i].sqrt();
        let inside = (scratch.coordinate[i] - middle).abs() <= reach;
        scratch.ambiguous[i] |= u32::from(!inside);
    }
}

/// Variance of every set's phase, turns².
#[inline(always)]
fn variances(sets: &[Fitted]) -> impl Iterator<Item = &Line> {
    sets.iter().map(|fitted| &fitted.brightness_or_variance)
}

/// Variance of the first combination of the chain, turns².
#[inline(always)]
fn coarsest_variance(plan: &Plan, sets: &[Fitted]) -> Line {
    let mut coarsest = Line::of(0.0);
    let squares = plan.chain.combinations.iter().map(|c| c * c);
    weighted_sum(variances(sets).zip(squares), &mut coarsest);
    coarsest
}

/// The coordinate must lie where the Gray code allows it, and the next one, a period of the first
/// combination away, must not.
///
/// With cells of half a period the first condition decides, with cells of one period the second.
#[inline(always)]
fn check_code(plan: &Plan, code: &GrayCode, scratch: &mut Scratch) {
    let period = 1.0 / plan.chain.frequencies[0];
    let (slack, confidence) = (code.slack, plan.limits.confidence);
    let (guard, of_period) = (code.guard, code.confidence);
    let coarsest = coarsest_variance(plan, &scratch.sets);
    for i in 0..BLOCK_PIXELS {
        let sigma = period * coarsest[i].sqrt();
        let half_width = scratch.gray.half_width[i];
        let allowed = half_width + slack + confidence * sigma;
        let unique = period - half_width - guard - of_period * sigma;
        let off = (scratch.coordinate[i] - scratch.start[i]).abs();
        let near = (off <= allowed) & (off <= unique);
        scratch.ambiguous[i] |= u32::from(!near);
    }
}

/// Coordinates modulo the repeat distance must lie in the range, and the sets must agree.
#[inline(always)]
fn check_range(plan: &Plan, scratch: &mut Scratch) {
    let (chain, limits) = (&plan.chain, &plan.limits);
    let (middle, half) = (chain.middle, chain.half);
    let (allowed, confidence) = (limits.max_disagreement, limits.confidence);
    let order_confidence = limits.order_confidence;
    let periodic = chain.repeats.is_finite() && plan.gray_code.is_none();
    let (repeats, turn, seam) = if periodic {
        (chain.repeats, 1.0 / chain.repeats, 0.5 * chain.repeats)
    } else {
        (0.0, 0.0, f32::INFINITY)
    };
    let bounded = u32::from(!chain.circular);
    let x = &mut scratch.coordinate;
    for i in 0..BLOCK_PIXELS {
        x[i] -= repeats * nearest((x[i] - middle) * turn);
        let sigma = scratch.variance[i].sqrt();
        let from_middle = (x[i] - middle).abs();
        let margin = (half + confidence * sigma).min(seam - order_confidence * sigma);
        let inside = from_middle <= margin;
        let agree = scratch.disagreement[i] <= allowed;
        scratch.ambiguous[i] |= u32::from(!agree) | (bounded & u32::from(!inside));
    }
}
