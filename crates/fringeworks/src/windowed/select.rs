//! Choice of the window of every pixel (Lepski's rule).

use super::lattice::BlockMeans;
use super::{Field, NO_SCALE};
use rayon::prelude::*;

/// Estimates of one scale, one value per pixel.
pub struct Estimate {
    /// Displacement, px.
    pub displacement: Vec<f32>,
    /// Standard deviation, px; infinite where the window does not determine the displacement.
    pub sigma: Vec<f32>,
    pub modulation_ratio: Vec<f32>,
    pub offset: Vec<f32>,
    /// Displacement of the next finer scale minus that of this scale, averaged over blocks, px.
    pub disagreement: Option<BlockMeans>,
}

impl Estimate {
    fn disagreement_at(&self, x: usize, y: usize) -> f32 {
        self.disagreement
            .as_ref()
            .map_or(0.0, |means| means.at(x, y))
    }
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
        difference += pair[0].disagreement_at(x, y);
        difference.abs() <= confidence * pair[1].sigma[i]
    })
}

/// Keep for every pixel the largest window that agrees with all smaller ones.
///
/// Agreement allows a bias of about the noise of the finer window. The error bar therefore includes
/// the mean difference to the next finer window: σ² + (mean difference)².
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
                let bias = kept.disagreement_at(x, y);
                displacement[x] = kept.displacement[i];
                sigma[x] = kept.sigma[i].hypot(bias);
                ratio[x] = kept.modulation_ratio[i];
                offset[x] = kept.offset[i];
                scale[x] = k as u8;
            }
        });
    field
}
