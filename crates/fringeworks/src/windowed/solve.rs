//! The five-parameter normal equations of one window: offset a, gain b and the affine displacement
//! (δ, δ_x, δ_y), all linear once the displacement is multiplied by the gain.

use super::moments::{self as m, NodeRow, Window};

/// What a window already believes about offset and gain, and how strongly.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
    pub offset: f32,
    pub gain: f32,
    pub offset_variance: f32,
    pub gain_variance: f32,
    /// Variance of the residual in the coarser window.
    pub residual: f32,
}

/// The least-squares solution of one window.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// Correction of the displacement at the node, px.
    pub delta: f32,
    /// Its slope along x and y, px/px.
    pub slope: [f32; 2],
    pub gain: f32,
    /// Standard deviation of the displacement, px (one Gauss–Newton step).
    pub sigma: f32,
    /// Whether the window determines the displacement.
    pub determined: bool,
    /// What the next finer window starts from.
    pub prior: Prior,
}

/// Noise and limits, in normalised intensities (modulation of the reference = 1) and px.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    pub object_noise: f64,
    pub reference_noise: f64,
    /// Variance of a mean of many pixels' noise over that of independent noise; at least 1.
    pub noise_correlation: f64,
    /// How far offset and gain are expected to drift from one scale to the next.
    pub drift: f64,
    /// Largest σ of a displacement that is still worth using, px.
    pub max_sigma: f64,
    /// Smallest share of the local signal that the model must explain.
    pub min_explained: f64,
}

const N: usize = 5;
const RIDGE: f64 = 1e-9;
/// A window is fitted again with a weaker grip on its data where the residual exceeds what was
/// believed by this factor …
const REFIT_ABOVE: f64 = 1.5;
/// … at most so often.
const MAX_REFITS: usize = 3;

/// Lower Cholesky factor of a symmetric matrix whose diagonal is 1 + ridge.
fn cholesky(a: &mut [[f64; N]; N]) {
    for j in 0..N {
        for k in 0..j {
            for i in j..N {
                a[i][j] -= a[i][k] * a[j][k];
            }
        }
        let pivot = a[j][j].max(RIDGE * 1e-3).sqrt();
        for row in a.iter_mut().skip(j) {
            row[j] /= pivot;
        }
        a[j][j] = pivot;
    }
}

/// Inverse of a lower triangular matrix.
fn invert_lower(l: &[[f64; N]; N]) -> [[f64; N]; N] {
    let mut inverse = [[0.0; N]; N];
    for j in 0..N {
        inverse[j][j] = 1.0 / l[j][j];
        for i in j + 1..N {
            let sum: f64 = (j..i).map(|k| l[i][k] * inverse[k][j]).sum();
            inverse[i][j] = -sum / l[i][i];
        }
    }
    inverse
}

/// A solved system, with what its variances need.
struct Fit {
    solution: [f64; N],
    inverse: [[f64; N]; N],
    scale: [f64; N],
}

impl Fit {
    /// Solve `a x = r` with offset and gain pulled towards the prior; `believed` is the variance
    /// of the data's mean, in whose units the prior's variances are taken.
    fn new(a: &[[f64; N]; N], r: &[f64; N], prior: &Prior, believed: f64) -> Self {
        let mut full = *a;
        let mut rhs = *r;
        let pulls = [
            (prior.offset, prior.offset_variance),
            (prior.gain, prior.gain_variance),
        ];
        for (k, (centre, variance)) in pulls.into_iter().enumerate() {
            let pull = believed / variance as f64;
            full[k][k] += pull;
            rhs[k] += pull * centre as f64;
        }
        let scale: [f64; N] = std::array::from_fn(|k| full[k][k].max(1e-30).sqrt());
        for j in 0..N {
            for k in 0..N {
                full[j][k] /= scale[j] * scale[k];
            }
            full[j][j] += RIDGE;
            rhs[j] /= scale[j];
        }
        cholesky(&mut full);
        let inverse = invert_lower(&full);
        let half: [f64; N] = std::array::from_fn(|j| (0..=j).map(|k| inverse[j][k] * rhs[k]).sum());
        let solution = std::array::from_fn(|j| {
            (j..N).map(|k| inverse[k][j] * half[k]).sum::<f64>() / scale[j]
        });
        Self {
            solution,
            inverse,
            scale,
        }
    }

    /// Diagonal entry of the system's inverse.
    fn variance_factor(&self, j: usize) -> f64 {
        (j..N).map(|k| self.inverse[k][j].powi(2)).sum::<f64>() / self.scale[j].powi(2)
    }
}

/// Solve the window at column `i` of a gathered row of nodes.
///
/// Unknowns in the order (a, b, b δ_x, b δ_y, b δ); regressors (1, s, −x g, −y g, −g).
pub fn solve(row: &NodeRow, i: usize, window: &Window, prior: &Prior, limits: &Limits) -> Node {
    let q = |channel: usize| row.get(channel, i);
    let weight = q(m::M);
    let undetermined = Node {
        delta: 0.0,
        slope: [0.0; 2],
        gain: prior.gain,
        sigma: f32::INFINITY,
        determined: false,
        prior: *prior,
    };
    let independent_pixels = window.effective_pixels / limits.noise_correlation;
    let count = independent_pixels * weight;
    if count < 2.0 * N as f64 {
        return undetermined;
    }
    let a = [
        [weight, q(m::S), -q(m::GX), -q(m::GY), -q(m::G)],
        [
            q(m::S),
            q(m::SS),
            -q(m::GX + 1),
            -q(m::GY + 1),
            -q(m::G + 1),
        ],
        [
            -q(m::GX),
            -q(m::GX + 1),
            q(m::GGXX),
            q(m::GGXY),
            q(m::GX + 3),
        ],
        [
            -q(m::GY),
            -q(m::GY + 1),
            q(m::GGXY),
            q(m::GGYY),
            q(m::GY + 3),
        ],
        [-q(m::G), -q(m::G + 1), q(m::GX + 3), q(m::GY + 3), q(m::GG)],
    ];
    let r = [
        q(m::D),
        q(m::DS),
        -q(m::GX + 2),
        -q(m::GY + 2),
        -q(m::G + 2),
    ];

    // The prior counts for as much as the residual is large. Where this window turns out worse
    // explained than the coarser one, its data must not overrule the prior: fit again.
    let spread = (1.0 - N as f64 / count).max(0.2);
    let residual_of = |x: &[f64; N]| {
        let quadratic: f64 = (0..N)
            .map(|j| x[j] * ((0..N).map(|k| a[j][k] * x[k]).sum::<f64>() - 2.0 * r[j]))
            .sum();
        ((q(m::DD) + quadratic) / weight / spread).max(limits.object_noise)
    };
    let mut believed = prior.residual as f64;
    let mut fit = Fit::new(&a, &r, prior, believed / independent_pixels);
    let mut residual = residual_of(&fit.solution);
    for _ in 0..MAX_REFITS {
        if residual <= REFIT_ABOVE * believed {
            break;
        }
        believed = residual;
        fit = Fit::new(&a, &r, prior, believed / independent_pixels);
        residual = residual_of(&fit.solution);
    }
    let x = fit.solution;
    let gain = x[1];
    let noise = residual + gain * gain * limits.reference_noise;
    let [var_offset, var_gain, var_shift] =
        [0, 1, 4].map(|j| noise * fit.variance_factor(j) / independent_pixels);
    let sigma = var_shift.sqrt() / gain.abs().max(1e-6);
    let determined = sigma < limits.max_sigma
        && gain > 3.0 * var_gain.sqrt()
        && residual < (1.0 - limits.min_explained) * 0.5 * gain * gain + limits.object_noise;
    if !determined {
        return Node {
            sigma: f32::INFINITY,
            ..undetermined
        };
    }
    // What the model leaves over beyond the noise says how far offset and gain may be off locally.
    let excess = (residual - 1.2 * limits.object_noise).max(0.0);
    let drift = limits.drift * limits.drift;
    Node {
        delta: (x[4] / gain) as f32,
        slope: [(x[2] / gain) as f32, (x[3] / gain) as f32],
        gain: gain as f32,
        sigma: sigma as f32,
        determined,
        prior: Prior {
            offset: x[0] as f32,
            gain: gain as f32,
            offset_variance: (excess + drift + var_offset) as f32,
            gain_variance: (excess + drift + var_gain) as f32,
            residual: residual as f32,
        },
    }
}
