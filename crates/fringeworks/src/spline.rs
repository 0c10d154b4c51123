//! Cubic splines in slope (Hermite) form.

/// Derivative at `x[0]` of the cubic through the first four samples of a uniform row.
fn end_slope(y0: f64, y1: f64, y2: f64, y3: f64) -> f64 {
    (-11.0 * y0 + 18.0 * y1 - 9.0 * y2 + 2.0 * y3) / 6.0
}

/// Slopes of the interpolating cubic spline of a row sampled at 0, 1, 2 …, clamped at both ends to
/// the slope of the cubic through the four outermost samples.
pub fn uniform_slopes(y: &[f64], slopes: &mut [f64], scratch: &mut [f64]) {
    let n = y.len();
    debug_assert!(n >= 4 && slopes.len() == n && scratch.len() == n);
    slopes[0] = end_slope(y[0], y[1], y[2], y[3]);
    let last = -end_slope(y[n - 1], y[n - 2], y[n - 3], y[n - 4]);
    // Thomas algorithm on m[i−1] + 4 m[i] + m[i+1] = 3 (y[i+1] − y[i−1]).
    scratch[0] = 0.0;
    for i in 1..n - 1 {
        let pivot = 1.0 / (4.0 - scratch[i - 1]);
        scratch[i] = pivot;
        slopes[i] = (3.0 * (y[i + 1] - y[i - 1]) - slopes[i - 1]) * pivot;
    }
    slopes[n - 1] = last;
    for i in (1..n - 1).rev() {
        slopes[i] -= scratch[i] * slopes[i + 1];
    }
}

/// Value and slope of the cubic between `(0, y0, m0)` and `(h, y1, m1)` at `t` in `[0, h]`.
#[inline(always)]
pub fn hermite(t: f64, h: f64, y0: f64, y1: f64, m0: f64, m1: f64) -> (f64, f64) {
    let secant = (y1 - y0) / h;
    let c2 = (3.0 * secant - 2.0 * m0 - m1) / h;
    let c3 = (m0 + m1 - 2.0 * secant) / (h * h);
    (
        y0 + t * (m0 + t * (c2 + t * c3)),
        m0 + t * (2.0 * c2 + 3.0 * t * c3),
    )
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
            // The form that does not cancel; one root is q/a, the other m0/q.
            let q = -0.5 * (b + discriminant.sqrt().copysign(b));
            [q / a, m0 / q]
        };
        roots
            .into_iter()
            .filter(|t| (0.0..=1.0).contains(t))
            .map(move |t| k as f64 + t)
    }
}

/// An interpolating cubic spline y(x) over strictly increasing x, with clamped end slopes.
pub struct Spline {
    pub x: Vec<f64>,
    pub y: Vec<f64>,
    slopes: Vec<f64>,
}

impl Spline {
    pub fn clamped(x: Vec<f64>, y: Vec<f64>, first: f64, last: f64) -> Self {
        let n = x.len();
        let mut slopes = vec![0.0; n];
        let mut upper = vec![0.0; n];
        slopes[0] = first;
        for i in 1..n - 1 {
            let (h0, h1) = (x[i] - x[i - 1], x[i + 1] - x[i]);
            // m[i−1]/h0 + 2 (1/h0 + 1/h1) m[i] + m[i+1]/h1 = 3 (Δ0/h0 + Δ1/h1), times h0 h1.
            let (s0, s1) = ((y[i] - y[i - 1]) / h0, (y[i + 1] - y[i]) / h1);
            let pivot = 1.0 / (2.0 * (h0 + h1) - h1 * upper[i - 1]);
            upper[i] = h0 * pivot;
            slopes[i] = (3.0 * (s0 * h1 + s1 * h0) - h1 * slopes[i - 1]) * pivot;
        }
        slopes[n - 1] = last;
        for i in (1..n - 1).rev() {
            slopes[i] -= upper[i] * slopes[i + 1];
        }
        Self { x, y, slopes }
    }

    /// Value at `x`, which must lie in the range of the knots.
    pub fn at(&self, x: f64) -> f64 {
        let k = self
            .x
            .partition_point(|knot| *knot <= x)
            .clamp(1, self.x.len() - 1)
            - 1;
        hermite(
            x - self.x[k],
            self.x[k + 1] - self.x[k],
            self.y[k],
            self.y[k + 1],
            self.slopes[k],
            self.slopes[k + 1],
        )
        .0
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
        let (mut slopes, mut scratch) = (vec![0.0; 12], vec![0.0; 12]);
        uniform_slopes(&y, &mut slopes, &mut scratch);
        let row = RowSpline {
            y: &y,
            slopes: &slopes,
        };
        for x in [0.0, 0.3, 5.5, 10.99, 11.0] {
            assert!((row.at(x).0 - f(x)).abs() < 1e-10);
            assert!((row.at(x).1 - df(x)).abs() < 1e-10);
        }
        let x: Vec<f64> = [0.0, 0.7, 2.0, 2.1, 5.0].to_vec();
        let values = x.iter().map(|v| f(*v)).collect();
        let spline = Spline::clamped(x, values, df(0.0), df(5.0));
        for v in [0.0, 0.1, 2.05, 4.9, 5.0] {
            assert!((spline.at(v) - f(v)).abs() < 1e-10);
        }
    }

    #[test]
    fn finds_the_top_of_a_parabola() {
        let y: Vec<f64> = (0..9).map(|i| -(i as f64 - 4.3).powi(2)).collect();
        let (mut slopes, mut scratch) = (vec![0.0; 9], vec![0.0; 9]);
        uniform_slopes(&y, &mut slopes, &mut scratch);
        let row = RowSpline {
            y: &y,
            slopes: &slopes,
        };
        let roots: Vec<f64> = row.stationary_points(4).collect();
        assert!(roots.iter().any(|r| (r - 4.3).abs() < 1e-9), "{roots:?}");
    }
}
