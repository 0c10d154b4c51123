//! Linear interpolation of maps along both axes.

use super::Real;
use crate::{Error, Image, check_columns, check_value};
use multiversion::multiversion;
use rayon::prelude::*;

/// Rows that a task computes.
const BAND: usize = 32;

/// Values of a map at all pairs of some rows and columns, row after row. The values
/// at the border go on beyond it.
///
/// ```
/// use fringeworks::{Image, filters::interpolate_linear};
///
/// let map = Image::new(&[0.0, 1.0, 10.0, 11.0], 2, 2)?;
/// assert_eq!(interpolate_linear(map, &[0.5], &[0.0, 0.5, 7.0])?, [5.0, 5.5, 6.0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn interpolate_linear<T: Real>(
    values: Image<T>,
    rows: &[f64],
    columns: &[f64],
) -> Result<Vec<T>, Error> {
    check_columns(values)?;
    let (height, width) = values.shape();
    check_value("height", height >= 1, "at least 1 px", height)?;
    if rows.is_empty() || columns.is_empty() {
        return Ok(vec![]);
    }
    let places: Vec<Place> = columns.iter().map(|at| Place::of(*at, width)).collect();
    let firsts: Vec<u32> = places.iter().map(|place| place.first as u32).collect();
    let shares: Vec<T> = places.iter().map(|place| T::narrow(place.share)).collect();
    let n = columns.len();
    // Along x first: enlarged maps have few rows that many take their values from.
    let mut wide = vec![T::default(); height * n];
    wide.par_chunks_mut(BAND * n)
        .zip(values.par_chunks(BAND * width))
        .for_each_init(Vec::new, |padded, (out, values)| {
            for (out, row) in out.chunks_exact_mut(n).zip(values.chunks_exact(width)) {
                padded.clear();
                padded.extend_from_slice(row);
                padded.push(row[width - 1]);
                spread(out, padded, &firsts, &shares);
            }
        });
    let mut out = vec![T::default(); rows.len() * n];
    out.par_chunks_mut(BAND * n)
        .zip(rows.par_chunks(BAND))
        .for_each(|(out, rows)| {
            for (out, at) in out.chunks_exact_mut(n).zip(rows) {
                let place = Place::of(*at, height);
                let next = (place.first + 1).min(height - 1);
                let [a, b] = [place.first, next].map(|y| &wide[y * n..(y + 1) * n]);
                if place.share == 0.0 {
                    // What is not finite does not reach a place that has no share of it.
                    out.copy_from_slice(a);
                } else {
                    mix(out, a, b, T::narrow(place.share));
                }
            }
        });
    Ok(out)
}

/// Values between those of a row, which has one more at its end.
fn spread<T: Real>(out: &mut [T], row: &[T], firsts: &[u32], shares: &[T]) {
    for ((v, first), share) in out.iter_mut().zip(firsts).zip(shares) {
        let first = *first as usize;
        let (a, b) = (row[first], row[first + 1]);
        *v = if *share == T::default() {
            a
        } else {
            a + *share * (b - a)
        };
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn mix<T: Real>(out: &mut [T], a: &[T], b: &[T], share: T) {
    for (v, (a, b)) in out.iter_mut().zip(a.iter().zip(b)) {
        *v = *a + share * (*b - *a);
    }
}

/// A place between two values, or at the first of them.
struct Place {
    first: usize,
    share: f64,
}

impl Place {
    /// A place among `n` values; NaN gives NaN.
    fn of(at: f64, n: usize) -> Self {
        let at = at.clamp(0.0, (n - 1) as f64);
        let first = at as usize;
        Self {
            first,
            share: at - first as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::interpolate_linear;
    use crate::Image;

    #[test]
    fn planes_stay_planes() {
        let (h, w) = (7, 5);
        let values: Vec<f64> = (0..h * w).map(|k| (3 * (k / w) + k % w) as f64).collect();
        let map = Image::new(&values, h, w).unwrap();
        let (rows, columns) = ([-1.0, 0.0, 2.25, 6.0, 9.0], [0.5, 4.0, 4.5]);
        let found = interpolate_linear(map, &rows, &columns).unwrap();
        for (k, y) in rows.iter().enumerate() {
            for (i, x) in columns.iter().enumerate() {
                let expected = 3.0 * y.clamp(0.0, 6.0) + x.clamp(0.0, 4.0);
                assert!((found[k * columns.len() + i] - expected).abs() < 1e-12);
            }
        }
        assert!(interpolate_linear(map, &[f64::NAN], &[1.0]).unwrap()[0].is_nan());
        assert!(interpolate_linear(Image::<f64>::new(&[], 0, w).unwrap(), &[1.0], &[1.0]).is_err());
    }
}
