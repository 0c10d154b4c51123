//! Windowed inversion: the displacement u with d(x) = a + b·s(x − u), by local least squares.
//!
//! Theory §4, last item. The field u is warped densely and refined by Gauss–Newton from large
//! windows to small ones; every window size gives an estimate and its σ, and each pixel keeps the
//! largest window whose estimate agrees with those of all smaller ones (Lepski's rule, known in
//! imaging as the intersection of confidence intervals).

mod grid;
mod lattice;
mod moments;
mod noise;
mod relocate;
mod solve;
mod warp;

use crate::{check_length, check_value, Error};
use grid::Grid;
use lattice::{BlockMeans, Lattice};
use moments::Window;
use rayon::prelude::*;
use relocate::{relocate, residuals, Model};
pub use solve::Limits;
use solve::Prior;
pub use warp::Pair;

/// How to search.
#[derive(Clone, Debug)]
pub struct Options {
    /// Gaussian window widths σ in px, from coarse to fine.
    pub scales: Vec<f64>,
    /// Gauss–Newton steps per scale.
    pub iterations: usize,
    /// Fringe period of the reference, px.
    pub period: f64,
    /// Half-width of the confidence intervals, in σ.
    pub confidence: f64,
    pub limits: Limits,
}

/// The result, one value per pixel. NaN where no window determined the displacement.
pub struct Field {
    pub displacement: Vec<f32>,
    pub sigma: Vec<f32>,
    pub gain: Vec<f32>,
    /// Index into `Options::scales` of the window that was kept; 255 where none.
    pub scale: Vec<u8>,
    /// Variance of a mean of many pixels' noise over that of independent noise.
    pub noise_correlation: f64,
}

const NONE: u8 = 255;

/// By how much repeated steps at one scale raise σ over that of a single step.
///
/// K steps about a densely warped field apply 1 − (1 − S)^K instead of the smoother S: the bias
/// falls with every step and the noise rises. For a Gaussian S in two dimensions the noise gain is
/// √(Σ_jk c_j c_k 2/(j + k)) with c_j = −(−1)^j · binomial(K, j).
fn noise_gain(steps: usize) -> f64 {
    let mut coefficients = Vec::with_capacity(steps);
    let mut binomial = 1.0;
    for j in 1..=steps {
        binomial *= (steps + 1 - j) as f64 / j as f64;
        coefficients.push(if j % 2 == 1 { binomial } else { -binomial });
    }
    let mut sum = 0.0;
    for (j, cj) in coefficients.iter().enumerate() {
        for (k, ck) in coefficients.iter().enumerate() {
            sum += cj * ck * 2.0 / (j + k + 2) as f64;
        }
    }
    f64::sqrt(sum)
}

fn check(pair: &Pair, start: &[f32], options: &Options) -> Result<(), Error> {
    let n = pair.height * pair.width;
    check_value("width", pair.width >= 8, "at least 8 px", pair.width)?;
    check_value("height", pair.height >= 1, "at least 1 px", pair.height)?;
    check_length("spline", pair.spline.len(), pair.height * (pair.width + 3))?;
    check_length("object", pair.object.len(), n)?;
    check_length("reference_ok", pair.reference_ok.len(), n)?;
    check_length("object_ok", pair.object_ok.len(), n)?;
    check_length("start", start.len(), n)?;
    check_value(
        "scales",
        !options.scales.is_empty()
            && options.scales.len() < NONE as usize
            && options.scales.iter().all(|s| (0.8..=1e4).contains(s)),
        "1 to 254 widths between 0.8 and 10000 px",
        &options.scales,
    )?;
    check_value(
        "iterations",
        (1..=100).contains(&options.iterations),
        "1 to 100",
        options.iterations,
    )?;
    check_value(
        "period",
        options.period >= 2.0,
        "at least 2 px",
        options.period,
    )
}

/// One estimate per pixel and scale.
struct Estimate {
    displacement: Vec<f32>,
    sigma: Vec<f32>,
    gain: Vec<f32>,
    /// How far the next finer scale lies from this one, averaged over blocks.
    disagreement: Option<BlockMeans>,
}

impl Estimate {
    fn disagreement_at(&self, x: usize, y: usize) -> f32 {
        self.disagreement
            .as_ref()
            .map_or(0.0, |means| means.at(x, y))
    }
}

/// Refine the displacement `start` (px) of every pixel.
pub fn invert(pair: &Pair, start: &[f32], options: &Options) -> Result<Field, Error> {
    check(pair, start, options)?;
    let (estimates, noise_correlation) = refine(pair, start, options);
    let mut field = select(&estimates, pair.width, options.confidence as f32);
    field.noise_correlation = noise_correlation;
    Ok(field)
}

/// What is assumed of offset and gain before the first window has spoken.
const LOOSE: Prior = Prior {
    offset: 0.0,
    gain: 1.0,
    offset_variance: 1.0,
    gain_variance: 1.0,
    residual: 0.01,
};
/// Largest step of a displacement, px: the linearisation holds for a quarter period at most.
fn max_step(options: &Options) -> f32 {
    0.25 * options.period as f32
}

/// The Gauss–Newton steps of one scale; moves `u` and returns the last step's windows.
fn descend(
    pair: &Pair,
    u: &mut [f32],
    sigma: f64,
    coarser: Option<&Grid>,
    options: &Options,
) -> Grid {
    let window = Window::new(sigma);
    let solve = |u: &[f32]| Grid::solve(pair, u, &window, coarser, &LOOSE, &options.limits);
    let mut grid = solve(u);
    step(u, pair.width, &grid, max_step(options));
    for _ in 1..options.iterations {
        grid = solve(u);
        step(u, pair.width, &grid, max_step(options));
    }
    grid
}

/// The surface model of every pixel: the present field with offset and gain of a scale's windows.
fn model_of(pair: &Pair, u: &[f32], grid: &Grid) -> Model {
    let mut model = Model {
        displacement: u.to_vec(),
        offset: vec![LOOSE.offset; u.len()],
        gain: vec![LOOSE.gain; u.len()],
    };
    model
        .offset
        .par_chunks_mut(pair.width)
        .zip(model.gain.par_chunks_mut(pair.width))
        .enumerate()
        .for_each(|(y, (offset, gain))| {
            for x in 0..pair.width {
                if let Some(blend) = grid.blend(x, y) {
                    (offset[x], gain[x]) = (blend.offset, blend.gain);
                }
            }
        });
    model
}

/// How strongly the object frame's noise is tied together between neighbours; at least 1.
fn noise_correlation(pair: &Pair, model: &Model, limits: &Limits) -> f64 {
    // The reference's noise is smoothed, hence tied together, but has an account of its own.
    let own_account = limits.reference_noise / limits.object_noise;
    let left = residuals(pair, model);
    (noise::correlation(&left, pair.height, pair.width) - own_account).max(1.0)
}

/// Put cliffs in place that windows of width `sigma` have smeared. Returns whether there were any.
fn find_cliffs(pair: &Pair, u: &mut Vec<f32>, grid: &Grid, sigma: f64, options: &Options) -> bool {
    let mut model = model_of(pair, u, grid);
    let left = residuals(pair, &model);
    let distances = [1.0, 2.0, 3.0].map(|k| (k * sigma).round() as usize);
    let floor = options.limits.object_noise as f32;
    let half_period = 0.5 * options.period as f32;
    let found = relocate(pair, &mut model, &left, &distances, half_period, floor);
    *u = model.displacement;
    found
}

/// The scale after which cliffs are looked for: the first that is small against the fringe. A
/// larger window leaves over its own bias, which is no cliff.
fn cliff_scale(options: &Options) -> usize {
    let small = options
        .scales
        .iter()
        .position(|sigma| *sigma <= 0.5 * options.period);
    small.unwrap_or(options.scales.len() - 1)
}

fn refine(pair: &Pair, start: &[f32], options: &Options) -> (Vec<Estimate>, f64) {
    let factor = noise_gain(options.iterations) as f32;
    let mut options = options.clone();
    let cliffs_after = cliff_scale(&options);
    let mut u = start.to_vec();
    let mut coarser: Option<Grid> = None;
    let mut estimates: Vec<Estimate> = Vec::with_capacity(options.scales.len());
    for (k, sigma) in options.scales.clone().into_iter().enumerate() {
        let mut grid = descend(pair, &mut u, sigma, coarser.as_ref(), &options);
        let mut widening = 1.0;
        if k == 0 {
            let model = model_of(pair, &u, &grid);
            options.limits.noise_correlation = noise_correlation(pair, &model, &options.limits);
            // The first windows took the noise for independent.
            widening = options.limits.noise_correlation.sqrt() as f32;
        }
        if k == cliffs_after && find_cliffs(pair, &mut u, &grid, sigma, &options) {
            grid = descend(pair, &mut u, sigma, coarser.as_ref(), &options);
            widening = 1.0;
        }
        let finer = estimate(&u, pair.width, &grid, factor * widening);
        if let (Some(last), Some(grid)) = (estimates.last_mut(), &coarser) {
            compare(last, &finer, grid.lattice, pair);
        }
        estimates.push(finer);
        coarser = Some(grid);
    }
    (estimates, options.limits.noise_correlation)
}

/// Note where the finer scale systematically departs from the coarser one: bias, not noise.
fn compare(coarse: &mut Estimate, fine: &Estimate, lattice: Lattice, pair: &Pair) {
    let difference = |i: usize| {
        (coarse.sigma[i].is_finite() && fine.sigma[i].is_finite())
            .then(|| fine.displacement[i] - coarse.displacement[i])
    };
    let means = BlockMeans::new(lattice, pair.height, pair.width, difference);
    coarse.disagreement = Some(means);
}

fn step(u: &mut [f32], width: usize, grid: &Grid, max_step: f32) {
    u.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, u) in row.iter_mut().enumerate() {
            if let Some(blend) = grid.blend(x, y) {
                *u += blend.delta.clamp(-max_step, max_step);
            }
        }
    });
}

fn estimate(u: &[f32], width: usize, grid: &Grid, factor: f32) -> Estimate {
    let mut sigma = vec![f32::INFINITY; u.len()];
    let mut gain = vec![f32::NAN; u.len()];
    sigma
        .par_chunks_mut(width)
        .zip(gain.par_chunks_mut(width))
        .enumerate()
        .for_each(|(y, (sigma, gain))| {
            for x in 0..width {
                if let Some(blend) = grid.blend(x, y) {
                    sigma[x] = blend.sigma * factor;
                    gain[x] = blend.gain;
                }
            }
        });
    Estimate {
        displacement: u.to_vec(),
        sigma,
        gain,
        disagreement: None,
    }
}

/// Whether the estimate of scale `k` agrees with those of all finer scales at a pixel.
///
/// The differences are averaged over the coarser window's blocks: the finer estimate's noise
/// scatters there, its bias does not. An undetermined window contradicts nothing.
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

/// Per pixel: the first (largest) window that agrees with every later one.
///
/// Agreement leaves room for a bias of the order of the finer window's noise, so the error bar
/// takes up what the next finer window says of it: σ² + (mean difference)².
fn select(estimates: &[Estimate], width: usize, confidence: f32) -> Field {
    let n = estimates[0].displacement.len();
    let mut field = Field {
        displacement: vec![f32::NAN; n],
        sigma: vec![f32::NAN; n],
        gain: vec![f32::NAN; n],
        scale: vec![NONE; n],
        noise_correlation: 1.0,
    };
    field
        .displacement
        .par_chunks_mut(width)
        .zip(field.sigma.par_chunks_mut(width))
        .zip(field.gain.par_chunks_mut(width))
        .zip(field.scale.par_chunks_mut(width))
        .enumerate()
        .for_each(|(y, (((displacement, sigma), gain), scale))| {
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
                gain[x] = kept.gain[i];
                scale[x] = k as u8;
            }
        });
    field
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_gain_of_one_and_two_steps() {
        assert!((noise_gain(1) - 1.0).abs() < 1e-12);
        assert!((noise_gain(2).powi(2) - 11.0 / 6.0).abs() < 1e-12);
    }
}
