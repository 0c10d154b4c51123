//! Fringe orders, coordinate, variance and validity of a block of pixels.

mod gray_only;
mod judge;
mod phase_noise;
mod resolve;
mod settings;

use super::fit::{fit, Fitted};
use super::gray_code::{read_gray_code, GrayCells};
use super::{Frames, Lanes, Line, Outputs, Plan, Sample, BLOCK_PIXELS, LANES};
use crate::reason;
use std::f32::consts::TAU;

use gray_only::resolve_gray_only;
use resolve::resolve;
pub use settings::{Chain, Limits, Noise};

/// 1.5 · 2²³: adding and subtracting it rounds an f32 below 2²² to the nearest whole number.
const TO_WHOLE: f32 = 12_582_912.0;

/// Arrays of one block; one per thread.
pub struct Scratch {
    sets: Vec<Fitted>,
    gray: GrayCells,
    background: Line,
    modulation: Line,
    coordinate: Line,
    variance: Line,
    disagreement: Line,
    /// Remainder of every rounding of a group: those of the combinations, then those of the sets.
    remainders: Vec<Lanes>,
    reason: [u32; BLOCK_PIXELS],
    /// Factor on the variances of every pixel, where there is one.
    inflation: Option<Box<Line>>,
}

impl Scratch {
    pub fn new(sets: usize, combinations: usize) -> Self {
        let zero = [0.0; BLOCK_PIXELS];
        Self {
            sets: (0..sets).map(|_| Fitted::new()).collect(),
            gray: GrayCells::new(),
            background: zero,
            modulation: zero,
            coordinate: zero,
            variance: zero,
            disagreement: zero,
            remainders: vec![[0.0; LANES]; combinations + sets],
            reason: [0; BLOCK_PIXELS],
            inflation: None,
        }
    }
}

/// Decode up to [`BLOCK_PIXELS`] pixels from `at` on.
#[inline(always)]
pub fn decode_block<T: Sample>(
    frames: &Frames<'_, T>,
    plan: &Plan,
    at: usize,
    out: Outputs,
    scratch: &mut Scratch,
) {
    let n = out.coordinate.len();
    scratch.inflation = (!out.inflation.is_empty()).then(|| {
        let mut line = Box::new([1.0; BLOCK_PIXELS]);
        line[..n].copy_from_slice(out.inflation);
        line
    });
    fit_sets(frames, plan, at, n, scratch);
    if let Some(code) = &plan.gray_code {
        let phases = (&scratch.background, &scratch.modulation);
        read_gray_code(frames, plan, code, (at, n), phases, &mut scratch.gray);
    }
    if plan.sets.is_empty() {
        resolve_gray_only(plan, scratch);
    } else {
        for start in (0..n).step_by(LANES) {
            resolve(plan, start, scratch);
        }
    }
    write(n, out, scratch);
}

/// Fit every set; background as the mean over all frames, modulation of the finest set.
#[inline(always)]
fn fit_sets<T: Sample>(
    frames: &Frames<'_, T>,
    plan: &Plan,
    at: usize,
    n: usize,
    scratch: &mut Scratch,
) {
    let total: usize = plan.sets.iter().map(|set| set.steps()).sum();
    for k in 0..plan.sets.len() {
        let fitted = &mut scratch.sets[k];
        fit(frames, plan, k, at..at + n, fitted);
        let share = plan.sets[k].steps() as f32 / total as f32;
        for i in 0..BLOCK_PIXELS {
            let before = if k == 0 { 0.0 } else { scratch.background[i] };
            scratch.background[i] = before + share * fitted.background[i];
        }
    }
    if let Some(finest) = scratch.sets.get(plan.finest()) {
        for i in 0..BLOCK_PIXELS {
            scratch.modulation[i] = finest.power[i].sqrt();
        }
    }
}

/// The whole number nearest to v, for |v| < 2²²; plain additions exist in all instruction sets.
#[inline(always)]
fn nearest(v: f32) -> f32 {
    (v + TO_WHOLE) - TO_WHOLE
}

/// The values of one group of an array of the block.
#[inline(always)]
fn part(line: &Line, start: usize) -> &Lanes {
    line[start..]
        .first_chunk()
        .expect("a whole number of groups")
}

#[inline(always)]
fn part_mut(line: &mut Line, start: usize) -> &mut Lanes {
    line[start..]
        .first_chunk_mut()
        .expect("a whole number of groups")
}

/// Copy the results of a block into the output maps.
#[inline(always)]
fn write(n: usize, out: Outputs, scratch: &Scratch) {
    let maps = out.coordinate.iter_mut().zip(out.sigma.iter_mut());
    let results = scratch.coordinate[..n]
        .iter()
        .zip(&scratch.variance[..n])
        .zip(&scratch.reason[..n]);
    for ((coordinate, sigma), ((&x, &variance), &reason)) in maps.zip(results) {
        let ok = reason == u32::from(reason::OK);
        *coordinate = if ok { x } else { f32::NAN };
        *sigma = if ok { variance.sqrt() } else { f32::NAN };
    }
    out.background.copy_from_slice(&scratch.background[..n]);
    out.modulation.copy_from_slice(&scratch.modulation[..n]);
    for (byte, &reason) in out.reason.iter_mut().zip(&scratch.reason) {
        *byte = reason as u8;
    }
    if !out.disagreement.is_empty() {
        out.disagreement.copy_from_slice(&scratch.disagreement[..n]);
    }
    for (map, fitted) in out.phases.into_iter().zip(&scratch.sets) {
        for (phase, turns) in map.iter_mut().zip(&fitted.turns) {
            *phase = TAU * turns;
        }
    }
    for (map, fitted) in out.modulations.into_iter().zip(&scratch.sets) {
        for (modulation, power) in map.iter_mut().zip(&fitted.power) {
            *modulation = power.sqrt();
        }
    }
}
