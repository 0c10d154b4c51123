//! Gram matrices: sums of the products of all pairs of rows.

use super::LANES;
use crate::Image;

/// Columns whose products are summed together, so that all rows stay in the processor's cache.
const COLUMNS: usize = 256;

/// Rows that are multiplied with another one together, which is read once for all of them.
const TOGETHER: usize = 4;

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
    add_blocks(&rows, length, &mut sums);
    sums
}

/// Sums of the products of all pairs of long rows, added to a symmetric matrix.
#[inline(always)]
pub(super) fn add_blocks(rows: &[f64], length: usize, sums: &mut [f64]) {
    let count = rows.len() / length.max(1);
    for start in (0..length).step_by(COLUMNS) {
        let columns = start..length.min(start + COLUMNS);
        add_columns(
            |i| &rows[i * length..][..length][columns.clone()],
            count,
            sums,
        );
    }
}

/// The same of short rows.
#[inline(always)]
pub(super) fn add_products(rows: &[f64], length: usize, sums: &mut [f64]) {
    let count = rows.len() / length.max(1);
    add_columns(|i| &rows[i * length..][..length], count, sums);
}

/// The same of a few columns; `row` returns those of a row.
#[inline(always)]
fn add_columns<'a>(row: impl Fn(usize) -> &'a [f64], count: usize, sums: &mut [f64]) {
    let mut add = |i: usize, j: usize, sum: f64| {
        sums[i * count + j] += sum;
        if i != j {
            sums[j * count + i] += sum;
        }
    };
    for i in 0..count {
        let mut j = 0;
        while j + TOGETHER <= i + 1 {
            let found = dots(
                row(i),
                std::array::from_fn::<_, TOGETHER, _>(|k| row(j + k)),
            );
            for (k, sum) in found.into_iter().enumerate() {
                add(i, j + k, sum);
            }
            j += TOGETHER;
        }
        for j in j..=i {
            add(i, j, dots(row(i), [row(j)])[0]);
        }
    }
}

/// Sums of the products of a row and others of its length.
#[inline(always)]
fn dots<const N: usize>(a: &[f64], others: [&[f64]; N]) -> [f64; N] {
    let whole = a.len() - a.len() % LANES;
    let mut lanes = [[0.0; LANES]; N];
    for at in (0..whole).step_by(LANES) {
        let x = &a[at..at + LANES];
        for (lanes, b) in lanes.iter_mut().zip(others) {
            let y = &b[at..at + LANES];
            for k in 0..LANES {
                lanes[k] += x[k] * y[k];
            }
        }
    }
    std::array::from_fn(|n| {
        let rest = a[whole..].iter().zip(&others[n][whole..]);
        lanes[n].iter().sum::<f64>() + rest.map(|(x, y)| x * y).sum::<f64>()
    })
}
