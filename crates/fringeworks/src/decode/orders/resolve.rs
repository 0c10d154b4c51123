//! Coordinate of a group of pixels by the chain of roundings, and its variance.

use super::judge::judge;
use super::phase_noise::phase_noise;
use super::{nearest, part, Scratch};
use crate::decode::fit::Fitted;
use crate::decode::{Lanes, PhaseSet, Plan, LANES};
use crate::reason;

/// The result for a group, by reference: copies of the arrays would cost time in the inner loop.
pub struct Resolved<'a> {
    /// Coordinate that the chain starts from, px: that of the Gray code, or the middle of the range.
    pub start: &'a Lanes,
    /// Largest distance of the true coordinate from the Gray code's, px.
    pub half_width: &'a Lanes,
    /// Coordinate, px.
    pub coordinate: &'a mut Lanes,
    /// Variance of the coordinate, px².
    pub variance: &'a Lanes,
    /// χ² of the sets' disagreement.
    pub disagreement: &'a Lanes,
    /// Remainder of every rounding, turns: those of the combinations, then those of the sets.
    pub remainders: &'a [Lanes],
}

/// v less the nearest whole number.
#[inline(always)]
fn wrap(v: f32) -> f32 {
    v - nearest(v)
}

/// Resolve the group of pixels from `at` on, and store it in the arrays of the block.
#[inline(always)]
pub fn resolve(plan: &Plan, at: usize, scratch: &mut Scratch) {
    let mut unusable = phase_noise(plan, at, scratch);
    if plan.gray_code.is_some() {
        mask_gray(part(&scratch.gray.coordinate, at), &mut unusable);
    }
    let start = if plan.gray_code.is_some() {
        *part(&scratch.gray.coordinate, at)
    } else {
        [plan.chain.middle; LANES]
    };
    let mut x = start;
    let (of_chain, of_sets) = scratch
        .remainders
        .split_at_mut(plan.chain.frequencies.len());
    follow_chain(plan, at, &scratch.sets, &mut x, of_chain);
    let (variance, disagreement) = average_sets(plan, at, &scratch.sets, &mut x, of_sets);
    let resolved = Resolved {
        start: &start,
        half_width: part(&scratch.gray.half_width, at),
        coordinate: &mut x,
        variance: &variance,
        disagreement: &disagreement,
        remainders: &scratch.remainders,
    };
    let ambiguous = judge(plan, at, &scratch.sets, resolved);
    let reasons = &mut scratch.reason[at..at + LANES];
    for i in 0..LANES {
        let ok = unusable[i] == u32::from(reason::OK) && ambiguous[i] == 0;
        reasons[i] = if ok {
            u32::from(reason::OK)
        } else {
            unusable[i].max(u32::from(unusable[i] == 0) * u32::from(reason::ORDER_AMBIGUOUS))
        };
    }
    let place = at..at + LANES;
    scratch.coordinate[place.clone()].copy_from_slice(&x);
    scratch.variance[place.clone()].copy_from_slice(&variance);
    scratch.disagreement[place].copy_from_slice(&disagreement);
}

/// Mask the pixels that have a sample of the Gray code that is not finite.
#[inline(always)]
fn mask_gray(start: &Lanes, reasons: &mut [u32; LANES]) {
    for i in 0..LANES {
        reasons[i] = if start[i].is_infinite() {
            u32::from(reason::MASKED)
        } else {
            reasons[i]
        };
    }
}

/// Refine the coordinate by the chain, from coarse combinations to fine ones:
/// x ← x + wrap(c·t − g x) / g, with the combination c of the phases t and its frequency g.
#[inline(always)]
fn follow_chain(plan: &Plan, at: usize, sets: &[Fitted], x: &mut Lanes, remainders: &mut [Lanes]) {
    let chain = &plan.chain;
    for (k, (&g, remainder)) in chain.frequencies.iter().zip(remainders).enumerate() {
        let row = &chain.combinations[k * sets.len()..(k + 1) * sets.len()];
        let mut phase = [0.0; LANES];
        for (fitted, &c) in sets.iter().zip(row) {
            let turns = part(&fitted.turns, at);
            for i in 0..LANES {
                phase[i] += c * turns[i];
            }
        }
        let px = 1.0 / g;
        for i in 0..LANES {
            remainder[i] = wrap(phase[i] - g * x[i]);
            x[i] += remainder[i] * px;
        }
    }
}

/// Replace the coordinate by the mean over all sets, weighted by inverse variance. Returns its variance
/// and its χ².
#[inline(always)]
fn average_sets(
    plan: &Plan,
    at: usize,
    sets: &[Fitted],
    x: &mut Lanes,
    remainders: &mut [Lanes],
) -> (Lanes, Lanes) {
    let (mut weight, mut pull, mut square) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    let sets = sets.iter().zip(&plan.sets).zip(remainders);
    for ((fitted, &PhaseSet { frequency: f, .. }), remainder) in sets {
        let (turns, precision) = (part(&fitted.turns, at), part(&fitted.precision, at));
        for i in 0..LANES {
            let off = wrap(turns[i] - f * x[i]);
            remainder[i] = off;
            let fp = f * precision[i];
            weight[i] += f * fp;
            pull[i] += fp * off;
            square[i] += precision[i] * off * off;
        }
    }
    let (mut variance, mut disagreement) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let inverse = 1.0 / weight[i];
        let shift = pull[i] * inverse;
        x[i] += shift;
        variance[i] = inverse;
        disagreement[i] = square[i] - shift * pull[i];
    }
    (variance, disagreement)
}
