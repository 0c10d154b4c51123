//! The five-parameter normal equations of one window (theory §4).
//!
//! The unknowns are the offset a, the modulation ratio b and the affine displacement (δ, δ_x, δ_y).
//! The model is linear in all of them once the displacement is multiplied by b.

use super::moments::{self as m, NodeRow, Window};

/// Number of unknowns.
const UNKNOWNS: usize = 5;

/// Added to the diagonal of the scaled normal matrix, whose entries are about 1.
///
/// Far below any information in the data, and far above the rounding of f64: keeps singular windows
/// solvable, which are rejected afterwards.
const RIDGE: f64 = 1e-9;

/// Least squared pivot of the Cholesky factor, as a share of [`RIDGE`]: bounds rounding errors.
const MIN_PIVOT: f64 = 1e-3;

/// Least diagonal entry of the normal matrix, so that an empty row can be scaled.
const MIN_DIAGONAL: f64 = 1e-30;

/// Ratio of the residual's variance to the expected one above which a window is fitted again with
/// less weight on its data. An empirical choice: a ratio nearer to 1 fits most windows twice.
const REFIT_RATIO: f64 = 1.5;

/// Largest number of repeated fits: each one multiplies the expected variance, and three suffice for
/// windows across an edge.
const MAX_REFITS: usize = 3;

/// Least number of independent pixels per unknown.
const MIN_PIXELS_PER_UNKNOWN: f64 = 2.0;

/// Least share of the residual's degrees of freedom, which its variance is divided by. A window of
/// few pixels would otherwise divide by almost nothing.
const MIN_FREEDOM: f64 = 0.2;

/// Least modulation ratio in standard deviations of its noise.
const MIN_RATIO_SIGMAS: f64 = 3.0;

/// Least modulation ratio that σ is divided by, so that it stays finite.
const MIN_RATIO: f64 = 1e-6;

/// Factor on the object's noise up to which a residual counts as noise, not as an error of the model:
/// the scatter of a variance estimated from a small window.
const NOISE_SCATTER: f64 = 1.2;

/// Offset and modulation ratio that a window expects, and their uncertainty.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
    pub offset: f32,
    pub modulation_ratio: f32,
    pub offset_variance: f32,
    pub ratio_variance: f32,
    /// Variance of the residual in the coarser window.
    pub residual: f32,
}

/// The least-squares solution of one window.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// Correction of the displacement at the node, px.
    pub delta: f32,
    /// Slope of the correction along x and y, px/px.
    pub slope: [f32; 2],
    /// Modulation of the object over modulation of the reference.
    pub modulation_ratio: f32,
    /// Standard deviation of the displacement, px (one Gauss–Newton step).
    pub sigma: f32,
    /// Whether the window determines the displacement.
    pub determined: bool,
    /// Prior of the next finer window.
    pub prior: Prior,
}

impl Node {
    /// A window that does not determine the displacement and passes its prior on.
    pub fn undetermined(prior: &Prior) -> Self {
        Self {
            delta: 0.0,
            slope: [0.0; 2],
            modulation_ratio: prior.modulation_ratio,
            sigma: f32::INFINITY,
            determined: false,
            prior: *prior,
        }
    }
}

/// Noise and limits, in normalised intensities (modulation of the reference = 1) and px.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Variance of the object's noise.
    pub object_noise: f64,
    /// Variance of the reference's noise.
    pub reference_noise: f64,
    /// What smoothing has left of it in single pixels, and so in the residual. The mean over a window has
    /// all of it: low frequencies are not smoothed away.
    pub reference_left: f64,
    /// Variance of a mean of many pixels' noise over that of independent noise; at least 1.
    pub noise_correlation: f64,
    /// Expected change of offset and modulation ratio from one scale to the next.
    pub drift: f64,
    /// Largest useful σ of a displacement, px.
    pub max_sigma: f64,
    /// Least share of the local signal that the model must explain.
    pub min_explained: f64,
}

type Vector = [f64; UNKNOWNS];
type Matrix = [Vector; UNKNOWNS];

/// Lower Cholesky factor of a symmetric matrix whose diagonal is 1 + ridge.
fn cholesky(a: &mut Matrix) {
    for j in 0..UNKNOWNS {
        for k in 0..j {
            for i in j..UNKNOWNS {
                a[i][j] -= a[i][k] * a[j][k];
            }
        }
        let pivot = a[j][j].max(RIDGE * MIN_PIVOT).sqrt();
        for row in a.iter_mut().skip(j) {
            row[j] /= pivot;
        }
        a[j][j] = pivot;
    }
}

/// Inverse of a lower triangular matrix.
fn invert_lower(l: &Matrix) -> Matrix {
    let mut inverse = [[0.0; UNKNOWNS]; UNKNOWNS];
    for j in 0..UNKNOWNS {
        inverse[j][j] = 1.0 / l[j][j];
        for i in j + 1..UNKNOWNS {
            let sum: f64 = (j..i).map(|k| l[i][k] * inverse[k][j]).sum();
            inverse[i][j] = -sum / l[i][i];
        }
    }
    inverse
}

/// A solved system.
struct Fit {
    solution: Vector,
    /// Inverse of the Cholesky factor of the scaled system.
    inverse: Matrix,
    /// Scale of every unknown.
    scale: Vector,
}

impl Fit {
    /// Solve `a x = r` with offset and modulation ratio pulled towards the prior; `expected` is the
    /// variance of the mean of the data, the unit of the prior's variances.
    fn new(a: &Matrix, r: &Vector, prior: &Prior, expected: f64) -> Self {
        let mut full = *a;
        let mut rhs = *r;
        let pulls = [
            (prior.offset, prior.offset_variance),
            (prior.modulation_ratio, prior.ratio_variance),
        ];
        for (k, (centre, variance)) in pulls.into_iter().enumerate() {
            let pull = expected / variance as f64;
            full[k][k] += pull;
            rhs[k] += pull * centre as f64;
        }
        let scale: Vector = std::array::from_fn(|k| full[k][k].max(MIN_DIAGONAL).sqrt());
        for j in 0..UNKNOWNS {
            for k in 0..UNKNOWNS {
                full[j][k] /= scale[j] * scale[k];
            }
            full[j][j] += RIDGE;
            rhs[j] /= scale[j];
        }
        cholesky(&mut full);
        let inverse = invert_lower(&full);
        let half: Vector = std::array::from_fn(|j| (0..=j).map(|k| inverse[j][k] * rhs[k]).sum());
        let solution = std::array::from_fn(|j| {
            (j..UNKNOWNS).map(|k| inverse[k][j] * half[k]).sum::<f64>() / scale[j]
        });
        Self {
            solution,
            inverse,
            scale,
        }
    }

    /// Diagonal entry `j` of the inverse of the system.
    fn variance_factor(&self, j: usize) -> f64 {
        (j..UNKNOWNS)
            .map(|k| self.inverse[k][j].powi(2))
            .sum::<f64>()
            / self.scale[j].powi(2)
    }
}

/// The data of one window.
struct Equations {
    a: Matrix,
    r: Vector,
    /// Weighted sum of the squared object samples.
    square: f64,
    /// Share of the window that has data.
    weight: f64,
    /// Mean β² of the pixels with data.
    albedo_square: f64,
}

impl Equations {
    /// Unknowns in the order (a, b, b δ_x, b δ_y, b δ); regressors (1, s, −x g, −y g, −g).
    fn new(row: &NodeRow, i: usize) -> Self {
        let q = |channel: usize| row.get(channel, i);
        let (s, g, gx, gy) = (q(m::S), q(m::G), q(m::GX), q(m::GY));
        let (sg, sgx, sgy) = (q(m::G + 1), q(m::GX + 1), q(m::GY + 1));
        let (gg, ggx, ggy) = (q(m::GG), q(m::GX + 3), q(m::GY + 3));
        let (xx, xy, yy) = (q(m::GGXX), q(m::GGXY), q(m::GGYY));
        let (square, weight) = (q(m::M), q(m::COUNT));
        Self {
            a: [
                [square, s, -gx, -gy, -g],
                [s, q(m::SS), -sgx, -sgy, -sg],
                [-gx, -sgx, xx, xy, ggx],
                [-gy, -sgy, xy, yy, ggy],
                [-g, -sg, ggx, ggy, gg],
            ],
            r: [
                q(m::D),
                q(m::DS),
                -q(m::GX + 2),
                -q(m::GY + 2),
                -q(m::G + 2),
            ],
            square: q(m::DD),
            weight,
            albedo_square: square / weight,
        }
    }

    /// Variance of the residual of a solution; `freedom` is the share of degrees of freedom.
    fn residual(&self, x: &Vector, freedom: f64, noise: f64) -> f64 {
        let product = |j: usize| (0..UNKNOWNS).map(|k| self.a[j][k] * x[k]).sum::<f64>();
        let quadratic: f64 = (0..UNKNOWNS)
            .map(|j| x[j] * (product(j) - 2.0 * self.r[j]))
            .sum();
        ((self.square + quadratic) / self.weight / freedom).max(noise)
    }

    /// Solution and variance of its residual.
    ///
    /// The prior counts the more, the larger the residual is expected to be. Where this window's
    /// residual exceeds that of the coarser window, its data must not overrule the prior: the window
    /// is fitted again with the larger variance.
    fn solve(&self, prior: &Prior, pixels: f64, limits: &Limits) -> (Fit, f64) {
        let count = pixels * self.weight;
        let freedom = (1.0 - UNKNOWNS as f64 / count).max(MIN_FREEDOM);
        let fit_to = |expected: f64| {
            let fit = Fit::new(&self.a, &self.r, prior, expected / pixels);
            let residual = self.residual(&fit.solution, freedom, limits.object_noise);
            (fit, residual)
        };
        let mut expected = prior.residual as f64;
        let (mut fit, mut residual) = fit_to(expected);
        for _ in 0..MAX_REFITS {
            if residual <= REFIT_RATIO * expected {
                break;
            }
            expected = residual;
            (fit, residual) = fit_to(expected);
        }
        (fit, residual)
    }
}

/// Solve the window at column `i` of a gathered row of nodes.
pub fn solve(row: &NodeRow, i: usize, window: &Window, prior: &Prior, limits: &Limits) -> Node {
    let undetermined = Node::undetermined(prior);
    let pixels = window.effective_pixels / limits.noise_correlation;
    if pixels * row.get(m::COUNT, i) < MIN_PIXELS_PER_UNKNOWN * UNKNOWNS as f64 {
        return undetermined;
    }
    let equations = Equations::new(row, i);
    let (fit, residual) = equations.solve(prior, pixels, limits);
    let x = fit.solution;
    let ratio = x[1];
    // Mean square of the factor β b, by which the reference appears in the object.
    let factor = ratio * ratio * equations.albedo_square;
    let of_object = (residual - factor * limits.reference_left).max(limits.object_noise);
    let noise = of_object + factor * limits.reference_noise;
    let [var_offset, var_ratio, var_shift] =
        [0, 1, 4].map(|j| noise * fit.variance_factor(j) / pixels);
    let sigma = var_shift.sqrt() / ratio.abs().max(MIN_RATIO);
    // The mean square of a fringe of modulation β b is half its square.
    let determined = sigma < limits.max_sigma
        && ratio > MIN_RATIO_SIGMAS * var_ratio.sqrt()
        && residual < (1.0 - limits.min_explained) * 0.5 * factor + limits.object_noise;
    if !determined {
        return undetermined;
    }
    // A residual beyond the noise shows by how much offset and modulation ratio may vary locally.
    let excess = (residual - NOISE_SCATTER * limits.object_noise).max(0.0);
    let drift = limits.drift * limits.drift;
    Node {
        delta: (x[4] / ratio) as f32,
        slope: [(x[2] / ratio) as f32, (x[3] / ratio) as f32],
        modulation_ratio: ratio as f32,
        sigma: sigma as f32,
        determined,
        prior: Prior {
            offset: x[0] as f32,
            modulation_ratio: ratio as f32,
            offset_variance: (excess + drift + var_offset) as f32,
            ratio_variance: (excess + drift + var_ratio) as f32,
            residual: residual as f32,
        },
    }
}
