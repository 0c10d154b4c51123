//! Statistics of a sample of a stack's pixels, by which the stack is judged.
//!
//! Every kernel replaces a few passes of NumPy over some ten thousand values, and takes less time than
//! handing work to other threads does: they all run on the thread that calls them. What is decided by
//! the results is up to the callers.

mod differences;
mod fit;
mod gram;
mod harmonics;
mod quantile;
mod residuals;
mod ripples;
mod robust;
mod windows;

pub use differences::{Real, second_magnitudes, third_chi_squares};
pub use fit::{FIT_ROWS, Model, fit_samples, fitted_inside};
pub use gram::gram;
pub use harmonics::{Sums, window_sums};
pub use quantile::{Usual, Value, median, quantiles, similar_groups, trimmed_variance};
pub use residuals::{Maps, Noise, Set, phase_residuals};
pub use ripples::{Ripples, column_harmonics};
pub use robust::{Reweighting, Robust, robust_fit};
pub use windows::{Lines, Wanted, Windows, smooth_windows};

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
