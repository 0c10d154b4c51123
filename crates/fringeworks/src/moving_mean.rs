//! Moving means of maps along both axes, one after the other: Gaussian kernels of any width at a cost
//! that does not grow with it. Beyond the border the border's values go on.

use crate::{Error, Image, check_columns, check_value};
use rayon::prelude::*;
use std::ops::Range;

/// Least number of rows that a task computes. Fixed, so that sums do not depend on the number of
/// threads.
const BAND: usize = 128;

/// Columns that a task works on at a time, in memory that stays in the second cache.
const COLUMNS: usize = 128;

/// A map's type of number; sums are in double precision.
pub trait Number: Copy + Send + Sync {
    /// The number in double precision.
    fn wide(self) -> f64;
    /// A number in double precision, rounded to this type.
    fn narrow(value: f64) -> Self;
}

impl Number for f32 {
    #[inline(always)]
    fn wide(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn narrow(value: f64) -> Self {
        value as f32
    }
}

impl Number for f64 {
    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }
    #[inline(always)]
    fn narrow(value: f64) -> Self {
        value
    }
}

/// Replace every value of a map by the mean of its neighbours, once for each of the
/// odd `sides` along y and x.
///
/// ```
/// use fringeworks::{Image, moving_mean::moving_means};
///
/// let row = Image::new(&[0.0, 0.0, 3.0, 0.0, 0.0], 1, 5)?;
/// assert_eq!(moving_means(row, &[], &[3])?, [0.0, 1.0, 1.0, 1.0, 0.0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn moving_means<T: Number>(
    values: Image<T>,
    sides_y: &[usize],
    sides_x: &[usize],
) -> Result<Vec<T>, Error> {
    check_columns(values)?;
    let width = values.width();
    let odd = |sides: &[usize]| sides.iter().all(|side| side % 2 == 1);
    check_value("sides", odd(sides_y) && odd(sides_x), "odd", sides_y)?;
    let mut out = vec![T::narrow(0.0); values.len()];
    let halo: usize = sides_y.iter().map(|side| side / 2).sum();
    // Bands share the rows of their halos with their neighbours: tall ones compute few rows twice.
    let band = BAND.max(4 * halo);
    out.par_chunks_mut(band * width).enumerate().for_each_init(
        Scratch::default,
        |scratch, (k, rows)| {
            for left in (0..width).step_by(COLUMNS) {
                let columns = left..(left + COLUMNS).min(width);
                scratch.along_y(values, sides_y, k * band, columns, rows);
            }
            for row in rows.chunks_exact_mut(width) {
                scratch.along_x(row, sides_x);
            }
        },
    );
    Ok(out)
}

/// Memory of a task, used again.
#[derive(Default)]
struct Scratch {
    now: Vec<f64>,
    next: Vec<f64>,
}

impl Scratch {
    /// Means along y of some columns of some rows, the first of which is `top`.
    fn along_y<T: Number>(
        &mut self,
        values: Image<T>,
        sides: &[usize],
        top: usize,
        columns: Range<usize>,
        rows: &mut [T],
    ) {
        let (height, width) = values.shape();
        let halo: usize = sides.iter().map(|side| side / 2).sum();
        let n = columns.len();
        // Rows that are known: as many fewer after each pass as it reaches, but for the border's.
        let mut known = top.saturating_sub(halo)..(top + rows.len() / width + halo).min(height);
        self.now.clear();
        for y in known.clone() {
            let row = &values[y * width..(y + 1) * width][columns.clone()];
            self.now.extend(row.iter().map(|v| v.wide()));
        }
        for side in sides {
            known = self.pass(known, side / 2, height, n);
        }
        let skipped = top - known.start;
        let means = self.now.chunks_exact(n).skip(skipped);
        for (line, means) in rows.chunks_exact_mut(width).zip(means) {
            for (v, mean) in line[columns.clone()].iter_mut().zip(means) {
                *v = T::narrow(*mean);
            }
        }
    }

    /// One moving mean along y of rows of `n` columns; returns the rows that it knows.
    fn pass(&mut self, known: Range<usize>, reach: usize, height: usize, n: usize) -> Range<usize> {
        let start = known.start + if known.start == 0 { 0 } else { reach };
        let end = known.end - if known.end == height { 0 } else { reach };
        let at = |y: usize| y.min(height - 1) - known.start;
        let row = |y: usize| &self.now[at(y) * n..(at(y) + 1) * n];
        let share = 1.0 / (2 * reach + 1) as f64;
        let mut sums = [0.0; COLUMNS];
        let sums = &mut sums[..n];
        for k in 0..2 * reach + 1 {
            let line = row((start + k).saturating_sub(reach));
            sums.iter_mut().zip(line).for_each(|(s, v)| *s += v);
        }
        self.next.clear();
        self.next.resize((end - start) * n, 0.0);
        for (y, line) in (start..end).zip(self.next.chunks_exact_mut(n)) {
            for (mean, sum) in line.iter_mut().zip(&*sums) {
                *mean = sum * share;
            }
            if y + 1 < end {
                step(sums, row(y + reach + 1), row(y.saturating_sub(reach)));
            }
        }
        std::mem::swap(&mut self.now, &mut self.next);
        start..end
    }

    fn along_x<T: Number>(&mut self, row: &mut [T], sides: &[usize]) {
        let n = row.len();
        let (padded, means) = (&mut self.next, &mut self.now);
        means.clear();
        means.extend(row.iter().map(|v| v.wide()));
        for side in sides {
            let reach = side / 2;
            padded.clear();
            padded.resize(reach, means[0]);
            padded.extend_from_slice(means);
            padded.resize(n + side, means[n - 1]);
            let share = 1.0 / *side as f64;
            let mut sum: f64 = padded[..*side].iter().sum();
            for (mean, (next, first)) in means
                .iter_mut()
                .zip(padded[*side..].iter().zip(&padded[..]))
            {
                *mean = sum * share;
                sum += next - first;
            }
        }
        for (v, mean) in row.iter_mut().zip(means) {
            *v = T::narrow(*mean);
        }
    }
}

/// Move the window of the sums on by a row.
#[inline(always)]
fn step(sums: &mut [f64], next: &[f64], first: &[f64]) {
    for ((sum, next), first) in sums.iter_mut().zip(next).zip(first) {
        *sum += next - first;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_of_neighbours() {
        let (h, w) = (300, 37);
        let values: Vec<f64> = (0..h * w).map(|k| ((k * 7919) % 101) as f64).collect();
        let map = Image::new(&values, h, w).unwrap();
        let at = |y: isize, x: isize| {
            let inside = |v: isize, n: usize| v.clamp(0, n as isize - 1) as usize;
            values[inside(y, h) * w + inside(x, w)]
        };
        for (side_y, side_x) in [(1, 1), (5, 1), (1, 9), (7, 41), (701, 3)] {
            let found = moving_means(map, &[side_y], &[side_x]).unwrap();
            let (ry, rx) = ((side_y / 2) as isize, (side_x / 2) as isize);
            for (y, x) in [(0, 0), (150, 20), (127, 36), (128, 1), (299, 36)] {
                let mut sum = 0.0;
                for dy in -ry..=ry {
                    sum += (-rx..=rx)
                        .map(|dx| at(y as isize + dy, x as isize + dx))
                        .sum::<f64>();
                }
                let expected = sum / (side_y * side_x) as f64;
                assert!((found[y * w + x] - expected).abs() < 1e-9);
            }
        }
        assert!(moving_means(map, &[4], &[]).is_err());
    }
}
