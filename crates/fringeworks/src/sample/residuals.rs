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

/// Noise of the camera: variance in the dark and per count, and the least modulation that it is
/// divided by, counts.
#[derive(Clone, Copy)]
pub struct Noise {
    pub read_variance: f64,
    pub gain: f64,
    pub least: f64,
}

/// Residuals of a set at the pixels that are used, turns, and their variances by noise, turns².
pub fn of_set(maps: Maps, set: Set, noise: Noise) -> Result<(Vec<f64>, Vec<f64>), Error> {
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
        let strength = f64::from(modulation[i]).max(noise.least);
        let by_noise = noise.read_variance + noise.gain * light;
        variance[i] = set.variance * by_noise / (strength * strength);
    }
}
