//! Weighted sums of the neighbours along both axes, one after the other.

use super::Border;
use crate::{Error, Image, check_columns, check_value};
use multiversion::multiversion;
use rayon::prelude::*;

/// Rows that a task computes.
const BAND: usize = 32;

/// Sums that are computed at a time: as many as the registers hold.
const LANES: usize = 64;

/// Weights of the values from `-reach` to `reach`, as an even and an odd part: each multiplication
/// then serves two values. Usual weights have one of the parts only.
pub struct Weights {
    reach: usize,
    even: Option<Vec<f32>>,
    odd: Option<Vec<f32>>,
}

impl Weights {
    /// Weights of an odd number of values; refuses an even number.
    ///
    /// ```
    /// use fringeworks::filters::Weights;
    ///
    /// assert!(Weights::new("smoothing", &[0.25, 0.5, 0.25]).is_ok());
    /// assert!(Weights::new("smoothing", &[0.5, 0.5]).is_err());
    /// ```
    pub fn new(name: &'static str, weights: &[f64]) -> Result<Self, Error> {
        check_value(name, weights.len() % 2 == 1, "an odd number", weights.len())?;
        let reach = weights.len() / 2;
        let part = |sign: f64| {
            let one = |k: usize| 0.5 * (weights[reach + k] + sign * weights[reach - k]);
            let part: Vec<f32> = (0..=reach).map(|k| one(k) as f32).collect();
            // NaN counts as well.
            part.iter().any(|w| !(*w == 0.0)).then_some(part)
        };
        Ok(Self {
            reach,
            even: part(1.0),
            odd: part(-1.0),
        })
    }
}

/// Sums of the neighbours of every `step`-th value along both axes of a map, row after row. Sums are in single precision. A value that is not finite spreads over what it reaches.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::filters::{Border, Weights, weighted_sums};
///
/// let (one, slope) = (Weights::new("y", &[1.0])?, Weights::new("x", &[-0.5, 0.0, 0.5])?);
/// let ramp = Image::new(&[0.0, 2.0, 4.0, 6.0], 1, 4)?;
/// assert_eq!(weighted_sums(ramp, &one, &slope, Border::Edge, 1)?, [1.0, 2.0, 2.0, 1.0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn weighted_sums(
    values: Image<f32>,
    weights_y: &Weights,
    weights_x: &Weights,
    border: Border,
    step: usize,
) -> Result<Vec<f32>, Error> {
    check_columns(values)?;
    check_value("step", step >= 1, "at least 1 px", step)?;
    let (height, width) = values.shape();
    let (rows, columns) = (height.div_ceil(step), width.div_ceil(step));
    let mut out = vec![0.0; rows * columns];
    let whole = width.next_multiple_of(LANES);
    let map = Map {
        values: values.values(),
        width,
        height,
        border,
    };
    out.par_chunks_mut(BAND * columns)
        .enumerate()
        .for_each_init(Scratch::default, |scratch, (k, part)| {
            scratch.band.resize(BAND * whole, 0.0);
            let ys = (k * BAND..)
                .map(|row| row * step)
                .take(part.len() / columns);
            for left in (0..width).step_by(LANES) {
                scratch.sum_along_y(&map, weights_y, left, ys.clone());
            }
            for (sums, out) in scratch
                .band
                .chunks_exact(whole)
                .zip(part.chunks_exact_mut(columns))
            {
                pad(&mut scratch.row, &sums[..width], weights_x.reach, border);
                sum_along_x(&mut scratch.row, weights_x, whole);
                for (v, sum) in out.iter_mut().zip(scratch.row.iter().step_by(step)) {
                    *v = *sum;
                }
            }
        });
    Ok(out)
}

struct Map<'a> {
    values: &'a [f32],
    width: usize,
    height: usize,
    border: Border,
}

/// Memory of a task, used again.
#[derive(Default)]
struct Scratch {
    /// Some columns of the rows that a band needs, next to each other.
    tile: Vec<[f32; LANES]>,
    /// Sums along y of a band, in rows of a whole number of stretches.
    band: Vec<f32>,
    /// A row with what lies beyond its border, then its sums.
    row: Vec<f32>,
}

impl Scratch {
    /// Sums along y of the columns from `left` on of some rows.
    fn sum_along_y(
        &mut self,
        map: &Map,
        weights: &Weights,
        left: usize,
        ys: impl Iterator<Item = usize> + Clone,
    ) {
        let n = LANES.min(map.width - left);
        let (Some(top), Some(bottom)) = (ys.clone().next(), ys.clone().last()) else {
            return;
        };
        let reach = weights.reach as isize;
        self.tile.clear();
        for y in top as isize - reach..=bottom as isize + reach {
            let mut part = [0.0; LANES];
            if let Some(y) = map.border.place(y, map.height) {
                part[..n].copy_from_slice(&map.values[y * map.width + left..][..n]);
            }
            self.tile.push(part);
        }
        let whole = map.width.next_multiple_of(LANES);
        for (y, line) in ys.zip(self.band.chunks_exact_mut(whole)) {
            let (before, after) =
                self.tile[y - top..][..=2 * weights.reach].split_at(weights.reach);
            column_sums(weights, before, after, &mut line[left..left + LANES]);
        }
    }
}

/// Copy a row with what lies beyond its border within reach, up to a whole number of stretches.
fn pad(padded: &mut Vec<f32>, row: &[f32], reach: usize, border: Border) {
    let n = row.len() as isize;
    let beyond = |x: isize| border.place(x, row.len()).map_or(0.0, |x| row[x]);
    padded.clear();
    padded.extend((-(reach as isize)..0).map(beyond));
    padded.extend_from_slice(row);
    padded.extend((n..n + reach as isize).map(beyond));
    padded.resize(row.len().next_multiple_of(LANES) + 2 * reach, 0.0);
}

/// Sum of rows: those before the middle one, and it with those after.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn column_sums(
    weights: &Weights,
    before: &[[f32; LANES]],
    after: &[[f32; LANES]],
    out: &mut [f32],
) {
    let sums = fold(weights, before.iter().rev(), after.iter());
    out.copy_from_slice(&sums);
}

/// Sums of a padded row, in place: a stretch is written when no sum needs it any more.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn sum_along_x(padded: &mut [f32], weights: &Weights, whole: usize) {
    for left in (0..whole).step_by(LANES) {
        let near = &padded[left..left + 2 * weights.reach + LANES];
        let before = near[..weights.reach + LANES - 1].windows(LANES).rev();
        let after = near[weights.reach..].windows(LANES);
        let sums = fold(
            weights,
            before.map(|part| part.first_chunk().expect("a stretch")),
            after.map(|part| part.first_chunk().expect("a stretch")),
        );
        padded[left..left + LANES].copy_from_slice(&sums);
    }
}

/// Weighted sum of stretches, the nearest of each side first; those after begin with the middle.
#[inline(always)]
fn fold<'a>(
    weights: &Weights,
    before: impl Iterator<Item = &'a [f32; LANES]> + Clone,
    mut after: impl Iterator<Item = &'a [f32; LANES]> + Clone,
) -> [f32; LANES] {
    let mut sums = [0.0; LANES];
    let middle = after.next();
    if let (Some(even), Some(middle)) = (&weights.even, middle) {
        sums = middle.map(|v| even[0] * v);
        for ((a, b), w) in before.clone().zip(after.clone()).zip(&even[1..]) {
            for i in 0..LANES {
                sums[i] += w * (b[i] + a[i]);
            }
        }
    }
    if let Some(odd) = &weights.odd {
        for ((a, b), w) in before.zip(after).zip(&odd[1..]) {
            for i in 0..LANES {
                sums[i] += w * (b[i] - a[i]);
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_neighbours() {
        let (h, w) = (90usize, 75usize);
        let values: Vec<f32> = (0..h * w).map(|k| ((k * 7919) % 101) as f32).collect();
        let map = Image::new(&values, h, w).unwrap();
        let kinds: [&[f64]; 4] = [
            &[1.0],
            &[0.25, 0.5, 0.25],
            &[-1.0, 0.0, 1.0],
            &[1., 2., 3., 4., 6.],
        ];
        for (ky, kx) in kinds.iter().flat_map(|a| kinds.map(|b| (*a, b))) {
            let (y, x) = (
                Weights::new("y", ky).unwrap(),
                Weights::new("x", kx).unwrap(),
            );
            for (border, step) in [(Border::Edge, 1), (Border::Zero, 3), (Border::Mirror, 2)] {
                let found = weighted_sums(map, &y, &x, border, step).unwrap();
                let across = w.div_ceil(step);
                for (k, sum) in found.iter().enumerate() {
                    let at = ((k / across * step) as isize, (k % across * step) as isize);
                    let mut expected = 0.0;
                    for (j, i) in (0..ky.len()).flat_map(|j| (0..kx.len()).map(move |i| (j, i))) {
                        let yy = border.place(at.0 + j as isize - (ky.len() / 2) as isize, h);
                        let xx = border.place(at.1 + i as isize - (kx.len() / 2) as isize, w);
                        let v = yy.zip(xx).map_or(0.0, |(yy, xx)| values[yy * w + xx]);
                        expected += ky[j] * kx[i] * f64::from(v);
                    }
                    assert!((f64::from(*sum) - expected).abs() < 0.02, "{at:?}");
                }
            }
        }
        assert!(Weights::new("y", &[1.0, 1.0]).is_err());
    }
}
