//! Extrema of a row, and its envelopes: natural cubic splines through the maxima and the minima.

use super::line::{Line, TOGETHER, solve};
use multiversion::multiversion;

/// Neighbouring samples that are compared together: the bits of a word.
const WORD: usize = u64::BITS as usize;

/// Sums that are taken side by side.
const SUMS: usize = 16;

/// Extrema of a row and the envelopes through them.
pub struct Envelopes {
    maxima: Line,
    minima: Line,
    width: usize,
    // Longer than the row by what may be computed too much.
    upper: Vec<f64>,
    lower: Vec<f64>,
    extrema: usize,
}

impl Envelopes {
    pub fn new(width: usize) -> Self {
        Self {
            maxima: Line::new(),
            minima: Line::new(),
            width,
            upper: vec![0.0; width + TOGETHER],
            lower: vec![0.0; width + TOGETHER],
            extrema: 0,
        }
    }

    pub fn upper(&self) -> &[f64] {
        &self.upper[..self.width]
    }

    pub fn lower(&self) -> &[f64] {
        &self.lower[..self.width]
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
        self.extrema = self.maxima.count() + self.minima.count();
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
        let mut rose = row.len() > 1 && row[1] > row[0];
        for start in (0..row.len() - 1).step_by(WORD) {
            let samples = &row[start..(start + WORD + 1).min(row.len())];
            let (rises, equal) = compare(samples);
            if equal {
                self.maxima.clear();
                self.minima.clear();
                return false;
            }
            // A bit for every sample at which the row turns.
            let mut turns = rises ^ (rises << 1 | u64::from(rose));
            let steps = samples.len() - 1;
            turns &= u64::MAX >> (WORD - steps);
            rose = rises >> (steps - 1) & 1 == 1;
            while turns != 0 {
                let k = turns.trailing_zeros() as usize;
                turns &= turns - 1;
                let line = if rises >> k & 1 == 1 {
                    &mut self.minima
                } else {
                    &mut self.maxima
                };
                line.push((start + k) as f64, samples[k]);
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
        self.maxima.evaluate(self.width, &mut self.upper);
        self.minima.evaluate(self.width, &mut self.lower);
    }

    /// Criterion II for the row whose envelopes were drawn: their mean is nearly zero.
    pub fn is_flat(&self, row: &[f64], flat: f64) -> bool {
        let (mean, whole) = powers(row, self.upper(), self.lower());
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
        subtract_mean(row, self.upper(), self.lower());
    }
}

/// For the first `WORD` samples, a bit that says whether the next one is larger, and whether any two
/// neighbours are equal.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma"))]
fn compare(samples: &[f64]) -> (u64, bool) {
    let (mut rises, mut equal) = (0, false);
    for (k, p) in samples.windows(2).take(WORD).enumerate() {
        rises |= u64::from(p[1] > p[0]) << k;
        equal |= p[1] == p[0];
    }
    (rises, equal)
}

/// Sums of the squares of the envelopes' mean and of the row.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn powers(row: &[f64], upper: &[f64], lower: &[f64]) -> (f64, f64) {
    // Independent sums of each kind, so that additions do not wait for one another.
    let (mut mean, mut whole) = ([0.0; SUMS], [0.0; SUMS]);
    let ends = upper.chunks(SUMS).zip(lower.chunks(SUMS));
    for (v, (u, l)) in row.chunks(SUMS).zip(ends) {
        if v.len() < SUMS {
            for k in 0..v.len() {
                add(v[k], u[k], l[k], &mut mean[k], &mut whole[k]);
            }
            break;
        }
        let (v, u, l) = (&v[..SUMS], &u[..SUMS], &l[..SUMS]);
        for k in 0..SUMS {
            add(v[k], u[k], l[k], &mut mean[k], &mut whole[k]);
        }
    }
    (mean.iter().sum(), whole.iter().sum())
}

#[inline(always)]
fn add(value: f64, upper: f64, lower: f64, mean: &mut f64, whole: &mut f64) {
    let m = 0.5 * (upper + lower);
    *mean += m * m;
    *whole += value * value;
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn subtract_mean(row: &mut [f64], upper: &[f64], lower: &[f64]) {
    for ((v, u), l) in row.iter_mut().zip(upper).zip(lower) {
        *v -= 0.5 * (u + l);
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
            assert!((found.upper()[x] - 5.0 - size(x as f64)).abs() < 0.2, "{x}");
            assert!((found.lower()[x] - 5.0 + size(x as f64)).abs() < 0.2, "{x}");
        }
    }
}
