//! Coordinate of a block of pixels by the chain of roundings, and its variance.

use super::judge::judge;
use super::phase_noise::phase_noise;
use super::{nearest, weighted_sum, Scratch};
use crate::decode::fit::Fitted;
use crate::decode::{Line, Plan, BLOCK_PIXELS};
use crate::reason;

/// v less the nearest whole number.
#[inline(always)]
fn wrap(v: f32) -> f32 {
    v - nearest(v)
}

/// Resolve the fringe orders of the block.
#[inline(always)]
pub fn resolve(plan: &Plan, scratch: &mut Scratch) {
    phase_noise(plan, scratch);
    scratch.start = if plan.gray_code.is_some() {
        scratch.gray.coordinate
    } else {
        Line::of(plan.chain.middle)
    };
    scratch.coordinate = scratch.start;
    follow_chain(plan, scratch);
    average_sets(plan, scratch);
    judge(plan, scratch);
    for i in 0..BLOCK_PIXELS {
        let ambiguous = if scratch.ambiguous[i] > 0 {
            u32::from(reason::ORDER_AMBIGUOUS)
        } else {
            u32::from(reason::OK)
        };
        let unusable = scratch.unusable.reason[i];
        let usable = unusable == u32::from(reason::OK);
        scratch.reason[i] = if usable { ambiguous } else { unusable };
    }
    if plan.gray_code.is_some() {
        mask_gray(&scratch.start, &mut scratch.reason);
    }
}

/// Mask the pixels that have a sample of the Gray code that is not finite.
#[inline(always)]
fn mask_gray(start: &Line, reasons: &mut Line<u32>) {
    for i in 0..BLOCK_PIXELS {
        let masked = start[i].is_infinite();
        reasons[i] = if masked {
            u32::from(reason::MASKED)
        } else {
            reasons[i]
        };
    }
}

/// Refine the coordinate by the chain, from coarse combinations to fine ones:
/// x ← x + wrap(c·t − g x) / g, with the combination c of the phases t and its frequency g.
#[inline(always)]
fn follow_chain(plan: &Plan, scratch: &mut Scratch) {
    let (chain, x) = (&plan.chain, &mut scratch.coordinate);
    for (k, &g) in chain.frequencies.iter().enumerate() {
        let row = &chain.combinations[k * scratch.sets.len()..];
        let terms = scratch
            .sets
            .iter()
            .zip(row)
            .map(|(fitted, &c)| (&fitted.turns, c));
        let remainder = &mut scratch.remainders[k];
        weighted_sum(terms, remainder);
        let px = 1.0 / g;
        for i in 0..BLOCK_PIXELS {
            let off = wrap(remainder[i] - g * x[i]);
            remainder[i] = off;
            x[i] += off * px;
        }
    }
}

/// Replace the coordinate by the mean over all sets, weighted by inverse variance; its variance and
/// its χ².
#[inline(always)]
fn average_sets(plan: &Plan, scratch: &mut Scratch) {
    let x = &mut scratch.coordinate;
    let zero = Line::of(0.0);
    let (mut weight, mut pull, mut square) = (zero, zero, zero);
    let remainders = &mut scratch.remainders[plan.chain.frequencies.len()..];
    for ((fitted, set), remainder) in scratch.sets.iter().zip(&plan.sets).zip(remainders) {
        let f = set.frequency;
        let Fitted {
            turns, precision, ..
        } = fitted;
        for i in 0..BLOCK_PIXELS {
            let off = wrap(turns[i] - f * x[i]);
            remainder[i] = off;
            let fp = f * precision[i];
            weight[i] += f * fp;
            pull[i] += fp * off;
            square[i] += precision[i] * off * off;
        }
    }
    for i in 0..BLOCK_PIXELS {
        let inverse = 1.0 / weight[i];
        let shift = pull[i] * inverse;
        x[i] += shift;
        scratch.variance[i] = inverse;
        scratch.disagreement[i] = square[i] - shift * pull[i];
    }
}
