//! Coordinates that start from a Gray code, or from a range without ends, and those of a Gray code alone.

use super::{Block, hide_unmeasured};
use crate::Reason;
use crate::decode::gray_code::HALF_DIFFERENCE;
use crate::decode::{BLOCK_PIXELS, DecodeSettings, GrayCode, Line};

/// Mark the pixels of a block whose first fringe order is ambiguous, or whose code is masked. Hide the
/// coordinates that are not measured, of which a block that is resolved with `START` shows all.
#[inline(always)]
pub fn check_start(plan: &DecodeSettings, block: &mut Block) {
    if let Some(code) = &plan.gray_code {
        check_code(plan, code, block);
        mask_gray(block);
    } else if plan.chain.circular && plan.chain.repeats.is_infinite() {
        check_ends(plan, block);
    }
    hide_unmeasured(block);
}

/// The reason of a pixel that is not unique where it is measured.
#[inline(always)]
fn unless(unique: bool, reason: u32) -> u32 {
    if !unique & (reason == Reason::Ok.lane()) {
        Reason::OrderAmbiguous.lane()
    } else {
        reason
    }
}

/// Relative coordinates without a finite repeat distance can lie outside the first combination's period.
/// Such a coordinate often leaves that period when the chain refines it.
#[inline(always)]
fn check_ends(plan: &DecodeSettings, block: &mut Block) {
    let (middle, confidence) = (plan.chain.middle, plan.limits.confidence);
    let half_range = 0.5 / plan.chain.frequencies[0];
    for i in 0..BLOCK_PIXELS {
        let reach = half_range - confidence * 2.0 * half_range * block.coarsest[i].sqrt();
        let inside = (block.coordinate[i] - middle).abs() <= reach;
        block.reason[i] = unless(inside, block.reason[i]);
    }
}

/// The coordinate must lie where the Gray code allows it, and the next one, a period of the first
/// combination away, must not.
///
/// With cells of half a period the first condition decides, with cells of one period the second.
#[inline(always)]
fn check_code(plan: &DecodeSettings, code: &GrayCode, block: &mut Block) {
    let period = 1.0 / plan.chain.frequencies[0];
    let (slack, confidence) = (code.slack, plan.limits.confidence);
    let (guard, of_period) = (code.guard, code.confidence);
    for i in 0..BLOCK_PIXELS {
        let sigma = period * block.coarsest[i].sqrt();
        let half_width = block.gray.half_width[i];
        let allowed = half_width + slack + confidence * sigma;
        let unique = period - half_width - guard - of_period * sigma;
        let off = (block.coordinate[i] - block.start[i]).abs();
        let near = (off <= allowed) & (off <= unique);
        block.reason[i] = unless(near, block.reason[i]);
    }
}

/// Mask the pixels that have a sample of the Gray code that is not finite.
#[inline(always)]
fn mask_gray(block: &mut Block) {
    for i in 0..BLOCK_PIXELS {
        let masked = block.start[i].is_infinite();
        block.reason[i] = if masked {
            Reason::Masked.lane()
        } else {
            block.reason[i]
        };
    }
}

/// Squared half width of a range over the variance of a coordinate that is uniform over it.
const UNIFORM_VARIANCE: f32 = 3.0;

/// Coordinates, variances and reasons of a block from its Gray code alone.
#[inline(always)]
pub fn resolve_gray_only(plan: &DecodeSettings, block: &mut Block) {
    let snr = plan.limits.min_snr;
    block.background = block.gray.threshold;
    block.modulation = block.gray.contrast;
    block.coordinate = block.gray.coordinate;
    for i in 0..BLOCK_PIXELS {
        block.sigma[i] = block.gray.half_width[i] * UNIFORM_VARIANCE.sqrt().recip();
    }
    block.disagreement = Line::of(0.0);
    for i in 0..BLOCK_PIXELS {
        let contrast = block.modulation[i];
        let noise = (HALF_DIFFERENCE * plan.noise.variance(block.background[i])).sqrt();
        let reason = if block.coordinate[i].is_infinite() {
            Reason::Masked
        } else if contrast < snr * noise {
            Reason::Shadow
        } else if contrast < plan.limits.min_modulation {
            Reason::LowModulation
        } else if block.coordinate[i].is_nan() {
            Reason::OrderAmbiguous
        } else {
            Reason::Ok
        };
        block.reason[i] = reason.lane();
    }
    hide_unmeasured(block);
}
