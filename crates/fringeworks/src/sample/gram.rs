//! Gram matrices: sums of the products of all pairs of rows.

use super::dot;
use crate::Image;

/// Sums of the products of all pairs of rows, (rows, rows).
///
/// ```
/// use fringeworks::{Image, sample::gram};
///
/// let rows = [1.0, 2.0, 3.0, 0.0, 1.0, -1.0];
/// assert_eq!(gram(Image::new(&rows, 2, 3)?), [14.0, -1.0, -1.0, 2.0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
#[must_use]
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
pub fn gram(rows: Image<f64>) -> Vec<f64> {
    let (count, length) = rows.shape();
    let mut sums = vec![0.0; count * count];
    add_products(&rows, length, &mut sums);
    sums
}

/// Sums of the products of all pairs of rows, added to a symmetric matrix.
#[inline(always)]
pub(super) fn add_products(rows: &[f64], length: usize, sums: &mut [f64]) {
    let row = |i: usize| &rows[i * length..][..length];
    let count = rows.len() / length.max(1);
    for i in 0..count {
        for j in 0..=i {
            let sum = dot(row(i), row(j));
            sums[i * count + j] += sum;
            if i != j {
                sums[j * count + i] += sum;
            }
        }
    }
}
