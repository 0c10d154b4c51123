//! Envelopes of a row: natural cubic splines through its maxima and through its minima.

/// Extrema that are mirrored beyond each end of the row.
const MIRRORED: usize = 2;

/// Knots of one envelope and its spline, re-used from sift to sift.
#[derive(Default)]
struct Line {
    x: Vec<f64>,
    y: Vec<f64>,
    /// Second derivatives at the knots.
    bend: Vec<f64>,
    factor: Vec<f64>,
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

    /// Collect the extrema of a row; false where it has at most two, and thus no mode.
    ///
    /// A plateau counts once, in its middle. Beyond the ends the row is mirrored, about its last
    /// extremum's side or about the end sample itself where that lies outside the envelope
    /// (Rilling, Flandrin, Gonçalves, 2003).
    pub fn find(&mut self, row: &[f64]) -> bool {
        self.maxima.clear();
        self.minima.clear();
        let mut rising: Option<bool> = None;
        let mut turn = 0;
        for i in 1..row.len() {
            if row[i] == row[i - 1] {
                continue;
            }
            let up = row[i] > row[i - 1];
            match rising {
                Some(before) if before != up => {
                    // The row has been level since `turn`.
                    let middle = 0.5 * (turn + i - 1) as f64;
                    let line = if up {
                        &mut self.minima
                    } else {
                        &mut self.maxima
                    };
                    line.push(middle, row[i - 1]);
                }
                _ => {}
            }
            rising = Some(up);
            turn = i;
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

    pub fn draw(&mut self) {
        self.maxima.spline(&mut self.upper);
        self.minima.spline(&mut self.lower);
    }

    /// Both criteria of an intrinsic mode function, for the row whose envelopes were drawn.
    pub fn is_imf(&self, row: &[f64], flat: f64) -> bool {
        let (mut mean, mut whole) = (0.0, 0.0);
        for ((v, u), l) in row.iter().zip(&self.upper).zip(&self.lower) {
            let m = 0.5 * (u + l);
            mean += m * m;
            whole += v * v;
        }
        if mean > flat * flat * whole {
            return false;
        }
        let crossings = row
            .windows(2)
            .filter(|p| (p[0] > 0.0 && p[1] <= 0.0) || (p[0] < 0.0 && p[1] >= 0.0))
            .count();
        self.extrema.abs_diff(crossings) <= 1
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

    /// Put the first and last extrema beyond the row's ends as well. `side` is 1 for maxima.
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

    /// Values of the natural cubic spline through the knots at 0, 1, 2 …
    fn spline(&mut self, out: &mut [f64]) {
        let (x, y) = (&self.x, &self.y);
        let n = x.len();
        if n < 2 {
            out.fill(y.first().copied().unwrap_or(0.0));
            return;
        }
        self.bend.clear();
        self.bend.resize(n, 0.0);
        self.factor.clear();
        self.factor.resize(n, 0.0);
        let (bend, factor) = (&mut self.bend, &mut self.factor);
        let mut h0 = x[1] - x[0];
        let mut s0 = (y[1] - y[0]) / h0;
        for i in 1..n - 1 {
            let h1 = x[i + 1] - x[i];
            let s1 = (y[i + 1] - y[i]) / h1;
            let pivot = 1.0 / (2.0 * (h0 + h1) - h0 * factor[i - 1]);
            factor[i] = h1 * pivot;
            bend[i] = (6.0 * (s1 - s0) - h0 * bend[i - 1]) * pivot;
            (h0, s0) = (h1, s1);
        }
        for i in (1..n - 1).rev() {
            bend[i] -= factor[i] * bend[i + 1];
        }
        let mut from = 0;
        for k in 0..n - 1 {
            let (a, b) = (x[k], x[k + 1]);
            let to = if k + 2 == n {
                out.len()
            } else {
                // Samples up to, not including, the next knot.
                (b.ceil().max(0.0) as usize).min(out.len())
            };
            if from >= to {
                continue;
            }
            let h = b - a;
            let c1 = (y[k + 1] - y[k]) / h - h * (2.0 * bend[k] + bend[k + 1]) / 6.0;
            let c2 = 0.5 * bend[k];
            let c3 = (bend[k + 1] - bend[k]) / (6.0 * h);
            for (i, v) in out[from..to].iter_mut().enumerate() {
                let t = (from + i) as f64 - a;
                *v = y[k] + t * (c1 + t * (c2 + t * c3));
            }
            from = to;
        }
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
