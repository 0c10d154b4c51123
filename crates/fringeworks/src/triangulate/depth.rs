//! The unknown w = 1/z of every pixel of a segment.
//!
//! Const parameters X and Y say which axes are decoded, FMA whether multiply-add is fused.

use super::arithmetic::{cubic, fused};
use super::prepare::Projector;
use super::rays::{self, Rays};
use super::row::Decoded;
use super::{Values, SEGMENT_PIXELS};

/// Intermediate values shared by the passes over a segment.
///
/// The passes are separate because a loop of Newton steps inside the loop over pixels would block
/// vectorisation.
pub struct Work {
    /// Camera ray r (r_z = 1) and its length |r|.
    pub ray_x: Values,
    pub ray_y: Values,
    pub length: Values,
    /// R r, the ray in the projector's axes.
    turned_x: Values,
    turned_y: Values,
    turned_z: Values,
    /// Decoded direction in the projector's normalised plane.
    goal_x: Values,
    goal_y: Values,
    /// Variance of that direction.
    pub variance_x: Values,
    pub variance_y: Values,
    /// 1/z of the camera, and the projector's depth divided by z.
    pub w: Values,
    pub depth: Values,
    /// Derivative of the projector's direction by w.
    pub slope_x: Values,
    pub slope_y: Values,
    /// Residual: decoded direction minus the direction at w.
    pub residual_x: Values,
    pub residual_y: Values,
}

impl Work {
    pub const fn new() -> Self {
        let zero = [0.0; SEGMENT_PIXELS];
        Self {
            ray_x: zero,
            ray_y: zero,
            length: zero,
            turned_x: zero,
            turned_y: zero,
            turned_z: zero,
            goal_x: zero,
            goal_y: zero,
            variance_x: zero,
            variance_y: zero,
            w: zero,
            depth: zero,
            slope_x: zero,
            slope_y: zero,
            residual_x: zero,
            residual_y: zero,
        }
    }
}

/// A pair of values, along x and along y.
type Two = (f32, f32);

/// The least-squares solution w of n = w d over the axes that are decoded, weighted by 1/variance.
#[inline(always)]
fn weighted_quotient<const X: bool, const Y: bool, const FMA: bool>(
    (variance_x, variance_y): Two,
    (nx, ny): Two,
    (dx, dy): Two,
) -> f32 {
    if X && Y {
        // Both weights times variance_x · variance_y: saves two divisions.
        let (weight_x, weight_y) = (variance_y, variance_x);
        let (ax, ay) = (weight_x * dx, weight_y * dy);
        fused::<FMA>(ax, nx, ay * ny) / fused::<FMA>(ax, dx, ay * dy)
    } else if X {
        nx / dx
    } else {
        ny / dy
    }
}

/// First pass: rays, decoded directions, and w without distortion.
#[inline(always)]
pub fn start<const X: bool, const Y: bool, const FMA: bool>(
    segment: &Rays,
    projector: &Projector,
    (along_x, along_y): (&Decoded, &Decoded),
    work: &mut Work,
) {
    let [t0, t1, t2] = projector.translation;
    let (scale_x, scale_y) = (1.0 / projector.focal[0], 1.0 / projector.focal[1]);
    let [principal_x, principal_y] = projector.principal;
    for i in 0..SEGMENT_PIXELS {
        let u = rays::variable(i);
        work.ray_x[i] = cubic::<FMA>(&segment.camera_x, u);
        work.ray_y[i] = cubic::<FMA>(&segment.camera_y, u);
        let [qx, qy, qz] = [0, 1, 2].map(|k| cubic::<FMA>(&segment.projector[k], u));
        work.length[i] = cubic::<FMA>(&segment.length, u);
        let (mut nx, mut dx, mut ny, mut dy) = (0.0, 0.0, 0.0, 0.0);
        if X {
            let goal = (along_x.coordinate[i] - principal_x) * scale_x;
            let sigma = along_x.sigma[i] * scale_x;
            (nx, dx) = (fused::<FMA>(goal, qz, -qx), fused::<FMA>(-goal, t2, t0));
            (work.goal_x[i], work.variance_x[i]) = (goal, sigma * sigma);
        }
        if Y {
            let goal = (along_y.coordinate[i] - principal_y) * scale_y;
            let sigma = along_y.sigma[i] * scale_y;
            (ny, dy) = (fused::<FMA>(goal, qz, -qy), fused::<FMA>(-goal, t2, t1));
            (work.goal_y[i], work.variance_y[i]) = (goal, sigma * sigma);
        }
        let variances = (work.variance_x[i], work.variance_y[i]);
        work.w[i] = weighted_quotient::<X, Y, FMA>(variances, (nx, ny), (dx, dy));
        (work.turned_x[i], work.turned_y[i], work.turned_z[i]) = (qx, qy, qz);
    }
}

/// A point at w as the projector's pinhole sees it, before distortion.
struct Projected {
    x: f32,
    y: f32,
    /// Derivatives by w.
    by_x: f32,
    by_y: f32,
    depth: f32,
}

#[inline(always)]
fn project<const FMA: bool>([t0, t1, t2]: [f32; 3], [qx, qy, qz]: [f32; 3], w: f32) -> Projected {
    let depth = fused::<FMA>(w, t2, qz);
    let inverse = 1.0 / depth;
    let x = fused::<FMA>(w, t0, qx) * inverse;
    let y = fused::<FMA>(w, t1, qy) * inverse;
    Projected {
        x,
        y,
        by_x: fused::<FMA>(-x, t2, t0) * inverse,
        by_y: fused::<FMA>(-y, t2, t1) * inverse,
        depth,
    }
}

/// Last pass for a projector without distortion: derivatives and residuals at w.
#[inline(always)]
pub fn linearise<const FMA: bool>(projector: &Projector, work: &mut Work) {
    for i in 0..SEGMENT_PIXELS {
        let turned = [work.turned_x[i], work.turned_y[i], work.turned_z[i]];
        let seen = project::<FMA>(projector.translation, turned, work.w[i]);
        work.depth[i] = seen.depth;
        (work.slope_x[i], work.slope_y[i]) = (seen.by_x, seen.by_y);
        work.residual_x[i] = work.goal_x[i] - seen.x;
        work.residual_y[i] = work.goal_y[i] - seen.y;
    }
}

/// One Newton step for a projector with distortion; derivatives and residuals to first order.
#[inline(always)]
pub fn newton_step<const X: bool, const Y: bool, const FMA: bool>(
    projector: &Projector,
    work: &mut Work,
) {
    for i in 0..SEGMENT_PIXELS {
        let w = work.w[i];
        let turned = [work.turned_x[i], work.turned_y[i], work.turned_z[i]];
        let seen = project::<FMA>(projector.translation, turned, w);
        work.depth[i] = seen.depth;
        let goal = (work.goal_x[i], work.goal_y[i]);
        let ((gx, gy), (ex, ey)) = distort::<X, Y, FMA>(projector.distortion, &seen, goal);
        let variances = (work.variance_x[i], work.variance_y[i]);
        let step = weighted_quotient::<X, Y, FMA>(variances, (ex, ey), (gx, gy));
        work.w[i] = w + step;
        (work.slope_x[i], work.slope_y[i]) = (gx, gy);
        (work.residual_x[i], work.residual_y[i]) = (ex - gx * step, ey - gy * step);
    }
}

/// Derivative of the distorted direction by w, and the residual of the decoded direction.
#[inline(always)]
fn distort<const X: bool, const Y: bool, const FMA: bool>(
    [k1, k2, p1, p2, k3]: [f32; 5],
    &Projected {
        x, y, by_x, by_y, ..
    }: &Projected,
    (goal_x, goal_y): Two,
) -> (Two, Two) {
    let (xx, xy, yy) = (x * x, x * y, y * y);
    let r2 = xx + yy;
    let inner = fused::<FMA>(r2, k3, k2);
    let radial = fused::<FMA>(r2, fused::<FMA>(r2, inner, k1), 1.0);
    // 2 (k₁ + 2 k₂ r² + 3 k₃ r⁴)
    let outer = fused::<FMA>(3.0 * k3, r2, 2.0 * k2);
    let radial_slope = 2.0 * fused::<FMA>(r2, outer, k1);
    let tangential = fused::<FMA>(2.0 * p1, x, 2.0 * p2 * y);
    let across = fused::<FMA>(xy, radial_slope, tangential);
    let (mut gx, mut gy, mut ex, mut ey) = (0.0, 0.0, 0.0, 0.0);
    if X {
        let by = fused::<FMA>(xx, radial_slope, radial);
        let by = fused::<FMA>(2.0 * p1, y, fused::<FMA>(6.0 * p2, x, by));
        gx = fused::<FMA>(by, by_x, across * by_y);
        let shift = fused::<FMA>(2.0 * p1, xy, p2 * fused::<FMA>(2.0, xx, r2));
        ex = goal_x - fused::<FMA>(x, radial, shift);
    }
    if Y {
        let by = fused::<FMA>(yy, radial_slope, radial);
        let by = fused::<FMA>(6.0 * p1, y, fused::<FMA>(2.0 * p2, x, by));
        gy = fused::<FMA>(across, by_x, by * by_y);
        let shift = fused::<FMA>(2.0 * p2, xy, p1 * fused::<FMA>(2.0, yy, r2));
        ey = goal_y - fused::<FMA>(y, radial, shift);
    }
    ((gx, gy), (ex, ey))
}
