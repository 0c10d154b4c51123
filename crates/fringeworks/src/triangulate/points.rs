//! Points of a segment, their standard deviations, and reasons where there are none.

use super::arithmetic::{fused, power_of_two};
use super::depth::Work;
use super::prepare::{Projector, SpreadVariable};
use super::rays::SegmentSpread;
use super::row::Decoded;
use super::{Limits, Values, SEGMENT_PIXELS, SPREAD_COEFFICIENTS};
use crate::reason;

// Reasons as wide as the f32 lanes, so that choices between them stay vector operations.
const OK: u32 = reason::OK as u32;
const RAYS_APART: u32 = reason::RAYS_APART as u32;
const BEYOND: u32 = reason::BEYOND_GEOMETRY as u32;

/// Results of a segment; NaN where the rays do not meet in front of both devices.
pub struct SegmentPoints {
    pub x: Values,
    pub y: Values,
    pub z: Values,
    pub sigma: Values,
    pub noise: Values,
    pub residual: Values,
    pub reason: [u32; SEGMENT_PIXELS],
}

impl SegmentPoints {
    pub const fn new() -> Self {
        let zero = [0.0; SEGMENT_PIXELS];
        Self {
            x: zero,
            y: zero,
            z: zero,
            sigma: zero,
            noise: zero,
            residual: zero,
            reason: [0; SEGMENT_PIXELS],
        }
    }
}

/// What the last pass knows of a segment besides [`Work`].
pub struct Context<'a> {
    pub projector: &'a Projector,
    pub spread: &'a SegmentSpread,
    pub spread_variable: &'a SpreadVariable,
    /// Coordinates along the axis of the spread's variable.
    pub spread_axis: &'a Decoded,
    pub limits: &'a Limits,
}

/// Variance of w from the noise of the decoded coordinates (theory §9).
#[inline(always)]
fn noise_variance<const X: bool, const Y: bool>(work: &Work, i: usize) -> f32 {
    let (gx, gy) = (work.slope_x[i], work.slope_y[i]);
    let (variance_x, variance_y) = (work.variance_x[i], work.variance_y[i]);
    if X && Y {
        variance_x * variance_y / (variance_y * gx * gx + variance_x * gy * gy)
    } else if X {
        variance_x / (gx * gx)
    } else {
        variance_y / (gy * gy)
    }
}

/// Variance of w from the calibration.
#[inline(always)]
fn calibration_variance<const FMA: bool>(spread: &SegmentSpread, i: usize, variable: f32) -> f32 {
    let mut logarithm = 0.0;
    for n in (0..SPREAD_COEFFICIENTS).rev() {
        let coefficient = fused::<FMA>(i as f32, spread.slope[n], spread.first[n]);
        logarithm = fused::<FMA>(logarithm, variable, coefficient);
    }
    power_of_two::<FMA>(logarithm)
}

/// Signed distance from the epipolar line, px, and whether it is within the limit.
#[inline(always)]
fn epipolar_error(context: &Context, work: &Work, i: usize) -> (f32, bool) {
    let [focal_x, focal_y] = context.projector.focal;
    let limits = context.limits;
    let limit = limits.residual_sigmas * limits.residual_sigmas;
    let calibration = limits.residual_px * limits.residual_px;
    // The epipolar line runs along the derivative by w; both in px.
    let (ux, uy) = (focal_x * work.slope_x[i], focal_y * work.slope_y[i]);
    let (rx, ry) = (focal_x * work.residual_x[i], focal_y * work.residual_y[i]);
    let size = ux * ux + uy * uy;
    let across = rx * uy - ry * ux;
    let (sx, sy) = (focal_x * uy, focal_y * ux);
    let variance = work.variance_x[i] * sx * sx + work.variance_y[i] * sy * sy + calibration * size;
    (across / size.sqrt(), across * across <= limit * variance)
}

/// Last pass: points, standard deviations and reasons.
#[inline(always)]
pub fn finish<const X: bool, const Y: bool, const FMA: bool>(
    context: &Context,
    work: &Work,
    out: &mut SegmentPoints,
) {
    let SpreadVariable { offset, factor, .. } = *context.spread_variable;
    for i in 0..SEGMENT_PIXELS {
        let z = 1.0 / work.w[i];
        let noise = noise_variance::<X, Y>(work, i);
        let variable = offset + factor * context.spread_axis.coordinate[i];
        let calibration = calibration_variance::<FMA>(context.spread, i, variable);
        // σ along the ray: |r| z² σ_w.
        let to_mm = work.length[i] * z * z;
        let sigma = to_mm * (noise + calibration).sqrt();
        let front = (work.w[i] > 0.0) & (work.depth[i] > 0.0) & (sigma < f32::INFINITY);
        let mut meets = true;
        if X && Y {
            let (residual, within) = epipolar_error(context, work, i);
            meets = within;
            out.residual[i] = if front { residual } else { f32::NAN };
        }
        let good = front & meets;
        out.x[i] = if good { work.ray_x[i] * z } else { f32::NAN };
        out.y[i] = if good { work.ray_y[i] * z } else { f32::NAN };
        out.z[i] = if good { z } else { f32::NAN };
        out.noise[i] = if good { to_mm * noise.sqrt() } else { f32::NAN };
        out.sigma[i] = if good { sigma } else { f32::NAN };
        let apart = if meets { OK } else { RAYS_APART };
        out.reason[i] = if front { apart } else { BEYOND };
    }
}
