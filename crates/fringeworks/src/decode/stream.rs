//! Frames that arrive one by one: their sums are kept, the frames are not.

use super::{fit, run, Outputs, PhaseSet, Plan, Sample, Source, Task, LANES};
use crate::{check_length, Error};
use rayon::prelude::*;

/// Pixels that one task adds.
///
/// Adding is bound by memory, so the tasks are longer than those of decoding.
const ADD_PIXELS: usize = 1 << 15;

/// Sums Σ I, Σ I cos δ and Σ I sin δ of one set over the frames so far, a map each.
pub struct SetSums {
    pub plain: Vec<f32>,
    pub cos: Vec<f32>,
    pub sin: Vec<f32>,
    /// One bit per frame that was below the sensor's limit.
    pub kept: Vec<u64>,
}

impl SetSums {
    pub fn new(pixels: usize) -> Self {
        Self {
            plain: vec![0.0; pixels],
            cos: vec![0.0; pixels],
            sin: vec![0.0; pixels],
            kept: vec![0; pixels],
        }
    }

    /// Add the frame of step `step` with the shift δ (rad).
    pub fn add<T: Sample>(
        &mut self,
        frame: &[T],
        step: usize,
        shift: f64,
        saturation: f32,
    ) -> Result<(), Error> {
        check_length("frame", frame.len(), self.plain.len())?;
        let (c, s) = (shift.cos() as f32, shift.sin() as f32);
        let maps = (
            self.plain.par_chunks_mut(ADD_PIXELS),
            self.cos.par_chunks_mut(ADD_PIXELS),
            self.sin.par_chunks_mut(ADD_PIXELS),
            self.kept.par_chunks_mut(ADD_PIXELS),
            frame.par_chunks(ADD_PIXELS),
        );
        maps.into_par_iter()
            .for_each(|(plain, cos, sin, kept, frame)| {
                for i in 0..frame.len() {
                    let v = frame[i].value();
                    // NaN counts as kept: it makes the sums NaN and the pixel masked.
                    // A saturated sample is added as the limit, a known value that can be
                    // subtracted later.
                    let above = v >= saturation;
                    let counted = if above { saturation } else { v };
                    plain[i] += counted;
                    cos[i] += counted * c;
                    sin[i] += counted * s;
                    kept[i] |= u64::from(!above) << step;
                }
            });
        Ok(())
    }
}

/// Sums of a finished stream, and the frames of its Gray code.
pub struct Sums<'a, T> {
    pub sets: &'a [SetSums],
    pub planes: &'a [&'a [T]],
}

/// Decode the sums of a stream. `planes` are the frames of the Gray code; the plan's indices refer
/// to them.
pub fn decode<T: Sample>(
    sets: &[SetSums],
    planes: &[&[T]],
    plan: &Plan,
    out: Outputs,
) -> Result<(), Error> {
    let pixels = out.coordinate.len();
    check_length("sums", sets.len(), plan.sets.len())?;
    for set in sets {
        check_length("sums", set.plain.len(), pixels)?;
    }
    for frame in planes {
        check_length("frame", frame.len(), pixels)?;
    }
    if let Some(code) = &plan.gray_code {
        code.check(planes.len())?;
    }
    plan.chain.check(plan.sets.len())?;
    run(&Sums { sets, planes }, plan, out)
}

impl<T> Sums<'_, T> {
    #[inline(always)]
    fn group(&self, index: usize, at: usize) -> fit::Sums {
        let sums = &self.sets[index];
        fit::Sums {
            plain: fit::lanes(&sums.plain, at),
            cos: fit::lanes(&sums.cos, at),
            sin: fit::lanes(&sums.sin, at),
        }
    }
}

impl<T: Sample> Source for Sums<'_, T> {
    type Sample = T;

    fn run(task: Task<'_, Self>) {
        T::streamed(task);
    }

    #[inline(always)]
    fn sums(&self, index: usize, set: &PhaseSet, at: usize, limit: f32) -> (fit::Sums, bool) {
        let sums = &self.sets[index];
        let all = set.all_steps();
        let end = sums.kept.len().min(at + LANES);
        // A plan without a limit (NaN) uses all samples.
        let above = !limit.is_nan() && sums.kept[at..end].iter().any(|&kept| kept != all);
        (self.group(index, at), above)
    }

    #[inline(always)]
    fn sums_below(
        &self,
        index: usize,
        set: &PhaseSet,
        at: usize,
        limit: f32,
    ) -> (fit::Sums, fit::Saturated) {
        let mut saturated = fit::Saturated::none();
        // Beyond the end of the map all samples count as saturated; those pixels are not used.
        let kept = fit::lanes(&self.sets[index].kept, at);
        for step in 0..set.steps() {
            let (c, s) = set.phasor(step);
            for (i, kept) in kept.iter().enumerate() {
                let above = kept >> step & 1 == 0;
                saturated.count[i] += if above { 1.0 } else { 0.0 };
                saturated.cos[i] += if above { c } else { 0.0 };
                saturated.sin[i] += if above { s } else { 0.0 };
            }
        }
        let mut sums = self.group(index, at);
        for i in 0..LANES {
            sums.plain[i] -= limit * saturated.count[i];
            sums.cos[i] -= limit * saturated.cos[i];
            sums.sin[i] -= limit * saturated.sin[i];
        }
        (sums, saturated)
    }

    #[inline(always)]
    fn kept(&self, index: usize, set: &PhaseSet, pixel: usize, limit: f32) -> (u64, [f32; 3]) {
        let sums = &self.sets[index];
        let kept = sums.kept[pixel];
        let [mut plain, mut cos, mut sin] = [sums.plain[pixel], sums.cos[pixel], sums.sin[pixel]];
        for step in (0..set.steps()).filter(|step| kept >> step & 1 == 0) {
            let (c, s) = set.phasor(step);
            (plain, cos, sin) = (plain - limit, cos - limit * c, sin - limit * s);
        }
        (kept, [plain, cos, sin])
    }

    fn plane(&self, frame: usize) -> &[T] {
        self.planes[frame]
    }
}
