//! Points of a segment, their standard deviations, and reasons where there are none.

use super::arithmetic::{fused, power_of_two};
use super::depth::{Goal, Met, meet};
use super::prepare::{Projector, Segment, Triangulation};
use super::rays::{SegmentSpread, variable};
use super::row::Decoded;
use super::{Limits, SEGMENT_PIXELS, SPREAD_COEFFICIENTS, Values};
use crate::Reason;

// Reasons as wide as the f32 lanes, so that choices between them stay vector operations.
const OK: u32 = Reason::Ok.lane();
const RAYS_APART: u32 = Reason::RaysApart.lane();
const BEYOND: u32 = Reason::BeyondGeometry.lane();

/// Results of a segment; NaN where the rays do not meet in front of both devices.
#[repr(align(64))] // Vectors do not lie across two lines of the cache.
pub struct SegmentPoints {
    pub x: Values,
    pub y: Values,
    pub z: Values,
    pub sigma: Values,
    pub noise: Values,
    pub residual: Values,
    pub reason: [u8; SEGMENT_PIXELS],
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

/// What all segments have in common. It is copied for each row: what might change in memory between two
/// segments would be loaded into registers for each of them.
pub struct Constants {
    projector: Projector,
    /// Reciprocals of the projector's focal lengths, 1/px.
    scale: [f32; 2],
    /// Variable of the calibration's variance: offset and factor.
    variable: [f32; 2],
    /// Squares of the limits' number of standard deviations and of the calibration's share, px².
    within: [f32; 2],
}

impl Constants {
    pub fn new(rig: &Triangulation, limits: &Limits) -> Self {
        Self {
            projector: rig.projector,
            scale: rig.projector.focal.map(|focal| 1.0 / focal),
            variable: [rig.spread_variable.offset, rig.spread_variable.factor],
            within: [limits.residual_sigmas, limits.residual_px].map(|limit| limit * limit),
        }
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

/// Signed distance from the epipolar line, px, and whether it is within the limits: the squared number
/// of standard deviations, and the calibration's variance in px².
#[inline(always)]
fn epipolar_error(
    [focal_x, focal_y]: [f32; 2],
    [sigmas, calibration]: [f32; 2],
    goal: &Goal,
    met: &Met,
) -> (f32, bool) {
    // The epipolar line runs along the derivative by w; both in px.
    let (ux, uy) = (focal_x * met.last.slope.0, focal_y * met.last.slope.1);
    let (rx, ry) = (focal_x * met.last.residual.0, focal_y * met.last.residual.1);
    let size = ux * ux + uy * uy;
    let across = rx * uy - ry * ux;
    let (sx, sy) = (focal_x * uy, focal_y * ux);
    let variance = goal.variance.0 * sx * sx + goal.variance.1 * sy * sy + calibration * size;
    (across / size.sqrt(), across * across <= sigmas * variance)
}

/// Points, standard deviations and reasons of a segment.
///
/// One loop does it all. Short loops over reasons alone would be unrolled before the compiler looks for
/// vectors, and end as one branch per pixel.
#[inline(always)]
pub fn points<
    const X: bool,
    const Y: bool,
    const MAIN_X: bool,
    const STEPS: usize,
    const FMA: bool,
>(
    constants: &Constants,
    segment: &Segment,
    (along_x, along_y): (&Decoded, &Decoded),
    out: &mut SegmentPoints,
) {
    let projector = &constants.projector;
    let [scale_x, scale_y] = constants.scale;
    let [principal_x, principal_y] = projector.principal;
    let [offset, factor] = constants.variable;
    for i in 0..SEGMENT_PIXELS {
        let before = reason_before::<X, Y>(along_x.reason[i], along_y.reason[i]);
        let decoded = before == OK;
        let (x, y) = (along_x.coordinate[i], along_y.coordinate[i]);
        let (sx, sy) = (along_x.sigma[i] * scale_x, along_y.sigma[i] * scale_y);
        let goal = Goal {
            direction: ((x - principal_x) * scale_x, (y - principal_y) * scale_y),
            variance: (sx * sx, sy * sy),
            main: offset + factor * if MAIN_X { x } else { y },
        };
        let met = meet::<X, Y, MAIN_X, STEPS, FMA>(projector, segment, variable(i), goal);
        let z = 1.0 / met.w;
        let calibration = calibration_variance::<FMA>(&segment.spread, i, goal.main);
        // σ along the ray: |r| z² σ_w.
        let to_mm = met.length * z * z;
        let sigma = to_mm * (met.last.noise + calibration).sqrt();
        let front = (met.w > 0.0) & (met.last.depth > 0.0) & (sigma < f32::INFINITY);
        let mut meets = true;
        if X && Y {
            let (residual, near) = epipolar_error(projector.focal, constants.within, &goal, &met);
            meets = near;
            out.residual[i] = if front & decoded { residual } else { f32::NAN };
        }
        let good = front & meets & decoded;
        let keep = |value: f32| if good { value } else { f32::NAN };
        out.x[i] = keep(met.ray.0 * z);
        out.y[i] = keep(met.ray.1 * z);
        out.z[i] = keep(z);
        out.noise[i] = keep(to_mm * met.last.noise.sqrt());
        out.sigma[i] = keep(sigma);
        let apart = if meets { OK } else { RAYS_APART };
        let triangulated = if front { apart } else { BEYOND };
        out.reason[i] = if decoded { triangulated } else { before } as u8;
    }
}

/// Reason of decoding: that of the columns first, then that of the rows.
#[inline(always)]
fn reason_before<const X: bool, const Y: bool>(columns: u8, rows: u8) -> u32 {
    let columns = if X { u32::from(columns) } else { OK };
    let rows = if Y { u32::from(rows) } else { OK };
    if columns == OK { rows } else { columns }
}
