//! Coordinates of a plan without fringes: the middles of the Gray code's cells.

use super::{Block, hide_unmeasured};
use crate::Reason;
use crate::decode::gray_code::HALF_DIFFERENCE;
use crate::decode::{BLOCK_PIXELS, DecodeSettings, Line};

/// Squared cell width over the variance of a coordinate that is uniform over the cell.
const UNIFORM_VARIANCE: f32 = 12.0;

/// Coordinates, variances and reasons of a block from its Gray code alone.
#[inline(always)]
pub fn resolve_gray_only(plan: &DecodeSettings, block: &mut Block) {
    let step = plan.gray_code.as_ref().map_or(0.0, |code| code.step);
    let snr = plan.limits.min_snr;
    block.background = block.gray.threshold;
    block.modulation = block.gray.contrast;
    block.coordinate = block.gray.coordinate;
    block.sigma = Line::of((step * step / UNIFORM_VARIANCE).sqrt());
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
