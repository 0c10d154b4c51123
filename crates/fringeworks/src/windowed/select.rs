//! Choice of the window of every pixel (Lepski's rule).

use super::lattice::Differences;
use super::{Field, NO_SCALE};
use rayon::prelude::*;

/// Share of what varies in the steps to an estimate that is left of the error before them.
///
/// A step removes an error that is constant in its window. Where the step varies, so does the error,
/// and a part is left: 0.02 to 0.14 on simulated curved surfaces, more on peaks.
const LEFT_OF_START: f32 = 0.3;

/// Estimates of one scale, one value per pixel.
pub struct Estimate {
    /// Displacement, px.
    pub displacement: Vec<f32>,
    /// Standard deviation, px; infinite where the window does not determine the displacement.
    pub sigma: Vec<f32>,
    pub modulation_ratio: Vec<f32>,
    pub offset: Vec<f32>,
    /// Displacement of this scale minus that of the next coarser one, or of the start, px.
    pub from_coarser: Differences,
}

/// Whether the estimate of scale `k` agrees with those of all finer scales at pixel (x, y) of index
/// `i`.
///
/// The differences are averaged over the blocks of the coarser window: that averages the noise of the
/// finer estimate, but not its bias. An undetermined window contradicts nothing.
fn agrees(estimates: &[Estimate], k: usize, x: usize, y: usize, i: usize, confidence: f32) -> bool {
    if !estimates[k].sigma[i].is_finite() {
        return false;
    }
    let mut difference = 0.0;
    estimates[k..].windows(2).all(|pair| {
        difference += pair[1].from_coarser.mean(x, y);
        difference.abs() <= confidence * pair[1].sigma[i]
    })
}

/// Variance of the estimate of scale `k`: its noise, its bias, and what one step leaves of the start.
///
/// σ_k² + max(0, G ∗ (u_{k+1} − u_k)² − σ_{k+1}²) + η² Σ_{j ≤ k} var_G(u_j − u_{j−1}): what the
/// finer window sees differently beyond its own noise, and a share of what varies in the steps that
/// led here.
fn variance(estimates: &[Estimate], k: usize, x: usize, y: usize, i: usize) -> f32 {
    let kept = &estimates[k];
    let finer = estimates.get(k + 1).filter(|e| e.sigma[i].is_finite());
    let bias = finer.map_or(0.0, |finer| {
        (finer.from_coarser.mean_square(x, y) - finer.sigma[i].powi(2)).max(0.0)
    });
    let moved: f32 = estimates[..=k]
        .iter()
        .map(|estimate| estimate.from_coarser.variance(x, y))
        .sum();
    let left = LEFT_OF_START.powi(2) * moved;
    kept.sigma[i].powi(2) + bias + left
}

/// Keep for every pixel the largest window that agrees with all smaller ones.
///
/// Agreement allows a bias of about the noise of the finer window: see `variance`.
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
            for x in 0..width {
                let i = y * width + x;
                let Some(k) =
                    (0..estimates.len()).find(|k| agrees(estimates, *k, x, y, i, confidence))
                else {
                    continue;
                };
                let kept = &estimates[k];
                displacement[x] = kept.displacement[i];
                sigma[x] = variance(estimates, k, x, y, i).sqrt();
                ratio[x] = kept.modulation_ratio[i];
                offset[x] = kept.offset[i];
                scale[x] = k as u8;
            }
        });
    field
}
