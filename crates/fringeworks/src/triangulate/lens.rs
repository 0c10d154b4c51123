//! A pinhole with Brown's distortion (theory §8).

/// Newton steps after which the inversion of a camera's distortion is given up.
///
/// Each step squares the error of a mild distortion, so five steps are usual. The rest is reserve
/// for strong lenses near the edge of the frame.
const MAX_INVERSION_STEPS: usize = 20;

/// Largest error of an inverted direction, in units of the normalised plane (1 = focal length).
///
/// Far below a thousandth of a pixel for any focal length, and above the rounding of f64.
pub const INVERSION_TOLERANCE: f64 = 1e-12;

/// Largest number of Newton steps per pixel.
///
/// Five squarings bring even an error of 0.5 below single precision; a lens that needs more has no
/// inverse over its frame.
pub const MAX_NEWTON_STEPS: usize = 5;

/// Error of a direction at which Newton's method may stop, in units of the normalised plane.
///
/// About the rounding of a single-precision value near 1.
const NEWTON_TOLERANCE: f64 = 1e-7;

/// Safety factor on the first error of Newton's method.
///
/// A correction of w moves the point along its epipolar line, so the distortion changes as well.
const NEWTON_MARGIN: f64 = 4.0;

/// Upper bound on the first error that the number of Newton steps is computed from.
///
/// Squaring an error of 1 or more would never end.
const MAX_FIRST_ERROR: f64 = 0.9;

/// Intervals along each border of the projector's frame at which its distortion is evaluated.
///
/// Distortion is largest at the border, and a polynomial of degree 7 is smooth over an eighth of it.
const BORDER_INTERVALS: usize = 8;

/// Newton steps after which a first error, in units of the normalised plane, is below single
/// precision: one or more.
///
/// Each step squares the error.
pub fn newton_steps(first: f64) -> usize {
    let mut error = (NEWTON_MARGIN * first).min(MAX_FIRST_ERROR);
    let mut steps = 0;
    while error > NEWTON_TOLERANCE && steps < MAX_NEWTON_STEPS {
        error *= error;
        steps += 1;
    }
    steps.max(1)
}

/// A pinhole with Brown's distortion k₁, k₂, p₁, p₂, k₃.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    /// Focal lengths along x and y, px.
    pub focal: [f64; 2],
    /// Principal point, px.
    pub principal: [f64; 2],
    /// k₁, k₂, p₁, p₂, k₃.
    pub distortion: [f64; 5],
}

/// Derivatives of the distorted direction (x, y); the matrix [[xx, xy], [xy, yy]] is symmetric.
struct Jacobian {
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Lens {
    /// Distorted direction of the normalised direction (x, y).
    #[inline(always)]
    pub(super) fn distort(&self, x: f64, y: f64) -> (f64, f64) {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }

    #[inline(always)]
    fn jacobian(&self, x: f64, y: f64) -> Jacobian {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2));
        Jacobian {
            xx: radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            xy: x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y,
            yy: radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        }
    }

    /// Normalised direction of a pixel; NaN where the distortion has no inverse.
    pub(super) fn ray(&self, column: f64, row: f64) -> (f64, f64) {
        let goal = (
            (column - self.principal[0]) / self.focal[0],
            (row - self.principal[1]) / self.focal[1],
        );
        let (mut x, mut y) = goal;
        for _ in 0..MAX_INVERSION_STEPS {
            let (xd, yd) = self.distort(x, y);
            let (ex, ey) = (xd - goal.0, yd - goal.1);
            let Jacobian { xx, xy, yy } = self.jacobian(x, y);
            if ex.abs().max(ey.abs()) < INVERSION_TOLERANCE {
                // A matrix that is not positive definite belongs to a branch of the polynomial
                // beyond its fold, where the image is mirrored.
                let unfolded = xx > 0.0 && xx * yy > xy * xy;
                return if unfolded {
                    (x, y)
                } else {
                    (f64::NAN, f64::NAN)
                };
            }
            let determinant = xx * yy - xy * xy;
            x -= (yy * ex - xy * ey) / determinant;
            y -= (xx * ey - xy * ex) / determinant;
        }
        (f64::NAN, f64::NAN)
    }

    /// Largest shift of a direction by distortion along the border of a frame.
    pub(super) fn largest_distortion(&self, size: (usize, usize)) -> f64 {
        let normalised = |n: usize, pixels: usize, axis: usize| {
            (n as f64 / BORDER_INTERVALS as f64 * pixels as f64 - self.principal[axis])
                / self.focal[axis]
        };
        let mut largest = 0.0f64;
        for k in 0..=BORDER_INTERVALS {
            for (u, v) in [(k, 0), (k, BORDER_INTERVALS), (0, k), (BORDER_INTERVALS, k)] {
                let (x, y) = (normalised(u, size.0, 0), normalised(v, size.1, 1));
                let (xd, yd) = self.distort(x, y);
                largest = largest.max((xd - x).hypot(yd - y));
            }
        }
        largest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ray_inverts_the_distortion() {
        let lens = Lens {
            focal: [2000.0, 2010.0],
            principal: [640.0, 500.0],
            distortion: [-0.2, 0.1, 1e-3, -2e-3, 0.05],
        };
        let (x, y) = lens.ray(12.0, 900.0);
        let (xd, yd) = lens.distort(x, y);
        assert!((xd * 2000.0 + 640.0 - 12.0).abs() < 1e-8);
        assert!((yd * 2010.0 + 500.0 - 900.0).abs() < 1e-8);
    }
}
