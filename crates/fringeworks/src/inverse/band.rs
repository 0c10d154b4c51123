//! Smoothing of a fringe row that passes the carrier and stops ripples that are finer than fringes.

/// Width of the smoothing (standard deviation of its Gaussian weights), periods.
///
/// The Gaussian passes exp(−2π² σ² f²): 0.82 of a fringe of the mean period, 0.58 and 0.93 of fringes
/// of 0.6 and 1.6 times that, and 0.17 of a ripple of a third of it. A projector shows a fringe on
/// three of its pixels or more, so its pixel grid is such a ripple. An empirical choice.
const SIGMA_PERIODS: f64 = 0.1;

/// Half the length of the smoothing, in standard deviations; the weights beyond sum to 0.3 %.
const REACH_SIGMAS: f64 = 3.0;

/// Least number of samples per period of the smoothed row.
///
/// Longer periods are averaged over whole pixels first, so that the cost does not grow with the
/// period. 24 samples follow fringes of 0.6 times the mean period with 14.
const MIN_SAMPLES_PER_PERIOD: f64 = 24.0;

/// The smoothing of rows for one fringe period.
pub struct Band {
    /// Pixels per sample of the smoothed row.
    pub step: usize,
    /// Weights of the centre and of the samples at a distance of 1, 2, … on either side.
    weights: Vec<f64>,
    // Used again from row to row.
    padded: Vec<f64>,
    smoothed: Vec<f64>,
}

impl Band {
    pub fn new(period: f64) -> Self {
        let step = ((period / MIN_SAMPLES_PER_PERIOD) as usize).max(1);
        let sigma = SIGMA_PERIODS * period / step as f64;
        let reach = (REACH_SIGMAS * sigma).ceil() as usize;
        let mut weights: Vec<f64> = (0..=reach)
            .map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp())
            .collect();
        let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
        weights.iter_mut().for_each(|w| *w /= sum);
        Self {
            step,
            weights,
            padded: Vec::new(),
            smoothed: Vec::new(),
        }
    }

    /// Standard deviation of smoothed white noise, over that of the noise.
    pub fn noise_share(&self) -> f64 {
        let centre = self.weights[0].powi(2);
        let beside: f64 = self.weights[1..].iter().map(|w| w * w).sum();
        ((centre + 2.0 * beside) / self.step as f64).sqrt()
    }

    /// The smoothed row, one sample for every `step` pixels.
    pub fn smooth(&mut self, y: &[f64]) -> &[f64] {
        let (reach, step) = (self.weights.len() - 1, self.step);
        let n = y.len().div_ceil(step);
        let padded = &mut self.padded;
        padded.clear();
        padded.resize(reach, 0.0);
        if step == 1 {
            padded.extend_from_slice(y);
        } else {
            padded.extend(
                y.chunks(step)
                    .map(|c| c.iter().sum::<f64>() / c.len() as f64),
            );
        }
        // Point reflection at the ends keeps the slope there. Mirrored, an extremum close to an end
        // would move onto it.
        let last = n - 1;
        let (start, end) = (padded[reach], padded[reach + last]);
        for k in 1..=reach {
            padded[reach - k] = 2.0 * start - padded[reach + k.min(last)];
            padded.push(2.0 * end - padded[reach + last - k.min(last)]);
        }
        self.smoothed.clear();
        self.smoothed
            .extend(padded[reach..reach + n].iter().map(|v| self.weights[0] * v));
        for (k, weight) in self.weights.iter().enumerate().skip(1) {
            let before = &padded[reach - k..reach - k + n];
            let behind = &padded[reach + k..reach + k + n];
            for ((out, a), b) in self.smoothed.iter_mut().zip(before).zip(behind) {
                *out += weight * (a + b);
            }
        }
        &self.smoothed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Half the range of a smoothed cosine, away from the ends.
    fn passed(period: f64, of: f64) -> f64 {
        let y: Vec<f64> = (0..600).map(|i| (TAU * i as f64 / of).cos()).collect();
        let mut band = Band::new(period);
        let smoothed = band.smooth(&y);
        let inner = &smoothed[smoothed.len() / 4..3 * smoothed.len() / 4];
        inner
            .iter()
            .fold(0.0, |largest: f64, v| largest.max(v.abs()))
    }

    #[test]
    fn fringes_pass_and_the_grid_does_not() {
        for period in [7.5, 20.0, 47.0, 110.0] {
            for (share, at_least) in [(0.6, 0.5), (1.0, 0.75), (1.6, 0.88)] {
                assert!(
                    passed(period, share * period) > at_least,
                    "{period} {share}"
                );
            }
            assert!(passed(period, period / 3.0) < 0.22, "{period}");
        }
    }

    #[test]
    fn a_ramp_stays_a_ramp() {
        let y: Vec<f64> = (0..50).map(f64::from).collect();
        for (k, v) in Band::new(12.0).smooth(&y).iter().enumerate() {
            assert!((v - k as f64).abs() < 1e-9);
        }
    }
}
