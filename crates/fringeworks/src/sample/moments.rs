//! Second moments of the samples of a set, and how far pixels lie from the space they span.

use super::dot;
use crate::decode::Sample;
use crate::{Error, check_length, check_value};

/// The samples of some pixels, one row per frame.
pub fn gather<T: Sample>(planes: &[&[T]], pixels: &[i64]) -> Result<Vec<Vec<f64>>, Error> {
    let mut rows = Vec::with_capacity(planes.len());
    for plane in planes {
        let known = pixels.iter().all(|i| (*i as u64) < plane.len() as u64);
        check_value("pixels", known, "indices of the sample", plane.len())?;
        let row = pixels.iter().map(|i| f64::from(plane[*i as usize].value()));
        rows.push(row.collect());
    }
    Ok(rows)
}

/// Sums of the products of all pairs of rows, (N, N).
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
pub fn moments(rows: &[Vec<f64>]) -> Vec<f64> {
    let n = rows.len();
    let mut out = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let sum = dot(&rows[i], &rows[j]);
            out[i * n + j] = sum;
            out[j * n + i] = sum;
        }
    }
    out
}

/// Square of every pixel's part along some unit vectors, which are rows of `across`.
pub fn squares(rows: &[Vec<f64>], across: &[f64]) -> Result<Vec<f64>, Error> {
    let pixels = rows.first().map_or(0, Vec::len);
    let whole = across.len() / rows.len().max(1) * rows.len();
    check_length("across", across.len(), whole)?;
    let mut out = vec![0.0; pixels];
    for vector in across.chunks_exact(rows.len().max(1)) {
        add_squares(rows, vector, &mut out);
    }
    Ok(out)
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn add_squares(rows: &[Vec<f64>], vector: &[f64], out: &mut [f64]) {
    let mut part = vec![0.0; out.len()];
    for (row, weight) in rows.iter().zip(vector) {
        for (sum, value) in part.iter_mut().zip(row) {
            *sum += weight * value;
        }
    }
    for (square, value) in out.iter_mut().zip(&part) {
        *square += value * value;
    }
}
