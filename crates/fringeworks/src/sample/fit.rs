//! Least-squares fits of a set of steps to the pixels of a sample.

use crate::decode::Sample;
use crate::{Error, check_length};

/// Pixels that are computed together, so that their samples stay in the first cache.
const BLOCK: usize = 128;

/// What is measured at every pixel; one row of the results each.
pub const FIT_ROWS: usize = 8;

/// A model of the samples of a pixel and its solution.
#[derive(Clone, Copy)]
pub struct Model<'a> {
    /// What every frame shows of A, c and s.
    pub design: &'a [f64],
    /// Row after row, what A, c and s take from every frame.
    pub solver: &'a [f64],
}

/// Fit a set of steps at every pixel.
///
/// The results are one row each of A, c, s, the sum of the squared residuals, and the mean, variance,
/// largest and smallest value of the samples. A sample that is not finite makes the sum of the squares
/// NaN.
///
/// ```
/// use fringeworks::sample::{Model, fit_samples};
///
/// // Four equal steps: what they show of A, c and s, and what A, c and s take from them.
/// let design = [1., 1., 0., 1., 0., 1., 1., -1., 0., 1., 0., -1.];
/// let solver = [0.25, 0.25, 0.25, 0.25, 0.5, 0., -0.5, 0., 0., 0.5, 0., -0.5];
/// let model = Model { design: &design, solver: &solver };
/// let found = fit_samples(&[&[40_u8], &[30], &[20], &[30]], model)?;
/// // A, c, s, and the sum of the squared residuals.
/// assert_eq!(found[..4], [30.0, 10.0, 0.0, 0.0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn fit_samples<T: Sample>(planes: &[&[T]], model: Model) -> Result<Vec<f64>, Error> {
    let pixels = planes.first().map_or(0, |plane| plane.len());
    for plane in planes {
        check_length("plane", plane.len(), pixels)?;
    }
    check_length("design", model.design.len(), 3 * planes.len())?;
    check_length("solver", model.solver.len(), 3 * planes.len())?;
    let mut out = vec![0.0; FIT_ROWS * pixels];
    let mut values = vec![[0.0; BLOCK]; planes.len()];
    let mut found = [[0.0; BLOCK]; FIT_ROWS];
    for start in (0..pixels).step_by(BLOCK) {
        let n = BLOCK.min(pixels - start);
        for (line, plane) in values.iter_mut().zip(planes) {
            for (value, sample) in line.iter_mut().zip(&plane[start..start + n]) {
                *value = f64::from(sample.value());
            }
        }
        fit_block(&values, model, &mut found);
        for (row, line) in out.chunks_mut(pixels).zip(&found) {
            row[start..start + n].copy_from_slice(&line[..n]);
        }
    }
    Ok(out)
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn fit_block(values: &[[f64; BLOCK]], model: Model, out: &mut [[f64; BLOCK]; FIT_ROWS]) {
    let count = values.len();
    let [a, c, s, square, mean, variance, largest, smallest] = out;
    for line in [&mut *a, c, s, square, mean, variance] {
        line.fill(0.0);
    }
    largest.fill(f64::NEG_INFINITY);
    smallest.fill(f64::INFINITY);
    for (k, line) in values.iter().enumerate() {
        let [from_a, from_c, from_s] = [0, 1, 2].map(|row| model.solver[row * count + k]);
        for i in 0..BLOCK {
            a[i] += from_a * line[i];
            c[i] += from_c * line[i];
            s[i] += from_s * line[i];
            mean[i] += line[i];
            largest[i] = largest[i].max(line[i]);
            smallest[i] = smallest[i].min(line[i]);
        }
    }
    for i in 0..BLOCK {
        mean[i] /= count as f64;
    }
    for (k, line) in values.iter().enumerate() {
        let shown = &model.design[3 * k..3 * k + 3];
        for i in 0..BLOCK {
            let residual = line[i] - (shown[0] * a[i] + shown[1] * c[i] + shown[2] * s[i]);
            let off = line[i] - mean[i];
            square[i] += residual * residual;
            variance[i] += off * off;
        }
    }
    for i in 0..BLOCK {
        variance[i] /= count as f64;
    }
}

/// Mark the samples whose fitted values lie between two limits: a row of pixels per frame.
///
/// ```
/// use fringeworks::sample::fitted_inside;
///
/// // Two steps that show A + c and A − c.
/// let design = [1.0, 1.0, 0.0, 1.0, -1.0, 0.0];
/// assert_eq!(fitted_inside([&[30.0], &[20.0], &[0.0]], &design, 5.0, 45.0)?, [false, true]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn fitted_inside(
    fitted: [&[f64]; 3],
    design: &[f64],
    low: f64,
    high: f64,
) -> Result<Vec<bool>, Error> {
    let pixels = fitted[0].len();
    check_length("c", fitted[1].len(), pixels)?;
    check_length("s", fitted[2].len(), pixels)?;
    let mut out = vec![false; design.len() / 3 * pixels];
    for (shown, line) in design.chunks_exact(3).zip(out.chunks_mut(pixels.max(1))) {
        mark(fitted, shown, low, high, line);
    }
    Ok(out)
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn mark([a, c, s]: [&[f64]; 3], shown: &[f64], low: f64, high: f64, out: &mut [bool]) {
    let n = out.len();
    let (a, c, s) = (&a[..n], &c[..n], &s[..n]);
    for i in 0..n {
        let value = shown[0] * a[i] + shown[1] * c[i] + shown[2] * s[i];
        out[i] = (value > low) & (value < high);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_steps_at_more_pixels_than_a_block() {
        let design = [1., 1., 0., 1., 0., 1., 1., -1., 0., 1., 0., -1.];
        let solver = [0.25, 0.25, 0.25, 0.25, 0.5, 0., -0.5, 0., 0., 0.5, 0., -0.5];
        let model = Model {
            design: &design,
            solver: &solver,
        };
        let n = 2 * BLOCK + 3;
        let frame = |k: u8| (0..n).map(|i| 10 * k + (i % 7) as u8).collect::<Vec<u8>>();
        let frames = [frame(4), frame(3), frame(0), frame(3)];
        let planes = frames.each_ref().map(Vec::as_slice);
        let out = fit_samples(&planes, model).unwrap();
        let at = |row: usize| out[row * n + n - 1];
        let last = ((n - 1) % 7) as f64;
        assert_eq!((at(0), at(1), at(2)), (25.0 + last, 20.0, 0.0));
        assert_eq!(
            (at(3), at(4), at(6), at(7)),
            (100.0, 25.0 + last, 40.0 + last, last)
        );
        assert_eq!(at(5), (15.0_f64.powi(2) + 25.0_f64.powi(2) + 50.0) / 4.0);
        let fitted = [0, 1, 2].map(|row| &out[row * n..(row + 1) * n]);
        let found = fitted_inside(fitted, &design, 10.0, 40.0).unwrap();
        let first: Vec<bool> = found.chunks(n).map(|line| line[0]).collect();
        assert_eq!(first, [false, true, false, true]);
    }
}
