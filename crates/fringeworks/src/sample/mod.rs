//! Statistics of a sample of a stack's pixels, by which the stack is judged.
//!
//! Every kernel replaces a few passes of NumPy over some ten thousand values, and takes less time than
//! handing work to other threads does: they all run on the thread that calls them. What is decided by
//! the results is up to the callers.

pub mod differences;
pub mod fit;
pub mod groups;
pub mod harmonics;
pub mod moments;
pub mod quantile;
pub mod residuals;
pub mod variance;
pub mod waves;
pub mod windows;

/// Values that are computed together: sums have as many parts, whose order does not depend on the
/// processor.
pub(crate) const LANES: usize = 8;

/// Sum of the products of two slices of equal length.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    let (a, b) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = a
        .remainder()
        .iter()
        .zip(b.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in a.zip(b) {
        for k in 0..LANES {
            lanes[k] += x[k] * y[k];
        }
    }
    lanes.iter().sum::<f64>() + rest
}
