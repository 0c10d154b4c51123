//! Fringe orders, coordinate, variance and validity of a block of pixels.

mod gray_only;
mod judge;
mod phase_noise;
mod resolve;
mod settings;

use super::fit::{fit, Fitted, Sums};
use super::gray_code::{read_gray_code, GrayCells};
use super::{Frames, Line, Outputs, Plan, Sample, BLOCK_PIXELS};
use crate::reason;
use std::f32::consts::TAU;

use gray_only::resolve_gray_only;
use phase_noise::Unusable;
use resolve::resolve;
pub use settings::{Chain, Limits, Noise};

/// 1.5 · 2²³: adding and subtracting it rounds an f32 below 2²² to the nearest whole number.
const TO_WHOLE: f32 = 12_582_912.0;

/// Arrays of one block; one per thread.
pub struct Scratch {
    sums: Sums,
    sets: Vec<Fitted>,
    gray: GrayCells,
    background: Line,
    modulation: Line,
    /// Coordinate that the chain starts from, px: that of the Gray code, or the middle of the range.
    start: Line,
    coordinate: Line,
    variance: Line,
    disagreement: Line,
    /// Remainder of every rounding, turns: those of the combinations, then those of the sets.
    remainders: Vec<Line>,
    unusable: Unusable,
    /// Non-zero where the fringe order is ambiguous.
    ambiguous: Line<u32>,
    reason: Line<u32>,
    /// Factor on the variances of every pixel, where there is one.
    inflation: Option<Box<Line>>,
}

impl Scratch {
    pub fn new(sets: usize, combinations: usize) -> Self {
        let zero = Line::of(0.0);
        Self {
            sums: Sums::zero(),
            sets: (0..sets).map(|_| Fitted::new()).collect(),
            gray: GrayCells::new(),
            background: zero,
            modulation: zero,
            start: zero,
            coordinate: zero,
            variance: zero,
            disagreement: zero,
            remainders: vec![zero; combinations + sets],
            unusable: Unusable::none(),
            ambiguous: Line::of(0),
            reason: Line::of(0),
            inflation: None,
        }
    }
}

/// Decode up to [`BLOCK_PIXELS`] pixels from `at` on; the planes hold a whole block there.
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
        let mut line = Box::new(Line::of(1.0));
        line[..n].copy_from_slice(out.inflation);
        line
    });
    fit_sets(frames, plan, at, scratch);
    if let Some(code) = &plan.gray_code {
        let phases = (&scratch.background, &scratch.modulation);
        read_gray_code(frames, plan, code, at, phases, &mut scratch.gray);
    }
    if plan.sets.is_empty() {
        resolve_gray_only(plan, scratch);
    } else {
        resolve(plan, scratch);
    }
    write(n, out, scratch);
}

/// Fit every set; background as the mean over all frames, modulation of the finest set.
#[inline(always)]
fn fit_sets<T: Sample>(frames: &Frames<'_, T>, plan: &Plan, at: usize, scratch: &mut Scratch) {
    let total: usize = plan.sets.iter().map(|set| set.steps()).sum();
    scratch.background = Line::of(0.0);
    for k in 0..plan.sets.len() {
        let fitted = &mut scratch.sets[k];
        fit(frames, plan, k, at, &mut scratch.sums, fitted);
        let share = plan.sets[k].steps() as f32 / total as f32;
        for i in 0..BLOCK_PIXELS {
            scratch.background[i] += share * fitted.background[i];
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

/// Σ c a over lines a with coefficients c, in their order; lines whose coefficient is 0 are left out.
#[inline(always)]
fn weighted_sum<'a>(terms: impl Iterator<Item = (&'a Line, f32)>, out: &mut Line) {
    let mut first = true;
    for (line, c) in terms.filter(|(_, c)| *c != 0.0) {
        for i in 0..BLOCK_PIXELS {
            out[i] = if first { 0.0 } else { out[i] } + c * line[i];
        }
        first = false;
    }
    if first {
        *out = Line::of(0.0);
    }
}

/// Copy the results of a block's first `n` pixels into the output maps.
#[inline(always)]
fn write(n: usize, out: Outputs, scratch: &Scratch) {
    let (coordinate, sigma) = (&mut out.coordinate[..n], &mut out.sigma[..n]);
    for i in 0..n {
        let ok = scratch.reason[i] == u32::from(reason::OK);
        coordinate[i] = if ok { scratch.coordinate[i] } else { f32::NAN };
        sigma[i] = if ok {
            scratch.variance[i].sqrt()
        } else {
            f32::NAN
        };
    }
    if !out.background.is_empty() {
        out.background.copy_from_slice(&scratch.background[..n]);
        out.modulation.copy_from_slice(&scratch.modulation[..n]);
    }
    for (byte, &reason) in out.reason.iter_mut().zip(scratch.reason.iter()) {
        *byte = reason as u8;
    }
    if !out.disagreement.is_empty() {
        out.disagreement.copy_from_slice(&scratch.disagreement[..n]);
    }
    for (map, fitted) in out.phases.into_iter().zip(&scratch.sets) {
        for (phase, turns) in map.iter_mut().zip(fitted.turns.iter()) {
            *phase = TAU * turns;
        }
    }
    for (map, fitted) in out.modulations.into_iter().zip(&scratch.sets) {
        for (modulation, power) in map.iter_mut().zip(fitted.power.iter()) {
            *modulation = power.sqrt();
        }
    }
}
