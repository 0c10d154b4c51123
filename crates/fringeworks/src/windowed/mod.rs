//! Windowed inversion: the displacement u with d(x) = a + b·s(x − u), by local least squares (theory
//! §4).
//!
//! The field u is warped densely and refined by Gauss–Newton steps from large windows to small ones.
//! Every window size gives an estimate and its σ. Each pixel keeps the largest window whose estimate
//! agrees with those of all smaller ones (Lepski's rule, known in imaging as the intersection of
//! confidence intervals).

mod grid;
mod lattice;
mod moments;
mod noise;
mod select;
mod sight;
mod solve;
mod surfaces;
mod walls;
mod warp;

use crate::{Error, Image, MIN_PERIOD, check_shape, check_value};
use grid::{Blended, Grid};
use lattice::{Differences, Lattice};
use moments::Window;
use rayon::prelude::*;
use select::{Estimate, select};
pub use solve::Limits;
use solve::Prior;
pub use surfaces::{Search, Surfaces, relocate_surfaces, wall_sides};
use walls::Walls;
pub use walls::smooth_within_walls;
pub use warp::{Pair, warp_windowed};

/// Options of the refinement.
#[derive(Clone, Debug)]
pub struct Options {
    /// Gaussian window widths σ in px, from coarse to fine.
    pub scales: Vec<f64>,
    /// Gauss–Newton steps per scale.
    pub iterations: usize,
    /// Fringe period of the reference, px.
    pub period: f64,
    /// Half-width of the confidence intervals of Lepski's rule, in σ.
    pub confidence: f64,
    /// Noise, and when a window determines the displacement.
    pub limits: Limits,
}

/// Maps with one value per pixel; NaN where no window determined the displacement.
pub struct Field {
    /// Displacement, px.
    pub displacement: Vec<f32>,
    /// Standard deviation of the noise of the kept window, px; its bias is not part of it.
    pub sigma: Vec<f32>,
    /// Modulation of the object over modulation of the reference.
    pub modulation_ratio: Vec<f32>,
    /// Level of the object above that of the reference times the modulation ratio, in modulations.
    pub offset: Vec<f32>,
    /// Mean squared difference from the displacement of the next finer windows, px²; 0 where none
    /// determine it.
    pub unlike_finer: Vec<f32>,
    /// Index into [`Options::scales`] of the window that was kept; 255 where none.
    pub scale: Vec<u8>,
    /// Variance of a mean of many pixels' noise over that of independent noise.
    pub noise_correlation: f64,
    /// What windows of about half a period leave of the object frame, in modulations; NaN without data.
    pub misfit: Vec<f32>,
}

/// Scale of a pixel that no window determined: the largest `u8`.
const NO_SCALE: u8 = 255;

/// Widths σ of windows that make sense, px: below, a window has fewer pixels than unknowns; above, it
/// exceeds any frame.
const SCALE_RANGE: std::ops::RangeInclusive<f64> = 0.8..=1e4;

/// Largest number of Gauss–Newton steps per scale; more steps only add noise.
const MAX_ITERATIONS: usize = 100;

/// Largest step of a displacement, in periods: the linearisation of a cosine holds no further.
const MAX_STEP_PERIODS: f64 = 0.25;

/// Largest window, in periods, whose misfit is told. That of a larger one is dominated by its own bias.
const MISFIT_WINDOW_PERIODS: f64 = 0.5;

/// Prior of the coarsest windows: it allows any offset and modulation ratio that a scene shows, in
/// units of the reference's modulation.
const LOOSE: Prior = Prior {
    offset: 0.0,
    modulation_ratio: 1.0,
    offset_variance: 1.0,
    ratio_variance: 1.0,
    residual: 0.01,
};

/// Factor by which repeated steps at one scale raise σ over that of a single step.
///
/// K steps about a densely warped field apply 1 − (1 − S)^K instead of the smoother S: with every step
/// the bias falls and the noise rises. For a Gaussian S in two dimensions the factor is
/// √(Σ_jk c_j c_k 2/(j + k)) with c_j = −(−1)^j · binomial(K, j).
fn noise_amplification(steps: usize) -> f64 {
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

fn check(
    pair: &Pair,
    walls: Option<Image<u8>>,
    start: Image<f32>,
    options: &Options,
) -> Result<(), Error> {
    pair.check()?;
    check_shape("start", start.shape(), pair.object.shape())?;
    if let Some(walls) = walls {
        check_shape("walls", walls.shape(), pair.object.shape())?;
    }
    check_value(
        "scales",
        !options.scales.is_empty()
            && options.scales.len() < NO_SCALE as usize
            && options.scales.iter().all(|s| SCALE_RANGE.contains(s)),
        "1 to 254 widths between 0.8 and 10000 px",
        &options.scales,
    )?;
    check_value(
        "iterations",
        (1..=MAX_ITERATIONS).contains(&options.iterations),
        "1 to 100",
        options.iterations,
    )?;
    check_value(
        "period",
        options.period >= MIN_PERIOD,
        "at least 2 px",
        options.period,
    )
}

/// Refine the displacement `start` (px) of every pixel.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::windowed::{Limits, Options, Pair, invert_windowed};
///
/// // Object and reference are cosines of 20 px; the object is 1.5 px to the right. Of a cosine, the
/// // coefficients of the spline are samples over (2 + cos ω) / 3.
/// let wave = |x: f32| (std::f32::consts::TAU * x / 20.0).cos();
/// let factor = 3.0 / (2.0 + wave(1.0));
/// let (h, w) = (40, 60);
/// let spline: Vec<f32> = (0..h * (w + 3)).map(|i| factor * wave((i % (w + 3)) as f32 - 1.0)).collect();
/// let object: Vec<f32> = (0..h * w).map(|i| wave((i % w) as f32 - 1.5)).collect();
/// let ok = vec![1; h * w];
/// let pair = Pair {
///     spline: Image::new(&spline, h, w + 3)?,
///     object: Image::new(&object, h, w)?,
///     reference_ok: Image::new(&ok, h, w)?,
///     object_ok: Image::new(&ok, h, w)?,
///     albedo: None,
/// };
/// let options = Options {
///     scales: vec![8.0, 4.0],
///     iterations: 2,
///     period: 20.0,
///     confidence: 2.5,
///     limits: Limits {
///         object_noise: 1e-4,
///         reference_noise: 1e-4,
///         reference_left: 1e-4,
///         noise_correlation: 1.0,
///         drift: 0.01,
///         max_sigma: 0.8,
///         min_explained: 0.3,
///     },
/// };
/// let start = vec![0.0; h * w];
/// let found = invert_windowed(&pair, None, Image::new(&start, h, w)?, &options)?;
/// assert!((found.displacement[20 * w + 30] - 1.5).abs() < 0.01);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn invert_windowed(
    pair: &Pair,
    walls: Option<Image<u8>>,
    start: Image<f32>,
    options: &Options,
) -> Result<Field, Error> {
    check(pair, walls, start, options)?;
    let walls = walls.map(Walls::new);
    let open = walls.as_ref().map(|walls| walls.without(&pair.object_ok));
    let seen = match &open {
        None => *pair,
        Some(open) => Pair {
            object_ok: Image::new(open, pair.height(), pair.width())?,
            ..*pair
        },
    };
    let found = refine(pair, &seen, walls.as_ref(), &start, options);
    let mut field = select(&found.estimates, pair.width(), options.confidence as f32);
    field.noise_correlation = found.noise_correlation;
    field.misfit = found.misfit;
    Ok(field)
}

/// The Gauss–Newton steps of one scale. Updates `u` and returns the windows of the last step, and
/// whether they determine the displacement of each pixel.
fn descend<'a>(
    pair: &Pair,
    walls: Option<&'a Walls<'a>>,
    u: &mut [f32],
    scale: usize,
    coarser: Option<&Grid>,
    options: &Options,
) -> (Grid<'a>, Vec<bool>) {
    let window = Window::new(options.scales[scale]);
    let has_finer = scale + 1 < options.scales.len();
    let max_step = MAX_STEP_PERIODS as f32 * options.period as f32;
    let mut determined = vec![false; u.len()];
    let mut last = None;
    for _ in 0..options.iterations {
        let grid = Grid::solve(pair, walls, u, &window, coarser, has_finer, &options.limits);
        u.par_chunks_mut(pair.width())
            .zip(determined.par_chunks_mut(pair.width()))
            .enumerate()
            .for_each_init(
                || (Vec::new(), Blended::new(pair.width())),
                |(means, blended), (y, (u, determined))| {
                    grid.blend_row(y, means, blended);
                    for (x, u) in u.iter_mut().enumerate() {
                        *u += blended.delta[x].clamp(-max_step, max_step);
                        determined[x] = blended.sigma[x].is_finite();
                    }
                },
            );
        last = Some(grid);
    }
    (last.expect("there is at least one step"), determined)
}

/// Residual of every pixel at displacement `u`, with offset and modulation ratio of the windows; NaN
/// without data.
fn residuals(pair: &Pair, u: &[f32], grid: &Grid) -> Vec<f32> {
    let or = |value: f32, other: f32| if value.is_nan() { other } else { value };
    let mut out = vec![f32::NAN; pair.object.len()];
    out.par_chunks_mut(pair.width()).enumerate().for_each_init(
        || (Vec::new(), Blended::new(pair.width())),
        |(means, windows), (y, row)| {
            grid.blend_row(y, means, windows);
            for (x, residual) in row.iter_mut().enumerate() {
                let i = y * pair.width() + x;
                if let Some((value, _)) = pair.reference_at(x, y, u[i]) {
                    let ratio = or(windows.modulation_ratio[x], LOOSE.modulation_ratio);
                    let expected = or(windows.offset[x], LOOSE.offset) + ratio * value;
                    *residual = pair.object[i] - pair.albedo_at(i) * expected;
                }
            }
        },
    );
    out
}

/// Correlation of the object frame's noise between neighbouring pixels (a ratio of variances); at
/// least 1.
fn noise_correlation(pair: &Pair, residuals: &[f32], limits: &Limits) -> f64 {
    // Smoothing takes noise from the reference's pixels, but not from means over many of them.
    let single = limits.object_noise + limits.reference_left;
    let mean = limits.object_noise + limits.reference_noise;
    let found = noise::correlation(residuals, pair.height(), pair.width());
    (found * single / mean).max(1.0)
}

/// The scale whose misfit is told: the first that is small against the fringe.
fn misfit_scale(options: &Options) -> usize {
    let small = options
        .scales
        .iter()
        .position(|sigma| *sigma <= MISFIT_WINDOW_PERIODS * options.period);
    small.unwrap_or(options.scales.len() - 1)
}

/// What the descent over the scales found.
struct Refined<'a> {
    estimates: Vec<Estimate<'a>>,
    noise_correlation: f64,
    misfit: Vec<f32>,
}

/// The descent over the scales; windows use the pixels that are `seen`.
fn refine<'a>(
    pair: &Pair,
    seen: &Pair,
    walls: Option<&'a Walls<'a>>,
    start: &[f32],
    options: &Options,
) -> Refined<'a> {
    let factor = noise_amplification(options.iterations) as f32;
    let mut options = options.clone();
    let told = misfit_scale(&options);
    let mut u = start.to_vec();
    let mut misfit = Vec::new();
    let mut estimates: Vec<Estimate> = Vec::with_capacity(options.scales.len());
    for k in 0..options.scales.len() {
        let coarser = estimates.last().map(|estimate| &estimate.grid);
        let (grid, known) = descend(seen, walls, &mut u, k, coarser, &options);
        let mut widening = 1.0;
        if k == 0 || k == told {
            misfit = residuals(pair, &u, &grid);
        }
        if k == 0 {
            options.limits.noise_correlation = noise_correlation(pair, &misfit, &options.limits);
            // The first windows assumed independent noise.
            widening = options.limits.noise_correlation.sqrt() as f32;
        }
        let lattice = coarser.map_or(grid.lattice, |grid| grid.lattice);
        let from_coarser =
            (estimates.last()).map(|last| differences(pair, last, (&u, &known), lattice));
        estimates.iter_mut().for_each(Estimate::without_finer);
        estimates.push(Estimate {
            displacement: u.clone(),
            known,
            grid,
            widening: factor * widening,
            from_coarser,
        });
    }
    Refined {
        estimates,
        noise_correlation: options.limits.noise_correlation,
        misfit,
    }
}

/// How far the displacement, where it is known, has moved from that of the last scale.
fn differences(
    pair: &Pair,
    last: &Estimate,
    (u, known): (&[f32], &[bool]),
    lattice: Lattice,
) -> Differences {
    Differences::new(lattice, pair.height(), pair.width(), |i| {
        (last.known[i] && known[i]).then(|| u[i] - last.displacement[i])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_of_one_and_two_steps() {
        assert!((noise_amplification(1) - 1.0).abs() < 1e-12);
        assert!((noise_amplification(2).powi(2) - 11.0 / 6.0).abs() < 1e-12);
    }
}
