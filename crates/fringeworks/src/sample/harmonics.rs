//! Sums that the harmonics of the phase error are fitted by.

use super::dot;
use super::waves::{add_products, harmonics};
use crate::{Error, check_length};

/// Pixels that are computed together, so that their harmonics stay in the first cache.
const BLOCK: usize = 256;

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
/// `phase` holds windows of equal `length`, rad. `basis` are orthonormal rows of that length, which
/// describe the surface. The values are the phases themselves, less what the surface explains.
pub fn of_windows(
    phase: &[f64],
    length: usize,
    basis: &[f64],
    orders: &[usize],
) -> Result<Sums, Error> {
    let windows = phase.len() / length.max(1);
    check_length("phase", phase.len(), windows * length)?;
    check_length("basis", basis.len() % length.max(1), 0)?;
    let functions = 2 * orders.len();
    let mut sums = Sums::of(windows, functions);
    let mut rows = vec![0.0; functions * length];
    let mut errors = vec![0.0; length];
    for (k, window) in phase.chunks_exact(length.max(1)).enumerate() {
        errors.copy_from_slice(window);
        let normal = &mut sums.normal[k * functions * functions..][..functions * functions];
        let projected = &mut sums.projected[k * functions..][..functions];
        sums.power[k] = add_window(&mut errors, basis, orders, &mut rows, normal, projected);
    }
    Ok(sums)
}

/// Add the sums of a window, and return that of its squared errors.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn add_window(
    errors: &mut [f64],
    basis: &[f64],
    orders: &[usize],
    rows: &mut [f64],
    normal: &mut [f64],
    projected: &mut [f64],
) -> f64 {
    let n = errors.len();
    harmonics(errors, orders, rows);
    subtract_surface(errors, basis);
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

/// Sums over pixels, for a constant and the harmonics of their phases, rad.
///
/// Only pixels count whose value differs by at most `most` from the series with these coefficients:
/// a constant, then cosine and sine of every order.
pub fn of_pixels(
    phase: &[f64],
    values: &[f64],
    orders: &[usize],
    coefficients: &[f64],
    most: f64,
) -> Result<Sums, Error> {
    let functions = 1 + 2 * orders.len();
    check_length("values", values.len(), phase.len())?;
    check_length("coefficients", coefficients.len(), functions)?;
    let mut sums = Sums::of(1, functions);
    let mut rows = vec![0.0; functions * BLOCK];
    for (phase, values) in phase.chunks(BLOCK).zip(values.chunks(BLOCK)) {
        add_block(
            phase,
            values,
            orders,
            coefficients,
            most,
            &mut rows,
            &mut sums,
        );
    }
    Ok(sums)
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn add_block(
    phase: &[f64],
    values: &[f64],
    orders: &[usize],
    coefficients: &[f64],
    most: f64,
    rows: &mut [f64],
    sums: &mut Sums,
) {
    let n = phase.len();
    let rows = &mut rows[..coefficients.len() * n];
    series_rows(phase, orders, rows);
    let mut left = values.to_vec();
    subtract_series(rows, coefficients, &mut left);
    let mut kept = values.to_vec();
    let weights: Vec<f64> = left
        .iter()
        .map(|off| f64::from(off.abs() <= most))
        .collect();
    for line in rows.chunks_exact_mut(n).chain([&mut kept[..]]) {
        for (value, weight) in line.iter_mut().zip(&weights) {
            *value *= weight;
        }
    }
    add_products(rows, n, &mut sums.normal);
    for (sum, row) in sums.projected.iter_mut().zip(rows.chunks_exact(n)) {
        *sum += dot(row, &kept);
    }
    sums.power[0] += dot(&kept, &kept);
}

/// Rows of a constant and of the harmonics of phases.
#[inline(always)]
fn series_rows(phase: &[f64], orders: &[usize], rows: &mut [f64]) {
    let (constant, waves) = rows.split_at_mut(phase.len());
    constant.fill(1.0);
    harmonics(phase, orders, waves);
}

#[inline(always)]
fn subtract_series(rows: &[f64], coefficients: &[f64], left: &mut [f64]) {
    for (row, share) in rows.chunks_exact(left.len()).zip(coefficients) {
        for (value, part) in left.iter_mut().zip(row) {
            *value -= share * part;
        }
    }
}

/// The values less a series in the harmonics of the phases; see `of_pixels`.
pub fn without_series(
    phase: &[f64],
    values: &[f64],
    orders: &[usize],
    coefficients: &[f64],
) -> Result<Vec<f64>, Error> {
    check_length("values", values.len(), phase.len())?;
    check_length("coefficients", coefficients.len(), 1 + 2 * orders.len())?;
    let mut left = values.to_vec();
    for (phase, left) in phase.chunks(BLOCK).zip(left.chunks_mut(BLOCK)) {
        subtract_block(phase, orders, coefficients, left);
    }
    Ok(left)
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn subtract_block(phase: &[f64], orders: &[usize], coefficients: &[f64], left: &mut [f64]) {
    let mut rows = vec![0.0; coefficients.len() * phase.len()];
    series_rows(phase, orders, &mut rows);
    subtract_series(&rows, coefficients, left);
}
