//! Envelopes of a row: natural cubic splines through its maxima and through its minima.

/// Extrema that are mirrored beyond each end of the row.
///
/// Two knots beyond the end keep the natural spline's free end away from the row (Rilling et al.,
/// 2003).
const MIRRORED: usize = 2;

/// Knots of one envelope and its spline; the memory is used again from sift to sift.
#[derive(Default)]
struct Line {
    x: Vec<f64>,
    y: Vec<f64>,
    /// Second derivatives at the knots, divided by 6.
    bend: Vec<f64>,
    /// Factors of the elimination.
    factor: Vec<f64>,
    /// Inverse distance to the next knot.
    per: Vec<f64>,
}

/// Extrema of a row and the envelopes through them.
pub struct Envelopes {
    maxima: Line,
    minima: Line,
    pub upper: Vec<f64>,
    pub lower: Vec<f64>,
    extrema: usize,
}

impl Envelopes {
    pub fn new(width: usize) -> Self {
        Self {
            maxima: Line::default(),
            minima: Line::default(),
            upper: vec![0.0; width],
            lower: vec![0.0; width],
            extrema: 0,
        }
    }

    /// Collect the extrema of a row. Returns false where it has at most two, and thus no mode.
    ///
    /// A plateau counts once, in its middle. Beyond the ends the extrema are mirrored about the end
    /// sample. An end sample that lies outside the envelope becomes a knot itself (Rilling, Flandrin,
    /// Gonçalves, 2003).
    pub fn find(&mut self, row: &[f64]) -> bool {
        self.maxima.clear();
        self.minima.clear();
        if !self.find_turns(row) {
            self.find_plateaus(row);
        }
        self.extrema = self.maxima.x.len() + self.minima.x.len();
        if self.extrema <= 2 {
            return false;
        }
        let last = row.len() - 1;
        self.maxima.mirror(row[0], row[last], last as f64, 1.0);
        self.minima.mirror(row[0], row[last], last as f64, -1.0);
        true
    }

    /// Extrema of a row without equal neighbours; returns false where it has equal neighbours.
    fn find_turns(&mut self, row: &[f64]) -> bool {
        for (i, p) in row.windows(3).enumerate() {
            let (before, after) = (p[1] - p[0], p[2] - p[1]);
            if before * after > 0.0 {
                continue;
            }
            if before == 0.0 || after == 0.0 {
                self.maxima.clear();
                self.minima.clear();
                return false;
            }
            // The product of two very small differences rounds to zero, so compare their signs.
            if (before > 0.0) != (after > 0.0) {
                let line = if before > 0.0 {
                    &mut self.maxima
                } else {
                    &mut self.minima
                };
                line.push((i + 1) as f64, p[1]);
            }
        }
        true
    }

    /// Extrema of a row with equal neighbours.
    fn find_plateaus(&mut self, row: &[f64]) {
        let mut rising: Option<bool> = None;
        let mut turn = 0;
        for i in 1..row.len() {
            if row[i] == row[i - 1] {
                continue;
            }
            let up = row[i] > row[i - 1];
            if rising.is_some_and(|before| before != up) {
                // The row is constant from `turn` on.
                let middle = 0.5 * (turn + i - 1) as f64;
                let line = if up {
                    &mut self.minima
                } else {
                    &mut self.maxima
                };
                line.push(middle, row[i - 1]);
            }
            rising = Some(up);
            turn = i;
        }
    }

    /// Compute both envelopes through the extrema found.
    pub fn draw(&mut self) {
        solve(&mut self.maxima, &mut self.minima);
        self.maxima.evaluate(&mut self.upper);
        self.minima.evaluate(&mut self.lower);
    }

    /// Criterion II for the row whose envelopes were drawn: their mean is nearly zero.
    pub fn is_flat(&self, row: &[f64], flat: f64) -> bool {
        // Four independent sums of each kind, so that additions do not wait for one another.
        let (mut mean, mut whole) = ([0.0; 4], [0.0; 4]);
        let ends = self.upper.chunks(4).zip(self.lower.chunks(4));
        for (v, (u, l)) in row.chunks(4).zip(ends) {
            for k in 0..v.len() {
                let m = 0.5 * (u[k] + l[k]);
                mean[k] += m * m;
                whole[k] += v[k] * v[k];
            }
        }
        let mean: f64 = mean.iter().sum();
        let whole: f64 = whole.iter().sum();
        mean <= flat * flat * whole
    }

    /// Criterion I: the numbers of extrema and of zero crossings differ by at most one.
    pub fn is_even(&self, row: &[f64]) -> bool {
        let mut crossings = 0u32;
        for p in row.windows(2) {
            crossings += (((p[0] > 0.0) & (p[1] <= 0.0)) | ((p[0] < 0.0) & (p[1] >= 0.0))) as u32;
        }
        self.extrema.abs_diff(crossings as usize) <= 1
    }

    pub fn subtract_mean(&self, row: &mut [f64]) {
        for ((v, u), l) in row.iter_mut().zip(&self.upper).zip(&self.lower) {
            *v -= 0.5 * (u + l);
        }
    }
}

impl Line {
    fn clear(&mut self) {
        self.x.clear();
        self.y.clear();
    }

    fn push(&mut self, x: f64, y: f64) {
        self.x.push(x);
        self.y.push(y);
    }

    /// Mirror the first and last extrema beyond the row's ends. `side` is 1 for maxima and −1 for
    /// minima.
    fn mirror(&mut self, first: f64, last: f64, end: f64, side: f64) {
        let n = self.x.len();
        // An end sample outside the envelope is an extremum of the mirrored row.
        if n == 0 || side * (first - self.y[0]) > 0.0 {
            self.insert_front(0.0, first);
        }
        let n = self.x.len();
        if side * (last - self.y[n - 1]) > 0.0 {
            self.push(end, last);
        }
        let n = self.x.len();
        let begin = (self.x[0] == 0.0) as usize;
        let front: Vec<(f64, f64)> = (begin..(begin + MIRRORED).min(n))
            .map(|k| (-self.x[k], self.y[k]))
            .collect();
        let skip = (self.x[n - 1] == end) as usize;
        let back: Vec<(f64, f64)> = (0..n - skip)
            .rev()
            .take(MIRRORED)
            .map(|k| (2.0 * end - self.x[k], self.y[k]))
            .collect();
        for (x, y) in front {
            self.insert_front(x, y);
        }
        for (x, y) in back {
            self.push(x, y);
        }
    }

    fn insert_front(&mut self, x: f64, y: f64) {
        self.x.insert(0, x);
        self.y.insert(0, y);
    }

    /// Set the arrays of the elimination to the number of knots.
    fn prepare(&mut self) {
        let n = self.x.len();
        self.bend.clear();
        self.bend.resize(n, 0.0);
        self.factor.clear();
        self.factor.resize(n, 0.0);
        self.per.clear();
        self.per
            .extend(self.x.windows(2).map(|p| 1.0 / (p[1] - p[0])));
    }

    /// One step of the elimination, for knot `i`.
    #[inline(always)]
    fn eliminate(&mut self, i: usize) {
        let (h0, h1) = (self.x[i] - self.x[i - 1], self.x[i + 1] - self.x[i]);
        let s0 = (self.y[i] - self.y[i - 1]) * self.per[i - 1];
        let s1 = (self.y[i + 1] - self.y[i]) * self.per[i];
        let pivot = 1.0 / (2.0 * (h0 + h1) - h0 * self.factor[i - 1]);
        self.factor[i] = h1 * pivot;
        self.bend[i] = (s1 - s0 - h0 * self.bend[i - 1]) * pivot;
    }

    #[inline(always)]
    fn substitute(&mut self, i: usize) {
        self.bend[i] -= self.factor[i] * self.bend[i + 1];
    }

    /// Values of the spline at 0, 1, 2 …
    fn evaluate(&self, out: &mut [f64]) {
        let (x, y, bend) = (&self.x[..], &self.y[..], &self.bend[..]);
        let n = x.len();
        if n < 2 {
            out.fill(y.first().copied().unwrap_or(0.0));
            return;
        }
        let mut from = 0;
        for k in 0..n - 1 {
            let (a, b) = (x[k], x[k + 1]);
            let to = if k + 2 == n {
                out.len()
            } else {
                // Samples before the next knot; knots lie on multiples of ½.
                let next = b as usize;
                (next + (next as f64 != b) as usize).min(out.len()) * (b > 0.0) as usize
            };
            if from >= to {
                continue;
            }
            let h = b - a;
            let c0 = y[k];
            let c1 = (y[k + 1] - y[k]) * self.per[k] - h * (2.0 * bend[k] + bend[k + 1]);
            let c2 = 3.0 * bend[k];
            let c3 = (bend[k + 1] - bend[k]) * self.per[k];
            let mut t = from as f64 - a;
            for v in &mut out[from..to] {
                *v = c0 + t * (c1 + t * (c2 + t * c3));
                t += 1.0;
            }
            from = to;
        }
    }
}

/// Second derivatives of the natural cubic splines through two lines' knots.
///
/// The lines have about the same number of knots. They are solved side by side, so that the divisions
/// of one hide those of the other.
fn solve(a: &mut Line, b: &mut Line) {
    a.prepare();
    b.prepare();
    let (na, nb) = (a.x.len(), b.x.len());
    let both = na.min(nb).saturating_sub(1);
    for i in 1..both {
        a.eliminate(i);
        b.eliminate(i);
    }
    for i in both.max(1)..na.saturating_sub(1) {
        a.eliminate(i);
    }
    for i in both.max(1)..nb.saturating_sub(1) {
        b.eliminate(i);
    }
    for i in (1..na.saturating_sub(1)).rev() {
        a.substitute(i);
    }
    for i in (1..nb.saturating_sub(1)).rev() {
        b.substitute(i);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn envelopes_of_a_modulated_wave() {
        let n = 400;
        let size = |x: f64| 2.0 + (0.01 * x).sin();
        let row: Vec<f64> = (0..n)
            .map(|x| 5.0 + size(x as f64) * (0.7 * x as f64).cos())
            .collect();
        let mut found = Envelopes::new(n);
        assert!(found.find(&row));
        found.draw();
        for x in 0..n {
            assert!((found.upper[x] - 5.0 - size(x as f64)).abs() < 0.2, "{x}");
            assert!((found.lower[x] - 5.0 + size(x as f64)).abs() < 0.2, "{x}");
        }
    }
}
