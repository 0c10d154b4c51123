//! A linear model fitted to values of which a part may be wrong.

use super::{dot, median};
use crate::{Error, Image, check_length, check_value};

/// Standard deviation of a normal distribution over its median absolute deviation.
const MAD_TO_SIGMA: f64 = 1.4826;

/// Lower bound on the scatter, in standard deviations of the values: exact values are divided by it.
const LEAST_SCATTER: f64 = 1e-9;

/// Largest number of coefficients of a model.
const MOST_COEFFICIENTS: usize = 16;

/// How values are weighted.
#[derive(Clone, Copy, Debug)]
pub struct Reweighting {
    /// Number of fits: the first half towards least absolute deviations, the others with Tukey's weights.
    pub fits: usize,
    /// Lower bound on a deviation in the weights for least absolute deviations, over the scatter.
    pub least: f64,
    /// Deviation beyond which a value has no weight, over the scatter.
    pub most: f64,
}

/// A fitted model.
#[derive(Clone, Debug)]
pub struct Robust {
    /// Coefficients of the last fit; NaN where the values do not determine them.
    pub coefficients: Vec<f64>,
    /// Scatter of the values about it, in their standard deviations.
    pub scatter: f64,
    /// The normal matrices of all fits, one after the other.
    pub normals: Vec<f64>,
    /// The weights of the last fit.
    pub weight: Vec<f64>,
}

/// Fit a linear model by reweighted least squares.
///
/// `design` has a row for each coefficient, `certainty` is one over the standard deviation of each value.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::sample::{Reweighting, robust_fit};
///
/// let design = [1.0; 5];
/// let how = Reweighting { fits: 12, least: 0.1, most: 4.7 };
/// let values = [2.0, 2.1, 1.9, 2.0, 90.0];
/// let found = robust_fit(Image::new(&design, 1, 5)?, &values, &[1.0; 5], how)?;
/// assert!((found.coefficients[0] - 2.0).abs() < 0.05);
/// assert_eq!(found.weight[4], 0.0);
/// # Ok::<(), fringeworks::Error>(())
/// ```
///
/// # Errors
///
/// Lengths that do not fit, and more than 16 coefficients.
pub fn robust_fit(
    design: Image<f64>,
    values: &[f64],
    certainty: &[f64],
    how: Reweighting,
) -> Result<Robust, Error> {
    let (count, length) = design.shape();
    check_length("values", values.len(), length)?;
    check_length("certainty", certainty.len(), length)?;
    check_coefficients(count)?;
    let mut found = Robust {
        coefficients: vec![f64::NAN; count],
        scatter: 0.0,
        normals: Vec::with_capacity(how.fits * count * count),
        weight: certainty.to_vec(),
    };
    let mut weighted = vec![0.0; count * length];
    let mut deviation = vec![0.0; length];
    for fit in 0..how.fits {
        let mut normal = vec![0.0; count * count];
        let mut right = vec![0.0; count];
        weigh(&design, &found.weight, &mut weighted);
        sums(&design, &weighted, values, &mut normal, &mut right);
        found.normals.extend_from_slice(&normal);
        found.coefficients = solved(normal, right);
        deviations(
            &design,
            &found.coefficients,
            values,
            certainty,
            &mut deviation,
        );
        let scatter = (MAD_TO_SIGMA * median(&deviation)).max(LEAST_SCATTER);
        found.scatter = scatter;
        let weights = found.weight.iter_mut().zip(certainty).zip(&deviation);
        if fit < how.fits / 2 {
            // Outliers of any size lose their influence.
            weights.for_each(|((w, c), d)| *w = c / d.max(how.least * scatter).sqrt());
        } else if fit + 1 < how.fits {
            weights.for_each(|((w, c), d)| {
                let share = d / (how.most * scatter);
                *w = c * (1.0 - share * share).max(0.0);
            });
        }
    }
    Ok(found)
}

/// Refuse a model of none or of many coefficients.
fn check_coefficients(count: usize) -> Result<(), Error> {
    let few = (1..=MOST_COEFFICIENTS).contains(&count);
    check_value("design", few, "1 to 16 coefficients", count)
}

/// The rows of the design times the squared weights.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn weigh(design: &[f64], weight: &[f64], weighted: &mut [f64]) {
    let length = weight.len().max(1);
    for (out, row) in weighted
        .chunks_exact_mut(length)
        .zip(design.chunks_exact(length))
    {
        for ((o, d), w) in out.iter_mut().zip(row).zip(weight) {
            *o = d * (w * w);
        }
    }
}

/// Normal matrix and right-hand side.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn sums(design: &[f64], weighted: &[f64], values: &[f64], normal: &mut [f64], right: &mut [f64]) {
    let (count, length) = (right.len(), values.len());
    for i in 0..count {
        let heavy = &weighted[i * length..][..length];
        right[i] = dot(heavy, values);
        for j in 0..=i {
            let sum = dot(heavy, &design[j * length..][..length]);
            normal[i * count + j] = sum;
            normal[j * count + i] = sum;
        }
    }
}

/// Magnitudes of the deviations from the model, in standard deviations of the values.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn deviations(
    design: &[f64],
    coefficients: &[f64],
    values: &[f64],
    certainty: &[f64],
    out: &mut [f64],
) {
    let length = values.len().max(1);
    out.copy_from_slice(values);
    for (row, c) in design.chunks_exact(length).zip(coefficients) {
        for (o, d) in out.iter_mut().zip(row) {
            *o -= c * d;
        }
    }
    for (o, c) in out.iter_mut().zip(certainty) {
        *o = o.abs() * c;
    }
}

/// Solve by elimination with pivots; not finite where the matrix is singular.
fn solved(mut matrix: Vec<f64>, mut right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    for k in 0..n {
        let size = |i: &usize| matrix[i * n + k].abs();
        let pivot = (k..n)
            .max_by(|a, b| size(a).total_cmp(&size(b)))
            .unwrap_or(k);
        if pivot != k {
            for j in 0..n {
                matrix.swap(k * n + j, pivot * n + j);
            }
            right.swap(k, pivot);
        }
        for i in k + 1..n {
            let factor = matrix[i * n + k] / matrix[k * n + k];
            for j in k..n {
                matrix[i * n + j] -= factor * matrix[k * n + j];
            }
            right[i] -= factor * right[k];
        }
    }
    for k in (0..n).rev() {
        for j in k + 1..n {
            right[k] -= matrix[k * n + j] * right[j];
        }
        right[k] /= matrix[k * n + k];
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_with_pivots() {
        let found = solved(vec![0.0, 2.0, 1.0, 1.0], vec![4.0, 5.0]);
        assert_eq!(found, [3.0, 2.0]);
        assert!(!solved(vec![1.0, 1.0, 1.0, 1.0], vec![1.0, 2.0])[0].is_finite());
    }
}
