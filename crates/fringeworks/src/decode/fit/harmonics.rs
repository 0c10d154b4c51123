//! Fit of the samples below the sensor's limit, of fringes with harmonics.

use super::set::PhaseSet;
use super::solver::{Matrix, inverse, invert};

/// Passes of Gauss and Newton's method, at most. The second harmonic of γ = 2.2 takes four.
const PASSES: usize = 8;

/// Change of A, c and s by a pass, over B, from which on the fit has settled: a tenth of the error of
/// a phase by rounding.
const SETTLED: f64 = 1e-5;

/// What the fringe of a pixel shows in one frame, and how that changes with A, c and s.
type Row = [f64; 3];

/// A, c and s, and their covariance for noise of one count², of samples of a set with harmonics;
/// `None` where they do not determine them.
///
/// A sample is I_n = x_n · (A, c, s) + Σ_k B (a_nk cos kφ + b_nk sin kφ). One that is not kept (one
/// bit each) was at least its value: it takes part where the fit would show less. Without it, the
/// harmonics of few samples have several solutions.
pub fn with_harmonics(
    set: &PhaseSet,
    kept: u64,
    value: impl Fn(usize) -> f64,
) -> Option<([f64; 3], Matrix)> {
    let mut found = amplitudes_of(set, &value);
    for _ in 0..PASSES {
        let shown = Shown::of(set, found);
        let (mut normal, mut pull, mut count) = (Matrix::default(), [0.0; 3], 0.0);
        for n in 0..set.steps() {
            let (left, row) = shown.sample(set, n, value(n));
            if kept >> n & 1 == 0 && left <= 0.0 {
                continue;
            }
            count += 1.0;
            for i in 0..3 {
                pull[i] += row[i] * left;
                for j in 0..3 {
                    normal[i][j] += row[i] * row[j];
                }
            }
        }
        let (inverse, _) = inverse(&normal);
        let step = inverse.map(|row| row[0] * pull[0] + row[1] * pull[1] + row[2] * pull[2]);
        for j in 0..3 {
            found[j] += step[j];
        }
        let size = step[0].abs().max(step[1].abs()).max(step[2].abs());
        if size <= SETTLED * found[1].hypot(found[2]) {
            return invert(&normal, count).map(|covariance| (found, covariance));
        }
    }
    None
}

/// The fit of all samples, without harmonics and offsets: the limit is the best guess of those beyond
/// it.
pub fn amplitudes_of(set: &PhaseSet, value: impl Fn(usize) -> f64) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for n in 0..set.steps() {
        let ((cosine, sine), sample) = (set.phasor(n), value(n));
        sums[0] += sample;
        sums[1] += sample * f64::from(cosine);
        sums[2] += sample * f64::from(sine);
    }
    let product = |row: [f32; 3]| (0..3).map(|j| f64::from(row[j]) * sums[j]).sum();
    set.solver.inverse.map(product)
}

/// The harmonics of a fringe.
struct Shown {
    found: [f64; 3],
    /// Cosine and sine of the phase.
    phasor: (f64, f64),
    modulation: f64,
    /// Cosine and sine of kφ for each order.
    parts: [(f64, f64); MOST_ORDERS],
}

/// Largest number of harmonics of a set.
pub const MOST_ORDERS: usize = 8;

impl Shown {
    fn of(set: &PhaseSet, found: [f64; 3]) -> Self {
        let [_, c, s] = found;
        let modulation = c.hypot(s).max(f64::MIN_POSITIVE);
        let phasor = (c / modulation, s / modulation);
        let (mut power, mut order) = (phasor, 1);
        let mut parts = [(0.0, 0.0); MOST_ORDERS];
        for (part, &wanted) in parts.iter_mut().zip(&set.harmonics.orders) {
            while order < wanted {
                power = (
                    power.0 * phasor.0 - power.1 * phasor.1,
                    power.0 * phasor.1 + power.1 * phasor.0,
                );
                order += 1;
            }
            *part = power;
        }
        Self {
            found,
            phasor,
            modulation,
            parts,
        }
    }

    /// What is left of a sample, and how what the fringe shows changes with A, c and s.
    fn sample(&self, set: &PhaseSet, n: usize, value: f64) -> (f64, Row) {
        let planned = set.design[n];
        let orders = &set.harmonics.orders;
        let shares = &set.harmonics.shares[2 * n * orders.len()..][..2 * orders.len()];
        // The sum of the harmonics over B, and its derivative after the phase.
        let (mut wave, mut slope) = (0.0, 0.0);
        for ((share, &k), (cosine, sine)) in shares.chunks_exact(2).zip(orders).zip(self.parts) {
            wave += share[0] * cosine + share[1] * sine;
            slope += f64::from(k) * (share[1] * cosine - share[0] * sine);
        }
        let shown: f64 = (0..3).map(|j| planned[j] * self.found[j]).sum();
        let (cosine, sine) = self.phasor;
        let row = [
            planned[0],
            planned[1] + cosine * wave - sine * slope,
            planned[2] + sine * wave + cosine * slope,
        ];
        (value - shown - self.modulation * wave, row)
    }
}
