//! Smaller maps: means of the areas that their pixels cover.

use crate::{Error, Image, check_columns, check_value};
use rayon::prelude::*;

/// Rows that a task computes.
const BAND: usize = 16;

/// A map of so many rows and columns, each value of which is the mean of the part of another map that it
/// covers. Neither number may exceed that of the other map. Sums are in single
/// precision.
///
/// ```
/// use fringeworks::{Image, filters::area_means};
///
/// let map = Image::new(&[1.0, 3.0, 5.0, 7.0], 2, 2)?;
/// assert_eq!(area_means(map, 1, 1)?, [4.0]);
/// assert_eq!(area_means(map, 1, 2)?, [3.0, 5.0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn area_means(values: Image<f32>, rows: usize, columns: usize) -> Result<Vec<f32>, Error> {
    let size = (rows, columns);
    check_columns(values)?;
    let (height, width) = values.shape();
    let smaller = (1..=height).contains(&size.0) && (1..=width).contains(&size.1);
    check_value(
        "size",
        smaller,
        "at least 1 px, at most that of the map",
        size,
    )?;
    let (rows, columns) = (Share::all(height, size.0), Share::all(width, size.1));
    let mut out = vec![0.0; size.0 * size.1];
    out.par_chunks_mut(BAND * size.1)
        .zip(rows.par_chunks(BAND))
        .for_each_init(Vec::new, |sums, (out, parts)| {
            for (out, part) in out.chunks_exact_mut(size.1).zip(parts) {
                let lines = values[part.first * width..].chunks_exact(width);
                sum_rows(sums, lines, &part.weights, width);
                for (v, part) in out.iter_mut().zip(&columns) {
                    let covered = &sums[part.first..][..part.weights.len()];
                    *v = covered
                        .iter()
                        .zip(&part.weights)
                        .fold(0.0, |sum, (s, w)| sum + s * w);
                }
            }
        });
    Ok(out)
}

fn sum_rows<'a>(
    sums: &mut Vec<f32>,
    lines: impl Iterator<Item = &'a [f32]>,
    weights: &[f32],
    width: usize,
) {
    sums.clear();
    sums.resize(width, 0.0);
    for (row, weight) in lines.zip(weights) {
        for (sum, v) in sums.iter_mut().zip(row) {
            *sum += weight * v;
        }
    }
}

/// The values that a pixel covers along an axis, and their shares of it.
struct Share {
    first: usize,
    weights: Vec<f32>,
}

impl Share {
    /// The parts of `n` values that each of `count` pixels covers.
    fn all(n: usize, count: usize) -> Vec<Self> {
        // In units of 1/count of a value, borders are whole numbers.
        let one = |k: usize| {
            let (start, end) = (k * n, (k + 1) * n);
            let first = start / count;
            let covered = |i: usize| ((i + 1) * count).min(end) - (i * count).max(start);
            let weights = (first..end.div_ceil(count)).map(|i| covered(i) as f32 / n as f32);
            Self {
                first,
                weights: weights.collect(),
            }
        };
        (0..count).map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::area_means;
    use crate::Image;

    #[test]
    fn means_of_areas() {
        let values: Vec<f32> = (0..35).map(|k| k as f32).collect();
        let map = Image::new(&values, 5, 7).unwrap();
        // Rows of 7: halves of 3.5 values.
        let found = area_means(map, 1, 2).unwrap();
        assert!((found[0] - (14.0 + (0.0 + 1.0 + 2.0 + 1.5) / 3.5)).abs() < 1e-5);
        assert!((found[1] - (14.0 + (1.5 + 4.0 + 5.0 + 6.0) / 3.5)).abs() < 1e-5);
        assert_eq!(area_means(map, 5, 7).unwrap(), values);
        assert!(area_means(map, 6, 7).is_err());
        assert!(area_means(map, 0, 7).is_err());
    }
}
