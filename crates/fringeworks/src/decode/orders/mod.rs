//! Fringe orders, coordinate, variance and validity of a block of pixels.

mod ends;
mod resolve;
mod settings;
mod shape;

use super::fit::{Fitted, NO_PRECISION, Sums, fit};
use super::gray_code::{Against, GrayCells, GrayCode, read_gray_code};
use super::{BLOCK_PIXELS, DecodeSettings, Frames, Line, Outputs, Sample};
use crate::{Error, Reason};
use std::f32::consts::TAU;
use std::ops::Range;

pub use settings::{Chain, Limits, Noise};
use shape::{MAX_SETS, Resolver};

/// 1.5 · 2²³: adding and subtracting it rounds an f32 below 2²² to the nearest whole number.
const TO_WHOLE: f32 = 12_582_912.0;

/// Refuse a plan that has too many sets.
pub fn check(plan: &DecodeSettings) -> Result<(), Error> {
    shape::check(plan)
}

/// Arrays of one block. They lie in one piece of memory: the compiler need not ask whether they
/// overlap.
pub struct Block {
    /// Those that the plan does not have change nothing.
    sets: [Fitted; MAX_SETS],
    sums: Sums,
    gray: GrayCells,
    /// B² of the set with the shortest period, counts².
    power: Line,
    background: Line,
    modulation: Line,
    /// Coordinate that the chain starts from, px: that of the Gray code, or the middle of the range.
    start: Line,
    /// Factor on the variances of every pixel.
    inflation: Line,
    coordinate: Line,
    sigma: Line,
    disagreement: Line,
    /// Variance of the first combination, turns².
    coarsest: Line,
    reason: Line<u32>,
}

/// What a thread decodes with.
pub struct Scratch {
    block: Box<Block>,
    /// `None` for a Gray code alone.
    resolver: Option<Resolver>,
}

impl Scratch {
    /// For a checked plan; `factors` says whether pixels have factors on their variances.
    pub fn new(plan: &DecodeSettings, factors: bool) -> Self {
        let zero = Line::of(0.0);
        let block = Box::new(Block {
            sets: [const { Fitted::new() }; MAX_SETS],
            sums: Sums::zero(),
            gray: GrayCells::new(),
            power: zero,
            background: zero,
            modulation: zero,
            start: Line::of(plan.chain.middle),
            inflation: Line::of(1.0),
            coordinate: zero,
            sigma: zero,
            disagreement: zero,
            coarsest: zero,
            reason: Line::of(0),
        });
        let resolver = (!plan.sets.is_empty()).then(|| Resolver::new(plan, factors));
        Self { block, resolver }
    }
}

/// Decode up to [`BLOCK_PIXELS`] pixels from `at` on into the range `here` of the outputs; the planes
/// hold a whole block there.
#[inline(always)]
pub fn decode_block<T: Sample>(
    frames: &Frames<'_, T>,
    plan: &DecodeSettings,
    at: usize,
    scratch: &mut Scratch,
    out: &mut Outputs<'_>,
    here: Range<usize>,
) {
    let block = &mut *scratch.block;
    if !out.inflation.is_empty() {
        block.inflation[..here.len()].copy_from_slice(&out.inflation[here.clone()]);
    }
    let mut saturated = false;
    for k in 0..plan.sets.len() {
        saturated |= fit(frames, plan, k, at, &mut block.sums, &mut block.sets[k]);
    }
    if let Some(code) = &plan.gray_code {
        mean_and_modulation(plan, block);
        let phases = (&block.background, &block.modulation);
        read_gray_code(frames, plan, code, at, phases, &mut block.gray);
    }
    match &scratch.resolver {
        None => {
            ends::resolve_gray_only(plan, block);
            if let Some(code) = &plan.gray_code {
                mark_saturated_code(frames, plan, code, at, block);
            }
        }
        Some(resolver) => {
            block.power = block.sets[plan.finest()].power;
            if plan.gray_code.is_some() {
                block.start = block.gray.coordinate;
            }
            resolver.resolve(block);
            if resolver.shows_all() {
                ends::check_start(plan, block);
            }
            if saturated {
                mark_undetermined(plan.sets.len(), block);
            }
        }
    }
    write_variances(plan, block, out, here.clone());
    write(&block.sets[..plan.sets.len()], block, out, here);
}

/// Background as the mean over all frames, and modulation of the finest set, for the Gray code.
#[inline(always)]
fn mean_and_modulation(plan: &DecodeSettings, block: &mut Block) {
    let total: usize = plan.sets.iter().map(|set| set.steps()).sum();
    block.background = Line::of(0.0);
    for (set, fitted) in plan.sets.iter().zip(&block.sets) {
        let share = set.steps() as f32 / total as f32;
        for i in 0..BLOCK_PIXELS {
            block.background[i] += share * fitted.background[i];
        }
    }
    let finest = &block.sets[plan.finest()];
    for i in 0..BLOCK_PIXELS {
        block.modulation[i] = finest.power[i].sqrt();
    }
}

/// The whole number nearest to v, for |v| < 2²²; plain additions exist in all instruction sets.
#[inline(always)]
fn nearest(v: f32) -> f32 {
    (v + TO_WHOLE) - TO_WHOLE
}

/// Mark the pixels of a block that have a phase which saturation leaves undetermined.
#[inline(always)]
fn mark_undetermined(sets: usize, block: &mut Block) {
    for fitted in &block.sets[..sets] {
        for i in 0..BLOCK_PIXELS {
            let undetermined = fitted.precision[i] == NO_PRECISION;
            let reason = block.reason[i];
            block.reason[i] = if undetermined {
                Reason::Saturated.lane()
            } else {
                reason
            };
        }
    }
    hide_unmeasured(block);
}

/// Mark the pixels of a block whose Gray code is undetermined because its samples are at the limit: a
/// bit and its inverse, or white and black. Where white alone is, borders may lie further on the side
/// that is dark than half of its light tells, within their blur.
#[inline(always)]
fn mark_saturated_code<T: Sample>(
    frames: &Frames<'_, T>,
    plan: &DecodeSettings,
    code: &GrayCode,
    at: usize,
    block: &mut Block,
) {
    let limit = plan.limits.saturation;
    let pairs: Vec<_> = match &code.against {
        Against::Inverse(inverse) => code.bits.iter().zip(inverse).collect(),
        Against::WhiteBlack { white, black } => vec![(white, black)],
        Against::Mean => Vec::new(),
    };
    for (bit, other) in pairs {
        let (bit, other) = (frames.block(*bit, at), frames.block(*other, at));
        for i in 0..BLOCK_PIXELS {
            let least = bit[i].value().min(other[i].value());
            if least >= limit && block.reason[i] != Reason::Masked.lane() {
                block.reason[i] = Reason::Saturated.lane();
            }
        }
    }
    if let Against::WhiteBlack { white, black } = &code.against {
        let (white, black) = (frames.block(*white, at), frames.block(*black, at));
        let shift = code.blurred.min(0.5 * code.step);
        for i in 0..BLOCK_PIXELS {
            let clipped = white[i].value() >= limit;
            if clipped {
                block.background[i] = 0.5 * (white[i].value() + black[i].value());
            }
            if clipped && block.reason[i] == Reason::OrderAmbiguous.lane() {
                block.reason[i] = Reason::Saturated.lane();
            } else if clipped {
                block.sigma[i] *= 1.0 + shift / block.gray.half_width[i];
            }
        }
    }
    hide_unmeasured(block);
}

/// Hide the coordinates of a block that are not measured.
#[inline(always)]
fn hide_unmeasured(block: &mut Block) {
    for i in 0..BLOCK_PIXELS {
        let ok = block.reason[i] == Reason::Ok.lane();
        block.coordinate[i] = if ok { block.coordinate[i] } else { f32::NAN };
        block.sigma[i] = if ok { block.sigma[i] } else { f32::NAN };
    }
}

/// Write the variances of all phases by noise, where they are wanted.
#[inline(always)]
fn write_variances(
    plan: &DecodeSettings,
    block: &Block,
    out: &mut Outputs<'_>,
    here: Range<usize>,
) {
    for (map, fitted) in out.variances.iter_mut().zip(&block.sets) {
        for (i, variance) in map[here.clone()].iter_mut().enumerate() {
            // Without shot noise the brightness is not kept up.
            let noise = if plan.noise.gain > 0.0 {
                plan.noise.variance(fitted.brightness[i].max(0.0))
            } else {
                plan.noise.read_variance
            };
            let unit = fitted.precision[i] / (block.inflation[i] * fitted.stretch[i]);
            *variance = resolve::variance(unit / noise);
        }
    }
}

/// Copy the results of a block's first pixels into a range of the output maps.
#[inline(always)]
fn write(sets: &[Fitted], block: &Block, out: &mut Outputs<'_>, here: Range<usize>) {
    let n = here.len();
    out.coordinate[here.clone()].copy_from_slice(&block.coordinate[..n]);
    out.sigma[here.clone()].copy_from_slice(&block.sigma[..n]);
    if !out.background.is_empty() {
        out.background[here.clone()].copy_from_slice(&block.background[..n]);
        out.modulation[here.clone()].copy_from_slice(&block.modulation[..n]);
    }
    let reasons = out.reason[here.clone()].iter_mut();
    for (byte, &reason) in reasons.zip(block.reason.iter()) {
        *byte = reason as u8;
    }
    if !out.disagreement.is_empty() {
        out.disagreement[here.clone()].copy_from_slice(&block.disagreement[..n]);
    }
    for (map, cells) in (out.cells.iter_mut()).zip([&block.start, &block.gray.half_width]) {
        map[here.clone()].copy_from_slice(&cells[..n]);
    }
    for (map, fitted) in out.phases.iter_mut().zip(sets) {
        for (phase, turns) in map[here.clone()].iter_mut().zip(fitted.turns.iter()) {
            *phase = TAU * turns;
        }
    }
    for (map, fitted) in out.modulations.iter_mut().zip(sets) {
        for (modulation, power) in map[here.clone()].iter_mut().zip(fitted.power.iter()) {
            *modulation = power.sqrt();
        }
    }
}
