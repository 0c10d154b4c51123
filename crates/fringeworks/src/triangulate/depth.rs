//! The unknown w = 1/z of a pixel.
//!
//! Const parameters X and Y say which axes are decoded, MAIN_X along which of them Newton's method
//! starts, STEPS the number of its steps, FMA whether multiply-add is fused.

use super::arithmetic::{cubic, fused};
use super::prepare::{Projector, Segment};

/// A pair of values, along x and along y.
pub type Two = (f32, f32);

/// A pixel's decoded directions in the projector's normalised plane, their variances, and the main
/// coordinate in the variable of the segment's polynomials.
#[derive(Clone, Copy)]
pub struct Goal {
    pub direction: Two,
    pub variance: Two,
    pub main: f32,
}

/// What a pixel's ray meets.
pub struct Met {
    /// Camera ray r (r_z = 1) and its length |r|.
    pub ray: Two,
    pub length: f32,
    /// 1/z of the camera.
    pub w: f32,
    pub last: Step,
}

/// A step of Newton's method, and what is known where it starts.
#[derive(Default)]
pub struct Step {
    /// What the step adds to w.
    by: f32,
    /// The projector's depth divided by z.
    pub depth: f32,
    /// Variance of w from the noise of the decoded coordinates (theory §9).
    pub noise: f32,
    /// Derivative of the projector's direction by w.
    pub slope: Two,
    /// Residual after the step: decoded direction minus the direction at w.
    pub residual: Two,
}

/// The least-squares solution w over the axes that are decoded, weighted by 1/variance.
///
/// `u` is the place of the pixel in its segment, in the variable of the cubics.
#[inline(always)]
pub fn meet<
    const X: bool,
    const Y: bool,
    const MAIN_X: bool,
    const STEPS: usize,
    const FMA: bool,
>(
    projector: &Projector,
    segment: &Segment,
    u: f32,
    goal: Goal,
) -> Met {
    let rx = cubic::<FMA>(&segment.rays.camera_x, u);
    let ry = cubic::<FMA>(&segment.rays.camera_y, u);
    let r = &projector.rotation;
    let turned = |k: usize| fused::<FMA>(rx, r[k], fused::<FMA>(ry, r[k + 1], r[k + 2]));
    let (qx, qy, qz) = (turned(0), turned(3), turned(6));
    let [t0, t1, t2] = projector.translation;
    let shift = cubic::<FMA>(&segment.shift, goal.main);
    let mut w = if MAIN_X {
        let start = goal.direction.0 + shift;
        fused::<FMA>(start, qz, -qx) / fused::<FMA>(-start, t2, t0)
    } else {
        let start = goal.direction.1 + shift;
        fused::<FMA>(start, qz, -qy) / fused::<FMA>(-start, t2, t1)
    };
    let mut step = Step::default();
    for _ in 0..STEPS {
        step = newton_step::<X, Y, FMA>(projector, (qx, qy, qz), w, &goal);
        w += step.by;
    }
    Met {
        ray: (rx, ry),
        length: cubic::<FMA>(&segment.rays.length, u),
        w,
        last: step,
    }
}

/// One Newton step from w, for a ray q in the projector's axes.
#[inline(always)]
fn newton_step<const X: bool, const Y: bool, const FMA: bool>(
    projector: &Projector,
    (qx, qy, qz): (f32, f32, f32),
    w: f32,
    goal: &Goal,
) -> Step {
    let [t0, t1, t2] = projector.translation;
    let depth = fused::<FMA>(w, t2, qz);
    let inverse = 1.0 / depth;
    let x = fused::<FMA>(w, t0, qx) * inverse;
    let y = fused::<FMA>(w, t1, qy) * inverse;
    let by_x = fused::<FMA>(-x, t2, t0) * inverse;
    let by_y = fused::<FMA>(-y, t2, t1) * inverse;
    let seen = ((x, y), (by_x, by_y));
    let ((gx, gy), (ex, ey)) = distort::<X, Y, FMA>(projector.distortion, seen, goal.direction);
    let (by, noise) = if X && Y {
        // Both weights times variance_x · variance_y: one division for all.
        let (weight_x, weight_y) = (goal.variance.1, goal.variance.0);
        let (ax, ay) = (weight_x * gx, weight_y * gy);
        let inverse = 1.0 / fused::<FMA>(ax, gx, ay * gy);
        let by = fused::<FMA>(ax, ex, ay * ey) * inverse;
        (by, weight_x * weight_y * inverse)
    } else {
        let (g, e, variance) = if X {
            (gx, ex, goal.variance.0)
        } else {
            (gy, ey, goal.variance.1)
        };
        let inverse = 1.0 / g;
        (e * inverse, variance * (inverse * inverse))
    };
    Step {
        by,
        depth,
        noise,
        slope: (gx, gy),
        residual: (ex - gx * by, ey - gy * by),
    }
}

/// Derivative of the distorted direction by w, and the residual of the decoded direction.
#[inline(always)]
fn distort<const X: bool, const Y: bool, const FMA: bool>(
    [k1, k2, p1, p2, k3]: [f32; 5],
    ((x, y), (by_x, by_y)): (Two, Two),
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
