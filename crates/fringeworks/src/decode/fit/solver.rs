//! Normal equations of I_n = A + c cos δ_n + s sin δ_n (Bruning 1974; Greivenkamp 1984; theory §5).

use super::Fitted;
use super::angle::angle;
use super::set::PhaseSet;
use super::sums::SumsAt;
use crate::decode::BLOCK_PIXELS;

/// Least determinant of the normal equations, as a share of that of equal steps.
///
/// Below, the kept samples are so close in phase that noise decides the result. 0.02 allows a
/// standard deviation of about seven times (1/√0.02) that of equal steps: an empirical choice
/// between lost pixels and noisy ones.
const MIN_DETERMINANT: f64 = 0.02;

/// Off-diagonal entries of the inverse that count as zero: the rounding of f64 cosines.
const BALANCED_TOLERANCE: f64 = 1e-9;

/// Skew coefficients that count as zero: a little above the rounding of f32.
const SKEW_TOLERANCE: f32 = 1e-6;

/// A matrix over (A, c, s).
pub type Matrix = [[f64; 3]; 3];

/// How the sums of the kept frames give the amplitudes (A, c, s).
pub struct Solution {
    /// From Σ I, Σ I cos δ and Σ I sin δ to the amplitudes.
    pub inverse: Matrix,
    /// Covariance of the amplitudes, for noise of one count².
    pub covariance: Matrix,
}

/// Solution for the kept frames, one bit each; `None` where they do not determine the phase.
///
/// A frame shows `design` · (A, c, s): (1, cos δ, sin δ) as planned, or what was found in the frames.
/// The sums are those of the planned shifts in both cases, so that the inner loop does not depend on
/// what was found.
pub fn solution(
    kept: u64,
    planned: impl Fn(usize) -> [f64; 3],
    design: impl Fn(usize) -> [f64; 3],
) -> Option<Solution> {
    let (mut normal, mut gram) = ([[0.0f64; 3]; 3], [[0.0f64; 3]; 3]);
    for n in (0..64).filter(|n| kept >> n & 1 == 1) {
        let (row, real) = (planned(n), design(n));
        for i in 0..3 {
            for j in 0..3 {
                normal[i][j] += row[i] * real[j];
                gram[i][j] += row[i] * row[j];
            }
        }
    }
    let inverse = invert(&normal, f64::from(kept.count_ones()))?;
    let mut half = [[0.0; 3]; 3];
    let mut covariance = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            half[i][j] = (0..3).map(|k| inverse[i][k] * gram[k][j]).sum();
        }
    }
    for i in 0..3 {
        for j in 0..3 {
            covariance[i][j] = (0..3).map(|k| half[i][k] * inverse[j][k]).sum();
        }
    }
    Some(Solution {
        inverse,
        covariance,
    })
}

/// Inverse of the matrix of the normal equations of some frames; `None` where they hardly determine
/// the unknowns.
pub fn invert(g: &Matrix, frames: f64) -> Option<Matrix> {
    let (inverse, determinant) = inverse(g);
    // N equal steps have the determinant N · N/2 · N/2.
    let equal = frames.powi(3) / 4.0;
    (determinant > MIN_DETERMINANT * equal).then_some(inverse)
}

/// Inverse of a matrix, and its determinant.
pub fn inverse(g: &Matrix) -> (Matrix, f64) {
    let minor = |i: usize, j: usize| {
        let (a, b) = ((i + 1) % 3, (i + 2) % 3);
        let (c, d) = ((j + 1) % 3, (j + 2) % 3);
        g[a][c] * g[b][d] - g[a][d] * g[b][c]
    };
    let determinant = (0..3).map(|j| g[0][j] * minor(0, j)).sum::<f64>();
    let mut out = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            out[i][j] = minor(j, i) / determinant;
        }
    }
    (out, determinant)
}

/// Solver of the normal equations of all samples of a set.
#[derive(Clone)]
pub struct Solver {
    pub inverse: [[f32; 3]; 3],
    /// Covariance of the amplitudes, for noise of one count².
    pub covariance: [[f32; 3]; 3],
    /// Whether the off-diagonal terms vanish: equal steps over whole turns, as planned.
    pub balanced: bool,
    /// Correction from the mean brightness to the one that shot noise sees: coefficients of c³, c²s,
    /// cs² and s³ over B². Non-zero only for three equal steps or for unequal ones.
    pub skew: Option<[f32; 4]>,
}

impl Solver {
    /// The solver for these shifts (rad) and what the frames really show of (A, c, s); `None` where
    /// they do not determine the phase.
    pub fn new(shifts: &[f64], design: &[[f64; 3]]) -> Option<Self> {
        let all = u64::MAX >> (64 - shifts.len());
        let planned = |n: usize| planned_row(shifts[n]);
        let Solution {
            inverse,
            covariance,
        } = solution(all, planned, |n| design[n])?;
        let off_diagonal = |i: usize, j: usize| inverse[i][j].abs().max(inverse[j][i].abs());
        let largest = off_diagonal(0, 1)
            .max(off_diagonal(0, 2))
            .max(off_diagonal(1, 2));
        let balanced = largest < BALANCED_TOLERANCE
            && (inverse[1][1] - inverse[2][2]).abs() < BALANCED_TOLERANCE;
        let skew = skew(&inverse, shifts);
        Some(Self {
            inverse: inverse.map(|row| row.map(|v| v as f32)),
            covariance: covariance.map(|row| row.map(|v| v as f32)),
            balanced,
            skew: skew
                .iter()
                .any(|v| v.abs() > SKEW_TOLERANCE)
                .then_some(skew),
        })
    }
}

/// What a frame of a shift shows of (A, c, s).
pub fn planned_row(shift: f64) -> [f64; 3] {
    [1.0, shift.cos(), shift.sin()]
}

/// Coefficients of [`Solver::skew`].
///
/// The phase's variance sums the squared weight of every sample times the brightness of that
/// sample. Weights are linear in c and s over B², and the brightness is linear in c and s, so the
/// part beyond the mean brightness is cubic in c and s.
fn skew(inverse: &Matrix, shifts: &[f64]) -> [f32; 4] {
    let (mut cubic, mut quadratic) = ([0.0f64; 4], [0.0f64; 3]);
    for shift in shifts {
        let (k, q) = (shift.cos(), shift.sin());
        let wc = inverse[1][0] + inverse[1][1] * k + inverse[1][2] * q;
        let ws = inverse[2][0] + inverse[2][1] * k + inverse[2][2] * q;
        let square = [ws * ws, -2.0 * ws * wc, wc * wc];
        for i in 0..3 {
            quadratic[i] += square[i];
            cubic[i] += square[i] * k;
            cubic[i + 1] += square[i] * q;
        }
    }
    let scale = 0.5 * (quadratic[0] + quadratic[2]);
    cubic.map(|v| (v / scale) as f32)
}

/// Phase, precision, background and power of a block from its sums, and its brightness if `shot`.
#[inline(always)]
pub fn solve(set: &PhaseSet, sums: &impl SumsAt, shot: bool, out: &mut Fitted) {
    match (set.solver.balanced, set.solver.skew.is_some() && shot) {
        (true, false) if shot => fit_block::<true, false, true>(set, sums, out),
        (true, false) => fit_block::<true, false, false>(set, sums, out),
        (true, true) => fit_block::<true, true, true>(set, sums, out),
        (false, _) => fit_block::<false, true, true>(set, sums, out),
    }
}

/// The same, with what is known of the set as constants of the compilation.
#[inline(always)]
fn fit_block<const BALANCED: bool, const SKEW: bool, const SHOT: bool>(
    set: &PhaseSet,
    sums: &impl SumsAt,
    out: &mut Fitted,
) {
    // Copies: what might change in memory between two pixels keeps a loop from using vectors.
    let (m, v) = (set.solver.inverse, set.solver.covariance);
    let (skew, offset) = (set.solver.skew.unwrap_or_default(), set.offset);
    let per_power = 1.0 / v[1][1];
    for i in 0..BLOCK_PIXELS {
        let (mut a, mut c, mut s) = amplitudes::<BALANCED>(&m, sums.at(i));
        if !BALANCED {
            (a, c, s) = (a - offset[0], c - offset[1], s - offset[2]);
        }
        let power = c * c + s * s;
        out.turns[i] = angle(s, c);
        out.precision[i] = if BALANCED {
            power * per_power
        } else {
            power * power / (v[2][2] * (c * c) + v[1][1] * (s * s) - 2.0 * v[1][2] * (c * s))
        };
        if SHOT {
            let cubic = c * c * (skew[0] * c + skew[1] * s) + s * s * (skew[2] * c + skew[3] * s);
            out.brightness[i] = if SKEW { a + cubic / power } else { a };
        }
        out.background[i] = a;
        out.power[i] = power;
    }
}

/// A, c and s of I = A + c cos δ + s sin δ from the sums of a pixel.
#[inline(always)]
pub fn amplitudes<const BALANCED: bool>(m: &[[f32; 3]; 3], [p, q, r]: [f32; 3]) -> (f32, f32, f32) {
    if BALANCED {
        (p * m[0][0], q * m[1][1], r * m[1][1])
    } else {
        let row = |k: usize| m[k][0] * p + m[k][1] * q + m[k][2] * r;
        (row(0), row(1), row(2))
    }
}
