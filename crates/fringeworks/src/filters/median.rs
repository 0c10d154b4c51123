//! Medians of squares of nine values.

use crate::{Error, Image, check_columns};
use multiversion::multiversion;
use rayon::prelude::*;

/// Rows that a task computes.
const BAND: usize = 32;

/// Median of the 3 × 3 values around every value of a map. The values at the border
/// go on beyond it. NaN where one of the nine is NaN.
///
/// ```
/// use fringeworks::{Image, filters::median_of_nine};
///
/// let map = Image::new(&[1.0, 1.0, 1.0, 1.0, 99.0, 1.0, 1.0, 1.0, 1.0], 3, 3)?;
/// assert_eq!(median_of_nine(map)?, [1.0; 9]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn median_of_nine(values: Image<f32>) -> Result<Vec<f32>, Error> {
    check_columns(values)?;
    let (height, width) = values.shape();
    let last = height.saturating_sub(1);
    let row = |y: usize| values.row(y);
    let mut out = vec![0.0; values.len()];
    out.par_chunks_mut(BAND * width).enumerate().for_each_init(
        Sorted::default,
        |sorted, (k, lines)| {
            for (y, line) in (k * BAND..).zip(lines.chunks_exact_mut(width)) {
                let rows = [row(y.saturating_sub(1)), row(y), row((y + 1).min(last))];
                sorted.sort(rows);
                sorted.medians(line);
                rows.iter().for_each(|row| mark_unknown(row, line));
            }
        },
    );
    Ok(out)
}

/// The three values of every column of three rows in order, with a column more at both ends.
#[derive(Default)]
struct Sorted {
    low: Vec<f32>,
    middle: Vec<f32>,
    high: Vec<f32>,
}

impl Sorted {
    fn sort(&mut self, rows: [&[f32]; 3]) {
        let n = rows[0].len();
        for part in [&mut self.low, &mut self.middle, &mut self.high] {
            part.resize(n + 2, 0.0);
        }
        let parts = [&mut self.low, &mut self.middle, &mut self.high];
        sort_columns(rows, parts.map(|part| &mut part[1..=n]));
        for part in [&mut self.low, &mut self.middle, &mut self.high] {
            part[0] = part[1];
            part[n + 1] = part[n];
        }
    }

    /// The median of nine is that of the largest of the low, the median of the middle and the smallest
    /// of the high values.
    fn medians(&self, out: &mut [f32]) {
        medians(&self.low, &self.middle, &self.high, out);
    }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn median(a: f32, b: f32, c: f32) -> f32 {
    larger(smaller(a, b), smaller(larger(a, b), c))
}

/// Columns of three rows in order, where all are numbers.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn sort_columns(rows: [&[f32]; 3], parts: [&mut [f32]; 3]) {
    let n = rows[0].len();
    let [a, b, c] = rows.map(|row| &row[..n]);
    let [low, middle, high] = parts.map(|part| &mut part[..n]);
    for i in 0..n {
        let (least, most) = (smaller(a[i], b[i]), larger(a[i], b[i]));
        low[i] = smaller(least, c[i]);
        middle[i] = larger(least, smaller(most, c[i]));
        high[i] = larger(most, c[i]);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn medians(low: &[f32], middle: &[f32], high: &[f32], out: &mut [f32]) {
    let n = out.len();
    let (low, middle, high) = (&low[..n + 2], &middle[..n + 2], &high[..n + 2]);
    for i in 0..n {
        let most = larger(larger(low[i], low[i + 1]), low[i + 2]);
        let between = median(middle[i], middle[i + 1], middle[i + 2]);
        let least = smaller(smaller(high[i], high[i + 1]), high[i + 2]);
        out[i] = median(most, between, least);
    }
}

/// NaN around every NaN of a row: comparisons with it are false, so medians would be any number.
fn mark_unknown(row: &[f32], out: &mut [f32]) {
    if !has_nan(row) {
        return;
    }
    for (x, _) in row.iter().enumerate().filter(|(_, v)| v.is_nan()) {
        let end = (x + 2).min(row.len());
        out[x.saturating_sub(1)..end].fill(f32::NAN);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn has_nan(row: &[f32]) -> bool {
    row.iter().fold(false, |found, v| found | v.is_nan())
}

#[cfg(test)]
mod tests {
    use super::median_of_nine;
    use crate::Image;

    #[test]
    fn medians_of_squares() {
        let (h, w) = (70, 41);
        let mut values: Vec<f32> = (0..h * w).map(|k| ((k * 7919) % 101) as f32).collect();
        values[20 * w + 20] = f32::NAN;
        values[40 * w + 20] = f32::INFINITY;
        let found = median_of_nine(Image::new(&values, h, w).unwrap()).unwrap();
        for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
            let mut nine = vec![];
            for (dy, dx) in (0..3).flat_map(|dy| (0..3).map(move |dx| (dy, dx))) {
                let yy = (y + dy).saturating_sub(1).min(h - 1);
                nine.push(values[yy * w + (x + dx).saturating_sub(1).min(w - 1)]);
            }
            if nine.iter().any(|v| v.is_nan()) {
                assert!(found[y * w + x].is_nan());
            } else {
                nine.sort_by(f32::total_cmp);
                assert_eq!(found[y * w + x], nine[4]);
            }
        }
        let one = Image::new(&[3.0], 1, 1).unwrap();
        assert_eq!(median_of_nine(one).unwrap(), [3.0]);
        assert!(median_of_nine(Image::new(&[], 1, 0).unwrap()).is_err());
    }
}
