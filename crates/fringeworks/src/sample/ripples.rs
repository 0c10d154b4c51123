//! Sums that the ripple of several sets of phases is fitted by, at the same pixels.

use super::gram::{add_blocks, add_products};
use super::harmonics::harmonics;
use crate::{Error, Image, check_length};

/// Pixels whose harmonics are computed together, so that they stay in the processor's cache.
const PIXELS: usize = 128;

/// Harmonics of several sets of phases: a cosine and a sine for every order of every set.
#[derive(Clone, Copy)]
pub struct Ripples<'a> {
    phase: Image<'a, f64>,
    orders: &'a [Vec<usize>],
    functions: usize,
}

impl<'a> Ripples<'a> {
    /// Those of phases, a row of rad per set, and of the rising orders of every set.
    ///
    /// ```
    /// use fringeworks::{Image, sample::Ripples};
    ///
    /// let phase = [0.0, 1.0, 2.0, 0.0, 0.5, 1.0];
    /// let orders = [vec![1, 2], vec![4]];
    /// let ripples = Ripples::new(Image::new(&phase, 2, 3)?, &orders)?;
    /// assert_eq!(ripples.functions(), 6);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn new(phase: Image<'a, f64>, orders: &'a [Vec<usize>]) -> Result<Self, Error> {
        check_length("orders", orders.len(), phase.height())?;
        let functions = orders.iter().map(|of_set| 2 * of_set.len()).sum();
        Ok(Self {
            phase,
            orders,
            functions,
        })
    }

    /// Number of functions: two for every order of every set.
    #[must_use]
    pub fn functions(&self) -> usize {
        self.functions
    }

    /// Sums of the products of all pairs of the functions, of rows of other values at the pixels,
    /// and of one, in this order: a symmetric matrix.
    ///
    /// ```
    /// use fringeworks::{Image, sample::Ripples};
    ///
    /// let (phase, orders) = ([0.0, 0.0, 0.0], [vec![1]]);
    /// let ripples = Ripples::new(Image::new(&phase, 1, 3)?, &orders)?;
    /// let sums = ripples.ripple_sums(Image::new(&[1.0, 2.0, 3.0], 1, 3)?)?;
    /// assert_eq!(sums[..4], [3.0, 0.0, 6.0, 3.0]);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn ripple_sums(&self, values: Image<f64>) -> Result<Vec<f64>, Error> {
        check_length("values", values.width(), self.phase.width())?;
        Ok(sums(self, &values))
    }

    /// The ripple of every set with a coefficient for each function, (sets, pixels).
    ///
    /// ```
    /// use fringeworks::{Image, sample::Ripples};
    ///
    /// let (phase, orders) = ([0.0, 0.0], [vec![1, 3]]);
    /// let ripples = Ripples::new(Image::new(&phase, 1, 2)?, &orders)?;
    /// assert_eq!(ripples.ripple_values(&[1.0, 0.0, 0.5, 0.0])?, [1.5, 1.5]);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn ripple_values(&self, coefficients: &[f64]) -> Result<Vec<f64>, Error> {
        check_length("coefficients", coefficients.len(), self.functions)?;
        Ok(values(self, coefficients))
    }

    /// Sums over groups of neighbouring pixels of the functions, less the `mean` of each, times the
    /// factors of their set, (sets, pixels); and of these the products of all pairs.
    ///
    /// Pixels of one group have the same number.
    ///
    /// ```
    /// use fringeworks::{Image, sample::Ripples};
    ///
    /// let (phase, orders) = ([0.0, 0.0, 0.0], [vec![1]]);
    /// let ripples = Ripples::new(Image::new(&phase, 1, 3)?, &orders)?;
    /// let factors = Image::new(&[1.0, 2.0, 4.0], 1, 3)?;
    /// assert_eq!(ripples.ripple_scores(factors, &[0.0, 0.0], &[7, 7, 8])?[0], 9.0 + 16.0);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn ripple_scores(
        &self,
        factors: Image<f64>,
        mean: &[f64],
        group: &[i64],
    ) -> Result<Vec<f64>, Error> {
        check_length("factors", factors.height(), self.phase.height())?;
        check_length("factors", factors.width(), self.phase.width())?;
        check_length("mean", mean.len(), self.functions)?;
        check_length("group", group.len(), self.phase.width())?;
        Ok(scores(self, &factors, mean, group))
    }

    /// The functions at some pixels, a row for each.
    #[inline(always)]
    fn at(&self, start: usize, count: usize, out: &mut [f64]) {
        let mut rest = out;
        for (set, of_set) in self.orders.iter().enumerate() {
            let (rows, after) = rest.split_at_mut(2 * of_set.len() * count);
            harmonics(&self.phase.row(set)[start..start + count], of_set, rows);
            rest = after;
        }
    }

    /// Starts and lengths of the blocks of pixels.
    fn blocks(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let length = self.phase.width();
        (0..length)
            .step_by(PIXELS)
            .map(move |start| (start, PIXELS.min(length - start)))
    }
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn sums(ripples: &Ripples, values: &Image<f64>) -> Vec<f64> {
    let (functions, rows) = (ripples.functions, ripples.functions + values.height() + 1);
    let mut block = vec![0.0; rows * PIXELS];
    let mut sums = vec![0.0; rows * rows];
    for (start, count) in ripples.blocks() {
        let block = &mut block[..rows * count];
        ripples.at(start, count, &mut block[..functions * count]);
        let others = block[functions * count..].chunks_exact_mut(count);
        for (k, row) in others.enumerate() {
            if k < values.height() {
                row.copy_from_slice(&values.row(k)[start..start + count]);
            } else {
                row.fill(1.0);
            }
        }
        add_products(block, count, &mut sums);
    }
    sums
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn values(ripples: &Ripples, coefficients: &[f64]) -> Vec<f64> {
    let (sets, length) = ripples.phase.shape();
    let mut out = vec![0.0; sets * length];
    let mut block = vec![0.0; ripples.functions * PIXELS];
    for (start, count) in ripples.blocks() {
        let block = &mut block[..ripples.functions * count];
        ripples.at(start, count, block);
        let mut rows = block.chunks_exact(count).zip(coefficients);
        for (set, of_set) in ripples.orders.iter().enumerate() {
            let sums = &mut out[set * length + start..][..count];
            for (row, coefficient) in rows.by_ref().take(2 * of_set.len()) {
                for (sum, value) in sums.iter_mut().zip(row) {
                    *sum += coefficient * value;
                }
            }
        }
    }
    out
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn scores(ripples: &Ripples, factors: &Image<f64>, mean: &[f64], group: &[i64]) -> Vec<f64> {
    let functions = ripples.functions;
    let groups = group.chunk_by(|a, b| a == b).count();
    let mut sums = vec![0.0; functions * groups];
    let mut block = vec![0.0; functions * PIXELS];
    // Number of the first group of a block, and the pixels of its groups from there on.
    let (mut first, mut runs) = (0, Vec::with_capacity(PIXELS));
    for (start, count) in ripples.blocks() {
        let block = &mut block[..functions * count];
        ripples.at(start, count, block);
        runs.clear();
        let mut from = 0;
        for run in group[start..start + count].chunk_by(|a, b| a == b) {
            runs.push(from..from + run.len());
            from += run.len();
        }
        let mut rows = block.chunks_exact(count).zip(mean).enumerate();
        for (set, of_set) in ripples.orders.iter().enumerate() {
            let factor = &factors.row(set)[start..start + count];
            for (function, (row, mean)) in rows.by_ref().take(2 * of_set.len()) {
                let sums = &mut sums[function * groups + first..][..runs.len()];
                for (sum, run) in sums.iter_mut().zip(&runs) {
                    let pairs = row[run.clone()].iter().zip(&factor[run.clone()]);
                    *sum += pairs
                        .map(|(wave, share)| (wave - mean) * share)
                        .sum::<f64>();
                }
            }
        }
        // The last group may go on in the next block.
        let end = start + count;
        let goes_on = end < group.len() && group[end] == group[end - 1];
        first += runs.len() - usize::from(goes_on);
    }
    let mut products = vec![0.0; functions * functions];
    add_blocks(&sums, groups, &mut products);
    products
}

/// Sums of the harmonics of phases over the rows of a picture, and over its columns those of the
/// first order.
///
/// Only `used` pixels count. The first result has a row for the cosine and one for the sine of
/// every order, the orders rising; the second one has two rows, with a value for each row of the
/// picture.
///
/// ```
/// use fringeworks::{Image, sample::column_harmonics};
///
/// let phase = [0.0_f32, 9.0, 0.0, 0.0];
/// let used = [true, false, true, true];
/// let (columns, rows) =
///     column_harmonics(Image::new(&phase, 2, 2)?, Image::new(&used, 2, 2)?, &[1])?;
/// assert_eq!((columns, rows), (vec![2.0, 1.0, 0.0, 0.0], vec![1.0, 2.0, 0.0, 0.0]));
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn column_harmonics(
    phase: Image<f32>,
    used: Image<bool>,
    orders: &[usize],
) -> Result<(Vec<f64>, Vec<f64>), Error> {
    check_length("used", used.height(), phase.height())?;
    check_length("used", used.width(), phase.width())?;
    Ok(columns(&phase, &used, orders))
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn columns(phase: &Image<f32>, used: &Image<bool>, orders: &[usize]) -> (Vec<f64>, Vec<f64>) {
    let (height, width) = phase.shape();
    let mut columns = vec![0.0; 2 * orders.len() * width];
    let mut rows = vec![0.0; 2 * height];
    let mut known = [0.0; PIXELS];
    let mut block = vec![0.0; 2 * orders.len() * PIXELS];
    for k in 0..height {
        for start in (0..width).step_by(PIXELS) {
            let count = PIXELS.min(width - start);
            let (phase, used) = (&phase.row(k)[start..], &used.row(k)[start..]);
            for i in 0..count {
                known[i] = if used[i] { f64::from(phase[i]) } else { 0.0 };
            }
            let block = &mut block[..2 * orders.len() * count];
            harmonics(&known[..count], orders, block);
            for (function, waves) in block.chunks_exact(count).enumerate() {
                let sums = &mut columns[function * width + start..][..count];
                let mut total = 0.0;
                for i in 0..count {
                    let wave = if used[i] { waves[i] } else { 0.0 };
                    sums[i] += wave;
                    total += wave;
                }
                if function < 2 {
                    rows[function * height + k] += total;
                }
            }
        }
    }
    (columns, rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_go_on_over_blocks() {
        let phase: Vec<f64> = (0..1000).map(|i| 0.37 * f64::from(i)).collect();
        let factor: Vec<f64> = (0..1000).map(|i| (0.11 * f64::from(i)).sin()).collect();
        let orders = [vec![1]];
        let ripples = Ripples::new(Image::new(&phase, 1, 1000).unwrap(), &orders).unwrap();
        for size in [1, 3, 7, 130, 1000] {
            let group: Vec<i64> = (0..1000).map(|i| i / size).collect();
            let factors = Image::new(&factor, 1, 1000).unwrap();
            let found = ripples.ripple_scores(factors, &[0.1, 0.2], &group).unwrap();
            let (mut wanted, mut start) = ([0.0; 3], 0);
            while start < 1000 {
                let (mut c, mut s) = (0.0, 0.0);
                let end = 1000.min(start + size as usize);
                for i in start..end {
                    c += (phase[i].cos() - 0.1) * factor[i];
                    s += (phase[i].sin() - 0.2) * factor[i];
                }
                wanted = [wanted[0] + c * c, wanted[1] + c * s, wanted[2] + s * s];
                start = end;
            }
            assert!((found[0] - wanted[0]).abs() < 1e-9, "{size}");
            assert!((found[1] - wanted[1]).abs() < 1e-9, "{size}");
            assert!((found[3] - wanted[2]).abs() < 1e-9, "{size}");
        }
    }
}
