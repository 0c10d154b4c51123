//! How far the phases of the sets lie from the coordinate that they give together.

use crate::{Error, check_length};

/// Maps of a decoded sample.
#[derive(Clone, Copy)]
pub struct Maps<'a> {
    /// Projector px.
    pub coordinate: &'a [f32],
    /// Counts.
    pub background: &'a [f32],
    /// Whether a pixel takes part.
    pub used: &'a [bool],
}

/// A set of steps in the sample.
#[derive(Clone, Copy)]
pub struct Set<'a> {
    /// Wrapped phase, rad.
    pub phase: &'a [f32],
    /// Counts.
    pub modulation: &'a [f32],
    /// Projector px.
    pub period: f64,
    /// Variance of the phase in turns² for a modulation of one standard deviation.
    pub variance: f64,
}

/// Noise of the camera, and the least modulation that it is divided by.
#[derive(Clone, Copy)]
pub struct Noise {
    /// Variance in the dark, counts².
    pub read_variance: f64,
    /// Variance per count of brightness, counts.
    pub gain: f64,
    /// Least modulation, counts.
    pub min_modulation: f64,
}

/// Residuals of a set at the pixels that are used, turns, and their variances by noise, turns².
///
/// ```
/// use fringeworks::sample::{Maps, Noise, Set, phase_residuals};
///
/// // The phase of period 8 is a tenth of a turn off its coordinate.
/// let maps = Maps { coordinate: &[16.0], background: &[100.0], used: &[true] };
/// let tenth = 0.1 * std::f32::consts::TAU;
/// let set = Set { phase: &[tenth], modulation: &[50.0], period: 8.0, variance: 1.0 };
/// let noise = Noise { read_variance: 1.0, gain: 0.0, min_modulation: 1e-6 };
/// let (off, variance) = phase_residuals(maps, set, noise)?;
/// assert!((off[0] - 0.1).abs() < 1e-6 && (variance[0] - 0.0004).abs() < 1e-9);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn phase_residuals(maps: Maps, set: Set, noise: Noise) -> Result<(Vec<f64>, Vec<f64>), Error> {
    let n = maps.coordinate.len();
    check_length("used", maps.used.len(), n)?;
    check_length("background", maps.background.len(), n)?;
    check_length("phase", set.phase.len(), n)?;
    check_length("modulation", set.modulation.len(), n)?;
    let (mut off, mut variance) = (vec![0.0; n], vec![0.0; n]);
    compute(maps, set, noise, &mut off, &mut variance);
    let used = |values: Vec<f64>| {
        let kept = values.into_iter().zip(maps.used);
        kept.filter_map(|(value, used)| used.then_some(value))
            .collect()
    };
    Ok((used(off), used(variance)))
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn compute(maps: Maps, set: Set, noise: Noise, off: &mut [f64], variance: &mut [f64]) {
    let n = off.len();
    let (x, background) = (&maps.coordinate[..n], &maps.background[..n]);
    let (phase, modulation) = (&set.phase[..n], &set.modulation[..n]);
    let variance = &mut variance[..n];
    for i in 0..n {
        let turns = f64::from(phase[i]) / std::f64::consts::TAU;
        let rest = turns - f64::from(x[i]) / set.period;
        off[i] = rest - rest.round_ties_even();
        let light = f64::from(background[i]).max(0.0);
        let strength = f64::from(modulation[i]).max(noise.min_modulation);
        let by_noise = noise.read_variance + noise.gain * light;
        variance[i] = set.variance * by_noise / (strength * strength);
    }
}
