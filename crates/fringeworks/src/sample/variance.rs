//! Variance from sums of squared residuals, insensitive to outliers.

use super::LANES;
use super::quantile::median;

/// What sums of squared residuals are like for a variance of 1.
#[derive(Clone, Copy)]
pub struct Usual {
    /// Their median.
    pub median: f64,
    /// Sums above it do not count.
    pub limit: f64,
    /// Mean of the sums below the limit.
    pub mean: f64,
}

/// Mean of the sums below a limit, in steps that start from the median.
pub fn trimmed_variance(square: &[f64], usual: Usual, steps: usize) -> f64 {
    let mut variance = median(square) / usual.median;
    for _ in 0..steps {
        if variance <= 0.0 {
            break;
        }
        variance = mean_below(square, variance * usual.limit) / usual.mean;
    }
    variance
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn mean_below(square: &[f64], limit: f64) -> f64 {
    let (mut sums, mut counts) = ([0.0; LANES], [0.0; LANES]);
    let chunks = square.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        for k in 0..LANES {
            let inner = chunk[k] <= limit;
            sums[k] += if inner { chunk[k] } else { 0.0 };
            counts[k] += if inner { 1.0 } else { 0.0 };
        }
    }
    let inner = || rest.iter().filter(|value| **value <= limit);
    let sum = sums.iter().sum::<f64>() + inner().sum::<f64>();
    sum / (counts.iter().sum::<f64>() + inner().count() as f64)
}
