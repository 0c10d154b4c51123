//! Choice of the window of every pixel (Lepski's rule).

use super::grid::{Blended, Grid};
use super::lattice::Differences;
use super::{Field, NO_SCALE};
use rayon::prelude::*;

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
    /// Displacement of this scale minus that of the next coarser one, px.
    pub from_coarser: Option<Differences>,
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
}

impl RowDifferences {
    fn at(estimate: &Estimate, y: usize, width: usize) -> Self {
        let mut row = Self {
            mean: vec![0.0; width],
            mean_square: vec![0.0; width],
        };
        if let Some(differences) = &estimate.from_coarser {
            differences.mean(y, &mut row.mean);
            differences.mean_square(y, &mut row.mean_square);
        }
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

    /// Mean squared difference of the estimate of scale `k` from that of the next finer one, noise
    /// included; 0 where there is none.
    fn unlike_finer(&self, k: usize, x: usize) -> f32 {
        let finer = k + 1;
        if finer < self.windows.len() && self.sigma(finer, x).is_finite() {
            self.differences[finer].mean_square[x]
        } else {
            0.0
        }
    }
}

/// Keep for every pixel the largest window that agrees with all smaller ones.
///
/// Agreement allows a bias of about the noise of the finer window, which `Field::unlike_finer` shows.
pub fn select(estimates: &[Estimate], width: usize, confidence: f32) -> Field {
    let n = estimates[0].displacement.len();
    let mut field = Field {
        displacement: vec![f32::NAN; n],
        sigma: vec![f32::NAN; n],
        modulation_ratio: vec![f32::NAN; n],
        offset: vec![f32::NAN; n],
        unlike_finer: vec![0.0; n],
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
        .zip(field.unlike_finer.par_chunks_mut(width))
        .zip(field.scale.par_chunks_mut(width))
        .enumerate()
        .for_each(
            |(y, (((((displacement, sigma), ratio), offset), unlike), scale))| {
                let row = Row::new(estimates, y, width);
                for x in 0..width {
                    let Some(k) = (0..estimates.len()).find(|k| row.agrees(*k, x, confidence))
                    else {
                        continue;
                    };
                    let kept = &row.windows[k];
                    displacement[x] = estimates[k].displacement[y * width + x];
                    sigma[x] = row.sigma(k, x);
                    unlike[x] = row.unlike_finer(k, x);
                    ratio[x] = kept.modulation_ratio[x];
                    offset[x] = kept.offset[x];
                    scale[x] = k as u8;
                }
            },
        );
    field
}
