//! Means over boxes.

use super::Border;
use crate::moving_mean::Number;
use crate::{Error, Image, check_columns, check_value};
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::{Add, Mul, Sub};

/// Least number of rows that a task computes. Fixed, so that sums do not depend on the number of
/// threads.
const BAND: usize = 128;

/// More than any frame has pixels along an axis; times four, it is still a number.
const MAX_SIDE: usize = 1_000_000;

/// Columns whose sums move down together, in memory that stays in the first cache.
const COLUMNS: usize = 256;

/// A map's type of number, with the sums that stay in it.
pub trait Real:
    Number + Default + PartialEq + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
}

impl Real for f32 {}
impl Real for f64 {}

/// Means of the square of an odd `side` around every value of a map.
///
/// Values have to be finite: others would stay in the sums that move down.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::filters::{Border, box_means};
///
/// let mut values = [0.0_f64; 25];
/// values[12] = 9.0;
/// let means = box_means(Image::new(&values, 5, 5)?, 3, Border::Edge)?;
/// assert_eq!((means[0], means[6], means[12]), (0.0, 1.0, 1.0));
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn box_means<T: Real>(values: Image<T>, side: usize, border: Border) -> Result<Vec<T>, Error> {
    check_columns(values)?;
    let width = values.width();
    let usable = side % 2 == 1 && side < MAX_SIDE;
    check_value("side", usable, "an odd number below 10^6", side)?;
    let mut out = vec![T::default(); values.len()];
    // Bands begin with the sum of a square: tall ones share its cost.
    let band = BAND.max(4 * side);
    out.par_chunks_mut(band * width)
        .enumerate()
        .for_each_init(Row::default, |row, (k, rows)| {
            for left in (0..width).step_by(COLUMNS) {
                let n = COLUMNS.min(width - left);
                let column = Column {
                    values: values.values(),
                    width,
                    left,
                    n,
                    border,
                };
                column.means(side, k * band, rows);
            }
            for line in rows.chunks_exact_mut(width) {
                row.pad(line, side / 2, border);
                row.means(side, line);
            }
        });
    Ok(out)
}

/// Some columns of a map.
struct Column<'a, T> {
    values: &'a [T],
    width: usize,
    left: usize,
    n: usize,
    border: Border,
}

impl<T: Real> Column<'_, T> {
    /// Means along y of whole rows, the first of which is `top`.
    fn means(&self, side: usize, top: usize, rows: &mut [T]) {
        let zeros = [T::default(); COLUMNS];
        let height = self.values.len() / self.width;
        let first = top as isize - (side / 2) as isize;
        let row = |k: usize| match self.border.place(first + k as isize, height) {
            Some(y) => &self.values[y * self.width + self.left..][..self.n],
            None => &zeros[..self.n],
        };
        let mut sums = [0.0; COLUMNS];
        for k in 0..side {
            start(&mut sums, row(k));
        }
        let share = 1.0 / side as f64;
        for (k, line) in rows.chunks_exact_mut(self.width).enumerate() {
            let out = &mut line[self.left..][..self.n];
            move_on(&mut sums, share, row(k), row(k + side), out);
        }
    }
}

fn start<T: Number>(sums: &mut [f64; COLUMNS], row: &[T]) {
    for (sum, v) in sums.iter_mut().zip(row) {
        *sum += v.wide();
    }
}

/// Write means, and move the sums on by a row.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn move_on<T: Number>(
    sums: &mut [f64; COLUMNS],
    share: f64,
    first: &[T],
    next: &[T],
    out: &mut [T],
) {
    let n = out.len();
    let (sums, first, next) = (&mut sums[..n], &first[..n], &next[..n]);
    for i in 0..n {
        out[i] = T::narrow(sums[i] * share);
        sums[i] += next[i].wide() - first[i].wide();
    }
}

/// Memory of a task, used again.
#[derive(Default)]
struct Row<T> {
    /// Sums of as many values as the pass has come to, from each value on.
    sums: Vec<T>,
    next: Vec<T>,
}

impl<T: Real> Row<T> {
    fn pad(&mut self, line: &[T], reach: usize, border: Border) {
        let n = line.len() as isize;
        let beyond = |x: isize| {
            border
                .place(x, line.len())
                .map_or(T::default(), |x| line[x])
        };
        self.sums.clear();
        self.sums.extend((-(reach as isize)..0).map(beyond));
        self.sums.extend_from_slice(line);
        self.sums.extend((n..n + reach as isize).map(beyond));
        self.next.resize(self.sums.len(), T::default());
    }

    /// Means of `side` values. Each pass doubles the number of values in a sum, so that no sum waits
    /// for the one beside it, and none keeps what has left it.
    fn means(&mut self, side: usize, out: &mut [T]) {
        let (mut count, mut taken) = (1, 0);
        while count <= side {
            if side & count != 0 {
                let part = &self.sums[taken..taken + out.len()];
                match taken {
                    0 => out.copy_from_slice(part),
                    _ => add(out, part),
                }
                taken += count;
            }
            if 2 * count <= side {
                let n = self.sums.len() - count;
                add_both(&mut self.next[..n], &self.sums[..n], &self.sums[count..]);
                self.sums.truncate(n);
                self.next.truncate(n);
                std::mem::swap(&mut self.sums, &mut self.next);
            }
            count *= 2;
        }
        let share = T::narrow(1.0 / side as f64);
        scale(out, share);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn add<T: Real>(out: &mut [T], part: &[T]) {
    for (sum, v) in out.iter_mut().zip(part) {
        *sum = *sum + *v;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn add_both<T: Real>(out: &mut [T], a: &[T], b: &[T]) {
    for (sum, (a, b)) in out.iter_mut().zip(a.iter().zip(b)) {
        *sum = *a + *b;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn scale<T: Real>(out: &mut [T], share: T) {
    for v in out {
        *v = *v * share;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_of_squares() {
        let (h, w) = (300, 37);
        let values: Vec<f64> = (0..h * w).map(|k| ((k * 7919) % 101) as f64).collect();
        let map = Image::new(&values, h, w).unwrap();
        for border in [Border::Edge, Border::Mirror, Border::Zero] {
            for side in [1, 3, 7, 41, 91] {
                let found = box_means(map, side, border).unwrap();
                for (y, x) in [(0, 0), (150, 20), (127, 36), (128, 1), (299, 36)] {
                    let mut sum = 0.0;
                    for (j, i) in (0..side).flat_map(|j| (0..side).map(move |i| (j, i))) {
                        let yy = border.place(y as isize + j as isize - (side / 2) as isize, h);
                        let xx = border.place(x as isize + i as isize - (side / 2) as isize, w);
                        sum += yy.zip(xx).map_or(0.0, |(yy, xx)| values[yy * w + xx]);
                    }
                    let expected = sum / (side * side) as f64;
                    assert!((found[y * w + x] - expected).abs() < 1e-9, "{side} {y} {x}");
                }
            }
        }
        assert!(box_means(map, 4, Border::Edge).is_err());
    }
}
