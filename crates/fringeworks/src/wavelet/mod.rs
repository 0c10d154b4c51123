//! Continuous wavelet transform of fringe rows with a complex Morlet, and its ridge (theory §5).
//!
//! The wavelet is centred in the frequency domain, `exp(−½ (aω − ω₀)²)`, so that it has no sub-sample
//! shift. Coefficients are normalised to the amplitude of the fringe. Along the row they vary slowly,
//! with the bandwidth of their envelope. They are therefore computed at nodes some pixels apart, which
//! represent them fully. Every pixel blends the local waves of the two nodes beside it.

mod bank;
mod row;

use crate::{Error, Image, check_columns, check_value};
use bank::Bank;
use rayon::prelude::*;
use row::Scratch;
use std::ops::RangeInclusive;

/// Least number of frequencies: the ridge is the vertex of a parabola through three.
const MIN_FREQUENCIES: usize = 3;

/// Largest frequency, cycles/px: the sampling theorem's limit.
const MAX_FREQUENCY: f64 = 0.5;

/// Values of ω₀: below, the wavelet has a noticeable mean; above, its envelope exceeds a row.
const OMEGA_RANGE: RangeInclusive<f64> = 4.0..=60.0;

/// Values of the smoothness; beyond, the ridge cannot change its scale at all.
const SMOOTHNESS_RANGE: RangeInclusive<f64> = 0.0..=1e6;

/// The wavelets, and how the ridge is found.
#[derive(Clone, Debug)]
pub struct Options {
    /// Centre frequencies of the wavelets, cycles/px, rising in equal ratios.
    pub frequencies: Vec<f64>,
    /// ω₀, about 2π times the number of oscillations within the envelope, whose width is ω₀ / ω px.
    pub omega: f64,
    /// Cost of the squared change of scale (in scales) from node to node, as a share of the mean squared
    /// coefficient on the ridge; 0 takes the largest coefficient at every node.
    pub smoothness: f64,
}

/// The ridge of every row.
pub struct Ridge {
    /// Amplitude and phase of the fringe as (real, imaginary).
    pub phasor: Vec<[f32; 2]>,
    /// Local frequency, rad/px.
    pub frequency: Vec<f32>,
}

/// Ridge of the wavelet transform of every row of `rows`.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::wavelet::{Options, wavelet_ridge_rows};
///
/// // Fringes of 16 px.
/// let row: Vec<f32> = (0..256).map(|x| 10.0 + 3.0 * (std::f32::consts::TAU * x as f32 / 16.0).cos()).collect();
/// let options = Options {
///     frequencies: (-8..9).map(|k| 1.06_f64.powi(k) / 16.0).collect(),
///     omega: 6.0,
///     smoothness: 0.1,
/// };
/// let found = wavelet_ridge_rows(Image::new(&row, 1, 256)?, &options)?;
/// let [re, im] = found.phasor[128];
/// assert!((re.hypot(im) - 3.0).abs() < 0.05);
/// assert!((found.frequency[128] - std::f32::consts::TAU / 16.0).abs() < 0.01);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn wavelet_ridge_rows(rows: Image<f32>, options: &Options) -> Result<Ridge, Error> {
    check_columns(rows)?;
    check_value(
        "frequencies",
        options.frequencies.len() >= MIN_FREQUENCIES
            && options.frequencies.windows(2).all(|f| f[0] < f[1])
            && options.frequencies[0] > 0.0
            && options.frequencies[options.frequencies.len() - 1] <= MAX_FREQUENCY,
        "three or more, rising, from above 0 to 0.5 cycles/px",
        &options.frequencies,
    )?;
    check_value(
        "omega",
        OMEGA_RANGE.contains(&options.omega),
        "4 to 60",
        options.omega,
    )?;
    check_value(
        "smoothness",
        SMOOTHNESS_RANGE.contains(&options.smoothness),
        "0 to 1e6",
        options.smoothness,
    )?;
    let width = rows.width();
    let bank = Bank::new(width, options);
    let mut phasor = vec![[0.0; 2]; rows.len()];
    let mut frequency = vec![0.0; rows.len()];
    phasor
        .par_chunks_mut(width)
        .zip(frequency.par_chunks_mut(width))
        .zip(rows.par_chunks(width))
        .for_each_init(
            || Scratch::new(&bank),
            |scratch, ((phasor, frequency), row)| {
                scratch.run(&bank, row, options.smoothness as f32, phasor, frequency)
            },
        );
    Ok(Ridge { phasor, frequency })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustfft::num_complex::Complex32;
    use std::f32::consts::TAU;

    fn options() -> Options {
        let ratio: f64 = 1.06;
        Options {
            frequencies: (-15..17).map(|k| ratio.powi(k) / 16.0).collect(),
            omega: 6.0,
            smoothness: 0.0,
        }
    }

    #[test]
    fn phase_of_a_chirp_is_exact_to_the_border() {
        let n = 400;
        let phase = |x: f32| TAU * x / 16.0 + 0.5 * 2e-4 * (x - 200.0).powi(2) + 0.3;
        let row: Vec<f32> = (0..n).map(|x| 7.0 + 3.0 * phase(x as f32).cos()).collect();
        for smoothness in [0.0, 0.1] {
            let options = Options {
                smoothness,
                ..options()
            };
            let found = wavelet_ridge_rows(Image::new(&row, 1, n).unwrap(), &options).unwrap();
            for x in 40..n - 40 {
                let p = Complex32::new(found.phasor[x][0], found.phasor[x][1]);
                let error = (p * Complex32::from_polar(1.0, -phase(x as f32))).arg();
                assert!(error.abs() < 0.01, "{x}: {error}");
                assert!((p.norm() - 3.0).abs() < 0.05, "{x}: {}", p.norm());
                let expected = TAU / 16.0 + 2e-4 * (x as f32 - 200.0);
                assert!((found.frequency[x] - expected).abs() < 2e-3);
            }
        }
    }

    #[test]
    fn refuses_what_makes_no_wavelets() {
        let row = vec![0.0; 100];
        let with = |change: fn(&mut Options)| {
            let mut o = options();
            change(&mut o);
            wavelet_ridge_rows(Image::new(&row, 1, 100).unwrap(), &o).is_err()
        };
        assert!(with(|o| o.frequencies.truncate(2)));
        assert!(with(|o| o.frequencies.reverse()));
        assert!(with(|o| o.omega = 1.0));
        assert!(with(|o| o.smoothness = f64::NAN));
        assert!(wavelet_ridge_rows(Image::new(&[], 1, 0).unwrap(), &options()).is_err());
    }
}
