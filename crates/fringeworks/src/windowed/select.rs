//! Choice of the window of every pixel (Lepski's rule).

use super::grid::{Blended, Grid};
use super::lattice::Differences;
use super::{Field, NO_SCALE};
use rayon::prelude::*;

/// Share of what varies in the steps to an estimate that is left of the error before them.
///
/// A step removes an error that is constant in its window. Where the step varies, so does the error,
/// and a part is left: 0.02 to 0.14 on simulated curved surfaces, more on peaks.
const LEFT_OF_START: f32 = 0.3;

/// Estimates of one scale.
pub struct Estimate<'a> {
    /// Displacement of every pixel, px.
    pub displacement: Vec<f32>,
    /// Whether the windows determine it, until the next finer ones are solved.
    pub known: Vec<bool>,
    /// The windows.
    pub grid: Grid<'a>,
    /// Factor of the standard deviation that the windows state.
    pub widening: f32,
    /// Displacement of this scale minus that of the next coarser one, or of the start, px.
    pub from_coarser: Differences,
}

impl Estimate<'_> {
    /// Free what only the next finer scale needs.
    pub fn without_finer(&mut self) {
        self.known = Vec::new();
        self.grid.without_priors();
    }
}

/// Differences between the estimates of neighbouring scales around the pixels of a row.
struct RowDifferences {
    mean: Vec<f32>,
    mean_square: Vec<f32>,
    variance: Vec<f32>,
}

impl RowDifferences {
    fn at(estimate: &Estimate, y: usize, width: usize) -> Self {
        let mut row = Self {
            mean: vec![0.0; width],
            mean_square: vec![0.0; width],
            variance: vec![0.0; width],
        };
        estimate.from_coarser.mean(y, &mut row.mean);
        estimate.from_coarser.mean_square(y, &mut row.mean_square);
        estimate.from_coarser.variance(y, &mut row.variance);
        row
    }
}

/// The estimates of a row of pixels.
struct Row {
    /// What the windows of every scale say; σ is infinite where they do not determine the displacement.
    windows: Vec<Blended>,
    /// Of every scale from the coarser one.
    differences: Vec<RowDifferences>,
}

impl Row {
    fn new(estimates: &[Estimate], y: usize, width: usize) -> Self {
        let mut means = Vec::new();
        let windows = estimates.iter().map(|estimate| {
            let mut windows = Blended::new(width);
            estimate.grid.blend_row(y, &mut means, &mut windows);
            let sigma = windows.sigma.iter_mut();
            sigma.for_each(|sigma| *sigma *= estimate.widening);
            windows
        });
        let differences = estimates.iter().map(|e| RowDifferences::at(e, y, width));
        Self {
            windows: windows.collect(),
            differences: differences.collect(),
        }
    }

    fn sigma(&self, k: usize, x: usize) -> f32 {
        self.windows[k].sigma[x]
    }

    /// Whether the estimate of scale `k` agrees with those of all finer scales at pixel `x`.
    ///
    /// The differences are averaged over the blocks of the coarser window: that averages the noise of
    /// the finer estimate, but not its bias. An undetermined window contradicts nothing.
    fn agrees(&self, k: usize, x: usize, confidence: f32) -> bool {
        if !self.sigma(k, x).is_finite() {
            return false;
        }
        let mut difference = 0.0;
        (k + 1..self.windows.len()).all(|finer| {
            difference += self.differences[finer].mean[x];
            difference.abs() <= confidence * self.sigma(finer, x)
        })
    }

    /// Variance of the estimate of scale `k`: its noise, its bias, and what one step leaves of the
    /// start.
    ///
    /// σ_k² + max(0, G ∗ (u_{k+1} − u_k)² − σ_{k+1}²) + η² Σ_{j ≤ k} var_G(u_j − u_{j−1}): what the
    /// finer window sees differently beyond its own noise, and a share of what varies in the steps
    /// that led here.
    fn variance(&self, k: usize, x: usize) -> f32 {
        let finer = k + 1;
        let known = finer < self.windows.len() && self.sigma(finer, x).is_finite();
        let bias = if known {
            (self.differences[finer].mean_square[x] - self.sigma(finer, x).powi(2)).max(0.0)
        } else {
            0.0
        };
        let moved: f32 = self.differences[..=k].iter().map(|d| d.variance[x]).sum();
        self.sigma(k, x).powi(2) + bias + LEFT_OF_START.powi(2) * moved
    }
}

/// Keep for every pixel the largest window that agrees with all smaller ones.
///
/// Agreement allows a bias of about the noise of the finer window: see `Row::variance`.
pub fn select(estimates: &[Estimate], width: usize, confidence: f32) -> Field {
    let n = estimates[0].displacement.len();
    let mut field = Field {
        displacement: vec![f32::NAN; n],
        sigma: vec![f32::NAN; n],
        modulation_ratio: vec![f32::NAN; n],
        offset: vec![f32::NAN; n],
        scale: vec![NO_SCALE; n],
        noise_correlation: 1.0,
        misfit: Vec::new(),
    };
    field
        .displacement
        .par_chunks_mut(width)
        .zip(field.sigma.par_chunks_mut(width))
        .zip(field.modulation_ratio.par_chunks_mut(width))
        .zip(field.offset.par_chunks_mut(width))
        .zip(field.scale.par_chunks_mut(width))
        .enumerate()
        .for_each(|(y, ((((displacement, sigma), ratio), offset), scale))| {
            let row = Row::new(estimates, y, width);
            for x in 0..width {
                let Some(k) = (0..estimates.len()).find(|k| row.agrees(*k, x, confidence)) else {
                    continue;
                };
                let kept = &row.windows[k];
                displacement[x] = estimates[k].displacement[y * width + x];
                sigma[x] = row.variance(k, x).sqrt();
                ratio[x] = kept.modulation_ratio[x];
                offset[x] = kept.offset[x];
                scale[x] = k as u8;
            }
        });
    field
}
