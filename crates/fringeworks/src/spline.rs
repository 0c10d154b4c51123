//! Cubic splines in slope (Hermite) form: every interval has values and slopes at its two ends.

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

/// Slopes of the interpolating cubic spline of a row sampled at 0, 1, 2 …
///
/// Both ends are clamped to the slope of the cubic through the four outermost samples. `pivots` come
/// from [`uniform_pivots`] for the row's width.
pub fn uniform_slopes(y: &[f64], slopes: &mut [f64], pivots: &[f64]) {
    let n = y.len();
    debug_assert!(n >= 4 && slopes.len() == n && pivots.len() == n);
    slopes[0] = end_slope(y[0], y[1], y[2], y[3]);
    let last = -end_slope(y[n - 1], y[n - 2], y[n - 3], y[n - 4]);
    // m[i−1] + 4 m[i] + m[i+1] = 3 (y[i+1] − y[i−1])
    for i in 1..n - 1 {
        slopes[i] = (3.0 * (y[i + 1] - y[i - 1]) - slopes[i - 1]) * pivots[i];
    }
    slopes[n - 1] = last;
    for i in (1..n - 1).rev() {
        slopes[i] -= pivots[i] * slopes[i + 1];
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

/// An interpolating cubic spline y(x) over strictly increasing x, with clamped end slopes.
pub struct Spline {
    x: Vec<f64>,
    y: Vec<f64>,
    slopes: Vec<f64>,
    /// First knot that may lie right of each of `BUCKETS` equal steps over the range.
    buckets: [u32; BUCKETS + 1],
    buckets_per_unit: f64,
}

/// Equal steps over a spline's range that the search for an interval starts from.
///
/// A densely sampled part has some hundred knots: 64 steps leave a few of them to each binary
/// search, in a table of 260 bytes.
const BUCKETS: usize = 64;

/// Step h and secant Δ of the interval behind a knot.
type Interval = (f64, f64);

fn interval(x: &[f64], y: &[f64], i: usize) -> Interval {
    let h = x[i + 1] - x[i];
    (h, (y[i + 1] - y[i]) / h)
}

/// Slopes of the clamped spline.
///
/// Each knot has the equation m[i−1]/h0 + 2 (1/h0 + 1/h1) m[i] + m[i+1]/h1 = 3 (Δ0/h0 + Δ1/h1), here
/// times h0 h1. Elimination runs from both ends at once: the two chains of divisions do not wait for
/// each other, which halves the time of the longest loop of GSIFA.
fn clamped_slopes(x: &[f64], y: &[f64], first: f64, last: f64) -> Vec<f64> {
    let n = x.len();
    let mut slopes = vec![0.0; n];
    slopes[0] = first;
    slopes[n - 1] = last;
    if n == 2 {
        return slopes;
    }
    let mut factor = vec![0.0; n];
    let (mut left, mut right) = eliminate(x, y, &mut slopes, &mut factor);
    while left > 1 {
        slopes[left - 1] -= factor[left - 1] * slopes[left];
        slopes[right + 1] -= factor[right + 1] * slopes[right];
        left -= 1;
        right += 1;
    }
    slopes
}

/// Eliminate from both ends and solve the middle. Returns the first solved knots of the left and of
/// the right chain.
#[inline(always)]
fn eliminate(x: &[f64], y: &[f64], slopes: &mut [f64], factor: &mut [f64]) -> (usize, usize) {
    let n = x.len();
    let (mut left, mut right) = (1, n - 2);
    let (mut from_left, mut from_right) = (interval(x, y, 0), interval(x, y, n - 2));
    while left < right {
        let (h0, s0) = from_left;
        let (h1, s1) = interval(x, y, left);
        from_left = (h1, s1);
        let (k1, t1) = from_right;
        let (k0, t0) = interval(x, y, right - 1);
        from_right = (k0, t0);
        let left_pivot = 1.0 / (2.0 * (h0 + h1) - h1 * factor[left - 1]);
        let right_pivot = 1.0 / (2.0 * (k0 + k1) - k0 * factor[right + 1]);
        factor[left] = h0 * left_pivot;
        factor[right] = k1 * right_pivot;
        slopes[left] = (3.0 * (s0 * h1 + s1 * h0) - h1 * slopes[left - 1]) * left_pivot;
        slopes[right] = (3.0 * (t0 * k1 + t1 * k0) - k0 * slopes[right + 1]) * right_pivot;
        left += 1;
        right -= 1;
    }
    if left == right {
        // An odd number of knots: the middle one has both eliminated neighbours.
        let ((h0, s0), (h1, s1)) = (from_left, from_right);
        let pivot = 2.0 * (h0 + h1) - h1 * factor[left - 1] - h0 * factor[left + 1];
        let rest = 3.0 * (s0 * h1 + s1 * h0);
        slopes[left] = (rest - h1 * slopes[left - 1] - h0 * slopes[left + 1]) / pivot;
        return (left, right);
    }
    // An even number of knots: two equations for the two knots at which the chains meet.
    let (u, l) = (factor[right], factor[left]);
    let v = slopes[right];
    slopes[right] = (v - u * slopes[left]) / (1.0 - u * l);
    slopes[left] -= l * slopes[right];
    (right, left)
}

impl Spline {
    pub fn clamped(x: Vec<f64>, y: Vec<f64>, first: f64, last: f64) -> Self {
        let n = x.len();
        let slopes = clamped_slopes(&x, &y, first, last);
        let buckets_per_unit = BUCKETS as f64 / (x[n - 1] - x[0]);
        let mut buckets = [n as u32; BUCKETS + 1];
        let mut next = 0;
        for (k, knot) in x.iter().enumerate() {
            let bucket = ((knot - x[0]) * buckets_per_unit) as usize;
            while next <= bucket.min(BUCKETS) {
                buckets[next] = k as u32;
                next += 1;
            }
        }
        Self {
            x,
            y,
            slopes,
            buckets,
            buckets_per_unit,
        }
    }

    /// Value at `x`; beyond the knots the value of the nearest end.
    pub fn at(&self, x: f64) -> f64 {
        let n = self.x.len();
        let x = x.clamp(self.x[0], self.x[n - 1]);
        let bucket = (((x - self.x[0]) * self.buckets_per_unit) as usize).min(BUCKETS - 1);
        let from = self.buckets[bucket] as usize;
        let to = (self.buckets[bucket + 1] as usize + 1).min(n);
        let right = from + self.x[from..to].partition_point(|knot| *knot <= x);
        let k = right.clamp(1, n - 1) - 1;
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
        let mut slopes = vec![0.0; 12];
        uniform_slopes(&y, &mut slopes, &uniform_pivots(12));
        let row = RowSpline {
            y: &y,
            slopes: &slopes,
        };
        for x in [0.0, 0.3, 5.5, 10.99, 11.0] {
            assert!((row.at(x).0 - f(x)).abs() < 1e-10);
            assert!((row.at(x).1 - df(x)).abs() < 1e-10);
        }
        // Odd and even numbers of knots meet differently in the middle.
        for knots in [
            vec![0.0, 5.0],
            vec![0.0, 2.0, 5.0],
            vec![0.0, 0.7, 2.0, 5.0],
            vec![0.0, 0.7, 2.0, 2.1, 5.0],
            vec![0.0, 0.1, 0.7, 2.0, 2.1, 3.0, 4.9, 5.0],
        ] {
            let values = knots.iter().map(|v| f(*v)).collect();
            let spline = Spline::clamped(knots, values, df(0.0), df(5.0));
            for v in [0.0, 0.1, 2.05, 4.9, 5.0] {
                assert!((spline.at(v) - f(v)).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn finds_the_top_of_a_parabola() {
        let y: Vec<f64> = (0..9).map(|i| -(i as f64 - 4.3).powi(2)).collect();
        let mut slopes = vec![0.0; 9];
        uniform_slopes(&y, &mut slopes, &uniform_pivots(9));
        let row = RowSpline {
            y: &y,
            slopes: &slopes,
        };
        let roots: Vec<f64> = row.stationary_points(4).collect();
        assert!(roots.iter().any(|r| (r - 4.3).abs() < 1e-9), "{roots:?}");
    }
}
