//! Fringe orders, coordinate, variance and validity of a block of pixels.

use super::code::{read, Read};
use super::fit::{fit, Fitted, UNDETERMINED};
use super::{Lanes, Line, Outputs, Plan, Source, BLOCK, LANES};
use crate::reason;
use crate::{check_length, check_value, Error};

const TURN: f32 = std::f32::consts::TAU;

/// How the orders of all sets are found: roundings that the plan proved (temporal unwrapping).
pub struct Chain {
    /// Whole-number coefficients, a row of as many as there are sets per combination.
    pub combinations: Vec<f32>,
    /// Frequency of every combination, turns per px.
    pub frequencies: Vec<f32>,
    /// Squared amplification of the phase errors by every rounding, rows as above.
    pub amplification: Vec<f32>,
    /// Squared room of every rounding over that of the limits' confidence, turns².
    pub room: Vec<f32>,
    /// Middle and half-width of the coordinates, px.
    pub middle: f32,
    pub half: f32,
    /// Distance after which all phases repeat, px; infinite where they do not.
    pub repeats: f32,
    /// Whether both ends of the range are the same place: a coordinate modulo `repeats`.
    pub circular: bool,
    /// How far a coordinate may lie from the middle of its code cell, px.
    pub code_reach: f32,
}

impl Chain {
    pub(super) fn check(&self, sets: usize, code: bool) -> Result<(), Error> {
        let n = self.frequencies.len();
        check_value("chain", sets == 0 || n > 0, "a combination", n)?;
        check_length("combinations", self.combinations.len(), n * sets)?;
        check_length(
            "amplification",
            self.amplification.len(),
            self.room.len() * sets,
        )?;
        let positive = self.frequencies.iter().all(|&g| g > 0.0);
        check_value("frequencies", positive, "> 0", &self.frequencies)?;
        check_value("range", self.half > 0.0, "> 0", self.half)?;
        check_value("repeats", self.repeats > 0.0, "> 0", self.repeats)?;
        let reach = !code || self.code_reach > 0.0;
        check_value("reach of the code", reach, "> 0", self.code_reach)
    }
}

/// Variance of a count: read noise and shot noise.
pub struct Noise {
    pub read_variance: f32,
    /// Counts² per count.
    pub gain: f32,
    /// What the sets' disagreement multiplies variances of the coordinate by; ≥ 1.
    pub scale: f32,
}

impl Noise {
    #[inline(always)]
    pub fn variance(&self, level: f32) -> f32 {
        self.read_variance + self.gain * level.max(0.0)
    }
}

pub struct Limits {
    /// Counts from which on a sample is not trusted; NaN for none.
    pub saturation: f32,
    /// Modulation over its standard deviation below which there is no fringe.
    pub min_snr: f32,
    /// Modulation, counts, below which a pixel is not used.
    pub min_modulation: f32,
    /// Largest χ² of the sets' disagreement, in units of what `Noise::scale` allows.
    pub max_disagreement: f32,
    /// Standard deviations that the two ends of the range must be away, where they are alike.
    pub confidence: f32,
}

/// Arrays of one block; one per thread.
pub struct Scratch {
    sets: Vec<Fitted>,
    read: Read,
    background: Line,
    modulation: Line,
    coordinate: Line,
    variance: Line,
    disagreement: Line,
    reason: [u32; BLOCK],
}

impl Scratch {
    pub fn new(sets: usize) -> Self {
        let zero = [0.0; BLOCK];
        Self {
            sets: (0..sets).map(|_| Fitted::new()).collect(),
            read: Read::new(),
            background: zero,
            modulation: zero,
            coordinate: zero,
            variance: zero,
            disagreement: zero,
            reason: [0; BLOCK],
        }
    }
}

/// Decode up to [`BLOCK`] pixels from `at` on.
#[inline(always)]
pub fn block<S: Source>(source: &S, plan: &Plan, at: usize, out: Outputs, scratch: &mut Scratch) {
    let n = out.coordinate.len();
    fit_sets(source, plan, at, n, scratch);
    if let Some(code) = &plan.code {
        let phases = (&scratch.background, &scratch.modulation);
        read(source, plan, code, at, n, phases, &mut scratch.read);
    }
    if plan.sets.is_empty() {
        code_alone(plan, scratch);
    } else {
        for start in (0..n).step_by(LANES) {
            resolve(plan, start, scratch);
        }
    }
    write(n, out, scratch);
}

/// Phase, modulation and background of every set.
#[inline(always)]
fn fit_sets<S: Source>(source: &S, plan: &Plan, at: usize, n: usize, scratch: &mut Scratch) {
    let total: usize = plan.sets.iter().map(|set| set.steps()).sum();
    for k in 0..plan.sets.len() {
        let fitted = &mut scratch.sets[k];
        fit(source, plan, k, at..at + n, fitted);
        let share = plan.sets[k].steps() as f32 / total as f32;
        for i in 0..BLOCK {
            let before = if k == 0 { 0.0 } else { scratch.background[i] };
            scratch.background[i] = before + share * fitted.background[i];
        }
    }
    if let Some(finest) = scratch.sets.get(plan.finest()) {
        for i in 0..BLOCK {
            scratch.modulation[i] = finest.power[i].sqrt();
        }
    }
}

/// The whole number nearest to v, for |v| < 2²²; plain additions, for all instruction sets.
#[inline(always)]
fn nearest(v: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    (v + SHIFT) - SHIFT
}

#[inline(always)]
fn wrap(v: f32) -> f32 {
    v - nearest(v)
}

/// A few pixels' worth of an array of the block.
#[inline(always)]
fn part(line: &Line, start: usize) -> &Lanes {
    line[start..]
        .first_chunk()
        .expect("a whole number of lanes")
}

/// Coordinate of a few pixels by the chain of roundings, their variance, and whether they stand.
#[inline(always)]
fn resolve(plan: &Plan, start: usize, scratch: &mut Scratch) {
    let (chain, sets) = (&plan.chain, plan.sets.len());
    let weak = phase_noise(plan, start, scratch);
    let coded = plan.code.is_some();
    let begin = if coded {
        *part(&scratch.read.coordinate, start)
    } else {
        [chain.middle; LANES]
    };
    let mut x = begin;
    for (k, &g) in chain.frequencies.iter().enumerate() {
        let row = &chain.combinations[k * sets..(k + 1) * sets];
        let mut phase = [0.0; LANES];
        for (fitted, &c) in scratch.sets.iter().zip(row) {
            let turns = part(&fitted.turns, start);
            for i in 0..LANES {
                phase[i] += c * turns[i];
            }
        }
        let px = 1.0 / g;
        for i in 0..LANES {
            x[i] += wrap(phase[i] - g * x[i]) * px;
        }
    }
    let (mut weight, mut pull, mut square) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for (fitted, set) in scratch.sets.iter().zip(&plan.sets) {
        let f = set.frequency;
        let (turns, precision) = (part(&fitted.turns, start), part(&fitted.precision, start));
        for i in 0..LANES {
            let off = wrap(turns[i] - f * x[i]);
            let fp = f * precision[i];
            weight[i] += f * fp;
            pull[i] += fp * off;
            square[i] += precision[i] * off * off;
        }
    }
    let (mut variance, mut disagreement) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let inverse = 1.0 / weight[i];
        let shift = pull[i] * inverse;
        x[i] += shift;
        variance[i] = inverse * plan.noise.scale;
        disagreement[i] = square[i] - shift * pull[i];
    }
    let stands = judge(
        plan,
        start,
        scratch,
        (&mut x, &begin),
        &variance,
        &disagreement,
    );
    let reasons = &mut scratch.reason[start..start + LANES];
    for i in 0..LANES {
        let ok = weak[i] == u32::from(reason::OK) && stands[i] == 0;
        reasons[i] = if ok {
            u32::from(reason::OK)
        } else {
            weak[i].max(u32::from(weak[i] == 0) * u32::from(reason::ORDER_AMBIGUOUS))
        };
    }
    scratch.coordinate[start..start + LANES].copy_from_slice(&x);
    scratch.variance[start..start + LANES].copy_from_slice(&variance);
    scratch.disagreement[start..start + LANES].copy_from_slice(&disagreement);
}

/// Precision (1/turns²) and variance of every phase, in place; the reason where it is no fringe.
///
/// Variances go where levels were: those are not needed any more.
#[inline(always)]
fn phase_noise(plan: &Plan, start: usize, scratch: &mut Scratch) -> [u32; LANES] {
    let least = plan.limits.min_snr * plan.limits.min_snr;
    let (mut weak, mut lost) = ([0u32; LANES], [0u32; LANES]);
    for fitted in &mut scratch.sets {
        let precision: &mut Lanes = fitted.precision[start..].first_chunk_mut().expect("lanes");
        let level: &mut Lanes = fitted.level[start..].first_chunk_mut().expect("lanes");
        let mut per_noise = [1.0 / plan.noise.read_variance; LANES];
        if plan.noise.gain > 0.0 {
            for i in 0..LANES {
                per_noise[i] = 1.0 / plan.noise.variance(level[i]);
            }
        }
        for i in 0..LANES {
            let unit = precision[i];
            let q = unit * per_noise[i];
            let strong = q >= least;
            weak[i] += u32::from(!strong);
            lost[i] |= u32::from(unit == UNDETERMINED);
            // B is taken from noisy data, and a weak fringe's phase is not normal: the variance
            // 1/q is short by 1/q² for either reason by half.
            let u = 1.0 / q;
            let v = u * (1.0 + u);
            precision[i] = q * (1.0 - u + u * u) * (TURN * TURN);
            level[i] = v * (1.0 / (TURN * TURN));
        }
    }
    let all = scratch.sets.len() as u32;
    let (background, modulation) = (
        part(&scratch.background, start),
        part(&scratch.modulation, start),
    );
    let mut found = [0u32; LANES];
    for i in 0..LANES {
        let faint = modulation[i] < plan.limits.min_modulation || weak[i] > 0;
        let dark = if weak[i] == all {
            reason::SHADOW
        } else {
            reason::LOW_MODULATION
        };
        let kind = if faint {
            u32::from(dark)
        } else {
            u32::from(reason::OK)
        };
        let kind = if background[i].is_finite() {
            kind
        } else {
            u32::from(reason::MASKED)
        };
        found[i] = if lost[i] > 0 {
            u32::from(reason::SATURATED)
        } else {
            kind
        };
    }
    found
}

/// Brings the coordinate into the range; 0 where there was enough room at every rounding, and sets
/// and code agree.
#[inline(always)]
fn judge(
    plan: &Plan,
    start: usize,
    scratch: &Scratch,
    (x, begin): (&mut Lanes, &Lanes),
    variance: &Lanes,
    disagreement: &Lanes,
) -> [u32; LANES] {
    let (chain, limits, sets) = (&plan.chain, &plan.limits, plan.sets.len());
    let mut wrong = [0u32; LANES];
    for (row, &room) in chain.amplification.chunks_exact(sets).zip(&chain.room) {
        let mut error = [0.0; LANES];
        for (fitted, &a) in scratch.sets.iter().zip(row) {
            let variance = part(&fitted.level, start);
            for i in 0..LANES {
                error[i] += a * variance[i];
            }
        }
        for i in 0..LANES {
            let fits = error[i] <= room;
            wrong[i] |= u32::from(!fits);
        }
    }
    let allowed = limits.max_disagreement * plan.noise.scale;
    let coded = plan.code.is_some();
    let periodic = chain.repeats.is_finite() && !coded;
    let turn = if periodic { 1.0 / chain.repeats } else { 0.0 };
    let repeats = if periodic { chain.repeats } else { 0.0 };
    let seam = if periodic {
        0.5 * chain.repeats
    } else {
        f32::INFINITY
    };
    let reach = if coded {
        chain.code_reach
    } else {
        f32::INFINITY
    };
    let everywhere = u32::from(!chain.circular);
    if !(periodic || coded) {
        // Nothing repeats: by its own noise the first combination may have gone round the ends.
        let round = 0.5 / chain.frequencies[0];
        let mut first = [0.0; LANES];
        for (fitted, &c) in scratch.sets.iter().zip(&chain.combinations) {
            let variance = part(&fitted.level, start);
            for i in 0..LANES {
                first[i] += c * c * variance[i];
            }
        }
        for i in 0..LANES {
            let room = round - limits.confidence * 2.0 * round * first[i].sqrt();
            let inside = (x[i] - chain.middle).abs() <= room;
            wrong[i] |= u32::from(!inside);
        }
    }
    for i in 0..LANES {
        x[i] -= repeats * nearest((x[i] - chain.middle) * turn);
        let slack = limits.confidence * variance[i].sqrt();
        let from_middle = (x[i] - chain.middle).abs();
        let inside = from_middle <= (chain.half + slack).min(seam - slack);
        let near = (x[i] - begin[i]).abs() <= reach + slack;
        let agree = disagreement[i] <= allowed;
        wrong[i] |= u32::from(!agree) | u32::from(!near) | (everywhere & u32::from(!inside));
    }
    wrong
}

/// A coordinate from the code alone: the middle of a cell.
#[inline(always)]
fn code_alone(plan: &Plan, scratch: &mut Scratch) {
    let step = plan.code.as_ref().map_or(0.0, |code| code.step);
    let snr = plan.limits.min_snr;
    scratch.background = scratch.read.level;
    scratch.modulation = scratch.read.contrast;
    scratch.coordinate = scratch.read.coordinate;
    scratch.variance = [step * step / 12.0; BLOCK];
    scratch.disagreement = [0.0; BLOCK];
    for i in 0..BLOCK {
        let contrast = scratch.modulation[i];
        let noise = (0.5 * plan.noise.variance(scratch.background[i])).sqrt();
        scratch.reason[i] = u32::from(if !scratch.background[i].is_finite() {
            reason::MASKED
        } else if contrast < snr * noise {
            reason::SHADOW
        } else if contrast < plan.limits.min_modulation {
            reason::LOW_MODULATION
        } else if scratch.coordinate[i].is_nan() {
            reason::ORDER_AMBIGUOUS
        } else {
            reason::OK
        });
    }
}

#[inline(always)]
fn write(n: usize, out: Outputs, scratch: &Scratch) {
    let variance = &scratch.variance[..n];
    let results = out.coordinate.iter_mut().zip(out.sigma.iter_mut());
    let found = scratch.coordinate[..n]
        .iter()
        .zip(variance)
        .zip(&scratch.reason[..n]);
    for ((coordinate, sigma), ((&x, &v), &reason)) in results.zip(found) {
        let ok = reason == u32::from(reason::OK);
        *coordinate = if ok { x } else { f32::NAN };
        *sigma = if ok { v.sqrt() } else { f32::NAN };
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
            *phase = TURN * turns;
        }
    }
    for (map, fitted) in out.modulations.into_iter().zip(&scratch.sets) {
        for (modulation, power) in map.iter_mut().zip(&fitted.power) {
            *modulation = power.sqrt();
        }
    }
}
