//! Sums that the harmonics of the phase error are fitted by.

use super::dot;
use super::gram::add_products;
use crate::{Error, Image, check_length};
use std::f64::consts::TAU;

/// Sums of a least-squares fit.
pub struct Sums {
    /// Sums of the products of all pairs of functions, (P, P) per fit.
    pub normal: Vec<f64>,
    /// Sums of the products of every function and the values, (P,) per fit.
    pub projected: Vec<f64>,
    /// Sums of the squares of the values, one per fit.
    pub power: Vec<f64>,
}

impl Sums {
    fn of(fits: usize, functions: usize) -> Self {
        Self {
            normal: vec![0.0; fits * functions * functions],
            projected: vec![0.0; fits * functions],
            power: vec![0.0; fits],
        }
    }
}

/// Sums for every window of phases: of the harmonics, less what a smooth surface explains of them.
///
/// Rows of `phase` are windows, rad. Rows of `basis` are orthonormal functions over a window, which
/// describe the surface. The values are the phases themselves, less what the surface explains. The
/// harmonics are those of the surface: those of the phases would contain the errors of the values.
///
/// ```
/// use fringeworks::{Image, sample::window_sums};
///
/// let phase: Vec<f64> = (0..64).map(|x| 0.2 * x as f64).collect();
/// let sums = window_sums(Image::new(&phase, 2, 32)?, Image::new(&[], 0, 32)?, &[1, 2])?;
/// assert_eq!((sums.normal.len(), sums.projected.len(), sums.power.len()), (32, 8, 2));
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn window_sums(phase: Image<f64>, basis: Image<f64>, orders: &[usize]) -> Result<Sums, Error> {
    let (windows, length) = phase.shape();
    check_length("basis", basis.width(), length)?;
    let functions = 2 * orders.len();
    let mut sums = Sums::of(windows, functions);
    let mut rows = vec![0.0; functions * length];
    let (mut errors, mut surface) = (vec![0.0; length], vec![0.0; length]);
    for (k, window) in phase.chunks_exact(length.max(1)).enumerate() {
        errors.copy_from_slice(window);
        subtract_surface(&mut errors, &basis);
        for (smooth, (phase, error)) in surface.iter_mut().zip(window.iter().zip(&errors)) {
            *smooth = phase - error;
        }
        harmonics(&surface, orders, &mut rows);
        let normal = &mut sums.normal[k * functions * functions..][..functions * functions];
        let projected = &mut sums.projected[k * functions..][..functions];
        sums.power[k] = add_window(&errors, &basis, &mut rows, normal, projected);
    }
    Ok(sums)
}

/// Add the sums of a window, from rows of harmonics, and return that of its squared errors.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn add_window(
    errors: &[f64],
    basis: &[f64],
    rows: &mut [f64],
    normal: &mut [f64],
    projected: &mut [f64],
) -> f64 {
    let n = errors.len();
    for row in rows.chunks_exact_mut(n) {
        subtract_surface(row, basis);
    }
    add_products(rows, n, normal);
    for (sum, row) in projected.iter_mut().zip(rows.chunks_exact(n)) {
        *sum = dot(row, errors);
    }
    dot(errors, errors)
}

/// Subtract what the rows of a basis explain.
#[inline(always)]
fn subtract_surface(values: &mut [f64], basis: &[f64]) {
    let n = values.len();
    for shape in basis.chunks_exact(n) {
        let share = dot(values, shape);
        for (value, part) in values.iter_mut().zip(shape) {
            *value -= share * part;
        }
    }
}

/// Coefficients of sin x / x and cos x in x², for |x| ≤ π/4: the terms of their series. The first one
/// that is left out is below 5e-17.
const SINE: [f64; 8] = [
    1.0,
    -1.0 / 6.0,
    1.0 / 120.0,
    -1.0 / 5_040.0,
    1.0 / 362_880.0,
    -1.0 / 39_916_800.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 1_307_674_368_000.0,
];
const COSINE: [f64; 9] = [
    1.0,
    -0.5,
    1.0 / 24.0,
    -1.0 / 720.0,
    1.0 / 40_320.0,
    -1.0 / 3_628_800.0,
    1.0 / 479_001_600.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 20_922_789_888_000.0,
];

/// Cosine and sine of a phase in rad.
#[inline(always)]
fn wave(phase: f64) -> (f64, f64) {
    let turns = phase / TAU;
    let quarters = (4.0 * turns).round_ties_even();
    let x = TAU * (turns - 0.25 * quarters);
    let square = x * x;
    let series = |terms: &[f64]| terms.iter().rev().fold(0.0, |sum, c| sum * square + c);
    let (sine, cosine) = (x * series(&SINE), series(&COSINE));
    // Quarters modulo four: an odd one swaps both, and two of them turn each sign.
    let quarter = quarters - 4.0 * (0.25 * quarters).floor();
    let odd = (quarter == 1.0) | (quarter == 3.0);
    let (c, s) = if odd { (sine, cosine) } else { (cosine, sine) };
    let c = if (quarter == 1.0) | (quarter == 2.0) {
        -c
    } else {
        c
    };
    let s = if quarter >= 2.0 { -s } else { s };
    (c, s)
}

/// Cosine and sine of the harmonics of phases: rows of `length`, a pair per order.
///
/// Orders rise. Powers follow from products.
#[inline(always)]
pub(super) fn harmonics(phase: &[f64], orders: &[usize], out: &mut [f64]) {
    let n = phase.len();
    let (mut first, mut power) = (vec![(0.0, 0.0); n], vec![(0.0, 0.0); n]);
    for i in 0..n {
        first[i] = wave(phase[i]);
        power[i] = first[i];
    }
    let mut reached = 1;
    for (order, pair) in orders.iter().zip(out.chunks_exact_mut(2 * n)) {
        for _ in reached..*order {
            for i in 0..n {
                let ((c, s), (a, b)) = (first[i], power[i]);
                power[i] = (a * c - b * s, a * s + b * c);
            }
        }
        reached = reached.max(*order);
        let (cosine, sine) = pair.split_at_mut(n);
        for i in 0..n {
            (cosine[i], sine[i]) = power[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_are_those_of_the_library() {
        for k in -4000..4000 {
            let phase = 0.0217 * f64::from(k);
            let (c, s) = wave(phase);
            assert!((c - phase.cos()).abs() < 3e-14 && (s - phase.sin()).abs() < 3e-14);
        }
        assert_eq!(wave(0.0), (1.0, 0.0));
    }

    #[test]
    fn harmonics_are_powers() {
        let phase: Vec<f64> = (0..11).map(|k| f64::from(k) - 5.0).collect();
        let mut out = vec![0.0; 4 * phase.len()];
        harmonics(&phase, &[2, 5], &mut out);
        for (i, p) in phase.iter().enumerate() {
            assert!((out[i] - (2.0 * p).cos()).abs() < 1e-14);
            assert!((out[3 * phase.len() + i] - (5.0 * p).sin()).abs() < 1e-14);
        }
    }
}
