//! The spline through the knots of one envelope.

use multiversion::multiversion;

/// Extrema that are mirrored beyond each end of the row.
///
/// Two knots beyond the end keep the natural spline's free end away from the row (Rilling et al.,
/// 2003).
const MIRRORED: usize = 2;

/// Knots that the ends may add in front: mirrored extrema, and the end sample.
const FRONT: usize = MIRRORED + 1;

/// Samples that are computed together, whether the piece is as long or not: what is too much is
/// overwritten by the next piece. Fast modes have pieces of a few samples, and a loop of their length
/// would be predicted wrongly once in each.
pub const TOGETHER: usize = 8;

/// Knots of one envelope and its spline; the memory is used again from sift to sift.
pub struct Line {
    /// Positions and values, behind `FRONT` places for knots in front.
    x: Vec<f64>,
    y: Vec<f64>,
    /// Place of the first knot.
    first: usize,
    /// Second derivatives at the knots, divided by 6.
    bend: Vec<f64>,
    /// Factors of the elimination.
    factor: Vec<f64>,
    /// Inverse distance to the next knot, and the slope to it.
    per: Vec<f64>,
    slope: Vec<f64>,
}

impl Line {
    pub fn new() -> Self {
        let mut line = Self {
            x: Vec::new(),
            y: Vec::new(),
            first: FRONT,
            bend: Vec::new(),
            factor: Vec::new(),
            per: Vec::new(),
            slope: Vec::new(),
        };
        line.clear();
        line
    }

    pub fn clear(&mut self) {
        self.x.clear();
        self.x.resize(FRONT, 0.0);
        self.y.clear();
        self.y.resize(FRONT, 0.0);
        self.first = FRONT;
    }

    pub fn count(&self) -> usize {
        self.x.len() - self.first
    }

    /// Position and value of knot `k`.
    fn knot(&self, k: usize) -> (f64, f64) {
        (self.x[self.first + k], self.y[self.first + k])
    }

    #[inline(always)]
    pub fn push(&mut self, x: f64, y: f64) {
        self.x.push(x);
        self.y.push(y);
    }

    fn push_front(&mut self, x: f64, y: f64) {
        self.first -= 1;
        self.x[self.first] = x;
        self.y[self.first] = y;
    }

    /// Mirror the first and last extrema beyond the row's ends. `side` is 1 for maxima and −1 for
    /// minima.
    pub fn mirror(&mut self, first: f64, last: f64, end: f64, side: f64) {
        // An end sample outside the envelope is an extremum of the mirrored row.
        if self.count() == 0 || side * (first - self.knot(0).1) > 0.0 {
            self.push_front(0.0, first);
        }
        if side * (last - self.knot(self.count() - 1).1) > 0.0 {
            self.push(end, last);
        }
        let n = self.count();
        let begin = (self.knot(0).0 == 0.0) as usize;
        let skip = (self.knot(n - 1).0 == end) as usize;
        let (front, back) = (self.first + begin, self.first + n - skip);
        for k in 0..MIRRORED.min(n - skip) {
            let (x, y) = (self.x[back - 1 - k], self.y[back - 1 - k]);
            self.push(2.0 * end - x, y);
        }
        for k in 0..MIRRORED.min(n - begin) {
            self.push_front(-self.x[front + k], self.y[front + k]);
        }
    }

    /// Distances and slopes between the knots.
    fn prepare(&mut self) {
        let (x, y) = (&self.x[self.first..], &self.y[self.first..]);
        self.bend.clear();
        self.bend.resize(x.len(), 0.0);
        self.factor.clear();
        self.factor.resize(x.len(), 0.0);
        self.per.clear();
        self.per.extend(x.windows(2).map(|p| 1.0 / (p[1] - p[0])));
        self.slope.clear();
        let rises = y.windows(2).zip(&self.per);
        self.slope.extend(rises.map(|(p, per)| (p[1] - p[0]) * per));
    }

    /// Knots that are eliminated from the left and from the right.
    fn halves(&self) -> (usize, usize) {
        let inner = self.count().saturating_sub(2);
        (inner - inner / 2, inner / 2)
    }

    /// Eliminate knot `i`, with the neighbour before it.
    #[inline(always)]
    fn eliminate_left(&mut self, i: usize) {
        let x = &self.x[self.first..];
        let (h0, h1) = (x[i] - x[i - 1], x[i + 1] - x[i]);
        let pivot = 1.0 / (2.0 * (h0 + h1) - h0 * self.factor[i - 1]);
        let bend = self.slope[i] - self.slope[i - 1] - h0 * self.bend[i - 1];
        self.factor[i] = h1 * pivot;
        self.bend[i] = bend * pivot;
    }

    /// Eliminate knot `i`, with the neighbour behind it.
    #[inline(always)]
    fn eliminate_right(&mut self, i: usize) {
        let x = &self.x[self.first..];
        let (h0, h1) = (x[i] - x[i - 1], x[i + 1] - x[i]);
        let pivot = 1.0 / (2.0 * (h0 + h1) - h1 * self.factor[i + 1]);
        let bend = self.slope[i] - self.slope[i - 1] - h1 * self.bend[i + 1];
        self.factor[i] = h0 * pivot;
        self.bend[i] = bend * pivot;
    }

    /// Solve the two knots at which the halves meet.
    fn meet(&mut self) {
        let (left, right) = self.halves();
        let (bend, factor) = (&mut self.bend[..], &self.factor[..]);
        if right > 0 {
            let (f0, f1) = (factor[left], factor[left + 1]);
            bend[left + 1] = (bend[left + 1] - f1 * bend[left]) / (1.0 - f0 * f1);
            bend[left] -= f0 * bend[left + 1];
        }
    }

    /// Substitute the `k`-th knots to the left and to the right of where the halves meet.
    #[inline(always)]
    fn substitute(&mut self, left: usize, k: usize) {
        let (i, j) = (left - k, left + 1 + k);
        self.bend[i] -= self.factor[i] * self.bend[i + 1];
        // Where the right half is shorter, this ends at the last knot, whose factor is 0.
        self.bend[j] -= self.factor[j] * self.bend[j - 1];
    }

    /// Values of the spline at 0, 1, 2 …; `out` is longer than the row.
    pub fn evaluate(&self, width: usize, out: &mut [f64]) {
        let (x, y) = (&self.x[self.first..], &self.y[self.first..]);
        if x.len() < 2 {
            out.fill(y.first().copied().unwrap_or(0.0));
            return;
        }
        let ramp = std::array::from_fn(|k| k as f64);
        evaluate(
            x,
            y,
            &self.bend,
            [&self.per, &self.slope],
            &ramp,
            width,
            out,
        );
    }
}

/// Values at 0, 1, 2 … of a spline through knots, with what [`Line`] says of them.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn evaluate(
    x: &[f64],
    y: &[f64],
    bend: &[f64],
    [per, slope]: [&[f64]; 2],
    ramp: &[f64; TOGETHER],
    width: usize,
    out: &mut [f64],
) {
    let n = x.len();
    let (y, bend, per, slope) = (&y[..n], &bend[..n], &per[..n - 1], &slope[..n - 1]);
    let mut from = 0;
    for k in 0..n - 1 {
        let (a, b) = (x[k], x[k + 1]);
        let to = if k + 2 == n {
            width
        } else {
            // Samples before the next knot; knots lie on multiples of ½.
            let next = b.max(0.0) as usize;
            (next + (b > next as f64) as usize).min(width)
        };
        let c0 = y[k];
        let c1 = slope[k] - (b - a) * (2.0 * bend[k] + bend[k + 1]);
        let c2 = 3.0 * bend[k];
        let c3 = (bend[k + 1] - bend[k]) * per[k];
        while from < to {
            let t0 = from as f64 - a;
            let some = &mut out[from..from + TOGETHER];
            for (v, dt) in some.iter_mut().zip(ramp) {
                let t = t0 + dt;
                *v = c0 + t * (c1 + t * (c2 + t * c3));
            }
            from += TOGETHER;
        }
        from = to;
    }
}

/// Second derivatives of the natural cubic splines through two lines' knots.
///
/// The lines have about the same number of knots. They are solved side by side and from both ends, so
/// that the divisions of one chain hide those of the others.
pub fn solve(a: &mut Line, b: &mut Line) {
    a.prepare();
    b.prepare();
    let (na, nb) = (a.count(), b.count());
    let (left_a, right_a) = a.halves();
    let (left_b, right_b) = b.halves();
    let both = right_a.min(right_b);
    for i in 1..=both {
        a.eliminate_left(i);
        b.eliminate_left(i);
        a.eliminate_right(na - 1 - i);
        b.eliminate_right(nb - 1 - i);
    }
    for (line, n, left, right) in [
        (&mut *a, na, left_a, right_a),
        (&mut *b, nb, left_b, right_b),
    ] {
        for i in both + 1..=left {
            line.eliminate_left(i);
        }
        for i in both + 1..=right {
            line.eliminate_right(n - 1 - i);
        }
    }
    a.meet();
    b.meet();
    let both = left_a.min(left_b);
    for k in 1..both {
        a.substitute(left_a, k);
        b.substitute(left_b, k);
    }
    for (line, left) in [(a, left_a), (b, left_b)] {
        for k in both.max(1)..left {
            line.substitute(left, k);
        }
    }
}
