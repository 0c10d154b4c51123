//! Cubic splines in slope (Hermite) form: every interval has values and slopes at its two ends.

mod clamped;

pub use clamped::{Knots, Place, Spline};

/// Derivative at `x[0]` of the cubic through the first four samples of a uniform row.
fn end_slope(y0: f64, y1: f64, y2: f64, y3: f64) -> f64 {
    (-11.0 * y0 + 18.0 * y1 - 9.0 * y2 + 2.0 * y3) / 6.0
}

/// Pivots of the Thomas algorithm for `m[i−1] + 4 m[i] + m[i+1]`, the same for all rows of a width.
pub fn uniform_pivots(n: usize) -> Vec<f64> {
    let mut pivots = vec![0.0; n];
    for i in 1..n.saturating_sub(1) {
        pivots[i] = 1.0 / (4.0 - pivots[i - 1]);
    }
    pivots
}

/// Slopes of the interpolating cubic splines of rows of equal width, sampled at 0, 1, 2 …
///
/// Both ends are clamped to the slope of the cubic through the four outermost samples. `pivots` come
/// from [`uniform_pivots`] for the rows' width. Every step of a row waits for the one before, so that
/// several rows take hardly longer than one.
pub fn uniform_slopes<const N: usize>(
    rows: [&[f64]; N],
    mut slopes: [&mut [f64]; N],
    pivots: &[f64],
) {
    let n = pivots.len();
    debug_assert!(n >= 4);
    for r in 0..N {
        let (y, m) = (rows[r], &mut slopes[r]);
        debug_assert!(y.len() == n && m.len() == n);
        m[0] = end_slope(y[0], y[1], y[2], y[3]);
        m[n - 1] = -end_slope(y[n - 1], y[n - 2], y[n - 3], y[n - 4]);
    }
    // m[i−1] + 4 m[i] + m[i+1] = 3 (y[i+1] − y[i−1])
    for i in 1..n - 1 {
        for r in 0..N {
            let (y, m) = (rows[r], &mut slopes[r]);
            m[i] = (3.0 * (y[i + 1] - y[i - 1]) - m[i - 1]) * pivots[i];
        }
    }
    for i in (1..n - 1).rev() {
        for m in &mut slopes {
            m[i] -= pivots[i] * m[i + 1];
        }
    }
}

/// Value and slope of the cubic between `(0, y0, m0)` and `(h, y1, m1)` at `t` in `[0, h]`.
#[inline(always)]
pub fn hermite(t: f64, h: f64, y0: f64, y1: f64, m0: f64, m1: f64) -> (f64, f64) {
    let per_h = 1.0 / h;
    let secant = (y1 - y0) * per_h;
    let c2 = (3.0 * secant - 2.0 * m0 - m1) * per_h;
    let c3 = (m0 + m1 - 2.0 * secant) * per_h * per_h;
    (
        y0 + t * (m0 + t * (c2 + t * c3)),
        m0 + t * (2.0 * c2 + 3.0 * t * c3),
    )
}

/// One interval of a row's spline.
pub struct Cubic {
    pub from: f64,
    pub to: f64,
    coefficients: [f64; 4],
}

impl Cubic {
    #[inline(always)]
    pub fn at(&self, x: f64) -> f64 {
        let t = x - self.from;
        let [a, b, c, d] = self.coefficients;
        a + t * (b + t * (c + t * d))
    }

    #[inline(always)]
    pub fn slope(&self, x: f64) -> f64 {
        let t = x - self.from;
        let [_, b, c, d] = self.coefficients;
        b + t * (2.0 * c + t * 3.0 * d)
    }
}

/// A row with its spline slopes.
pub struct RowSpline<'a> {
    pub y: &'a [f64],
    pub slopes: &'a [f64],
}

impl RowSpline<'_> {
    /// Value and slope at `x` in `[0, n − 1]`.
    #[inline(always)]
    pub fn at(&self, x: f64) -> (f64, f64) {
        let k = (x as usize).min(self.y.len() - 2);
        hermite(
            x - k as f64,
            1.0,
            self.y[k],
            self.y[k + 1],
            self.slopes[k],
            self.slopes[k + 1],
        )
    }

    /// The polynomial of the interval that contains `x`.
    pub fn cubic(&self, x: f64) -> Cubic {
        let k = (x as usize).min(self.y.len() - 2);
        let (m0, m1) = (self.slopes[k], self.slopes[k + 1]);
        let secant = self.y[k + 1] - self.y[k];
        Cubic {
            from: k as f64,
            to: (k + 1) as f64,
            coefficients: [
                self.y[k],
                m0,
                3.0 * secant - 2.0 * m0 - m1,
                m0 + m1 - 2.0 * secant,
            ],
        }
    }

    /// Roots of the derivative in `[k, k + 1]`, as positions.
    pub fn stationary_points(&self, k: usize) -> impl Iterator<Item = f64> {
        let (m0, m1) = (self.slopes[k], self.slopes[k + 1]);
        let secant = self.y[k + 1] - self.y[k];
        let a = 3.0 * (m0 + m1 - 2.0 * secant);
        let b = 2.0 * (3.0 * secant - 2.0 * m0 - m1);
        let discriminant = b * b - 4.0 * a * m0;
        let roots = if discriminant < 0.0 {
            [f64::NAN; 2]
        } else {
            // This form of the quadratic formula avoids cancellation; the roots are q/a and m0/q.
            let q = -0.5 * (b + discriminant.sqrt().copysign(b));
            [q / a, m0 / q]
        };
        roots
            .into_iter()
            .filter(|t| (0.0..=1.0).contains(t))
            .map(move |t| k as f64 + t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reproduces_a_cubic() {
        let f = |x: f64| 1.0 - 2.0 * x + 0.3 * x * x - 0.01 * x * x * x;
        let df = |x: f64| -2.0 + 0.6 * x - 0.03 * x * x;
        let y: Vec<f64> = (0..12).map(|i| f(i as f64)).collect();
        let mut slopes = vec![0.0; 12];
        uniform_slopes([&y], [&mut slopes], &uniform_pivots(12));
        let row = RowSpline {
            y: &y,
            slopes: &slopes,
        };
        for x in [0.0, 0.3, 5.5, 10.99, 11.0] {
            assert!((row.at(x).0 - f(x)).abs() < 1e-10);
            assert!((row.at(x).1 - df(x)).abs() < 1e-10);
        }
    }

    #[test]
    fn finds_the_top_of_a_parabola() {
        let y: Vec<f64> = (0..9).map(|i| -(i as f64 - 4.3).powi(2)).collect();
        let mut slopes = vec![0.0; 9];
        uniform_slopes([&y], [&mut slopes], &uniform_pivots(9));
        let row = RowSpline {
            y: &y,
            slopes: &slopes,
        };
        let roots: Vec<f64> = row.stationary_points(4).collect();
        assert!(roots.iter().any(|r| (r - 4.3).abs() < 1e-9), "{roots:?}");
    }
}
