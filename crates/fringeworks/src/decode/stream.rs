//! Frames that arrive one by one: their sums are kept, the frames are not.

use super::{fit, run, Outputs, PhaseSet, Plan, Sample, Source, Task, LANES};
use crate::{check_length, Error};
use rayon::prelude::*;

/// Pixels per task of a thread.
const BAND: usize = 1 << 15;

/// Σ I, Σ I cos δ, Σ I sin δ of one set over the frames so far; a map each.
pub struct SetSums {
    pub plain: Vec<f32>,
    pub cos: Vec<f32>,
    pub sin: Vec<f32>,
    /// A bit per frame that was below the sensor's limit.
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

    /// Add the frame of step `step` with the shift δ.
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
            self.plain.par_chunks_mut(BAND),
            self.cos.par_chunks_mut(BAND),
            self.sin.par_chunks_mut(BAND),
            self.kept.par_chunks_mut(BAND),
            frame.par_chunks(BAND),
        );
        maps.into_par_iter()
            .for_each(|(plain, cos, sin, kept, frame)| {
                for i in 0..frame.len() {
                    let v = frame[i].value();
                    // NaN is kept: it shall show.
                    // A sample at the limit counts as the limit: it is known when it has to go.
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

/// All sums of a finished stream, and the frames of its code.
pub struct Sums<'a, T> {
    pub sets: &'a [SetSums],
    pub planes: &'a [&'a [T]],
}

/// Decode a stream's sums; `planes` are the frames of the code (the plan's indices count those).
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
    if let Some(code) = &plan.code {
        code.check(planes.len())?;
    }
    plan.chain.check(plan.sets.len(), plan.code.is_some())?;
    run(&Sums { sets, planes }, plan, out)
}

impl<T> Sums<'_, T> {
    #[inline(always)]
    fn of(&self, index: usize, at: usize) -> fit::Sums {
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
        let all = u64::MAX >> (64 - set.steps());
        let end = sums.kept.len().min(at + LANES);
        // A plan without a limit trusts all samples.
        let above = !limit.is_nan() && sums.kept[at..end].iter().any(|&kept| kept != all);
        (self.of(index, at), above)
    }

    #[inline(always)]
    fn sums_below(
        &self,
        index: usize,
        set: &PhaseSet,
        at: usize,
        limit: f32,
    ) -> (fit::Sums, fit::LeftOut) {
        let mut left_out = fit::LeftOut::nothing();
        // Beyond the end nothing is kept: those pixels are not looked at.
        let kept = fit::lanes(&self.sets[index].kept, at);
        for step in 0..set.steps() {
            let (c, s) = set.phasor(step);
            for (i, kept) in kept.iter().enumerate() {
                let above = kept >> step & 1 == 0;
                left_out.count[i] += if above { 1.0 } else { 0.0 };
                left_out.cos[i] += if above { c } else { 0.0 };
                left_out.sin[i] += if above { s } else { 0.0 };
            }
        }
        let mut sums = self.of(index, at);
        for i in 0..LANES {
            sums.plain[i] -= limit * left_out.count[i];
            sums.cos[i] -= limit * left_out.cos[i];
            sums.sin[i] -= limit * left_out.sin[i];
        }
        (sums, left_out)
    }

    fn kept(&self, index: usize, set: &PhaseSet, pixel: usize, limit: f32) -> (u64, [f32; 3]) {
        let sums = &self.sets[index];
        let kept = sums.kept[pixel];
        let mut found = [sums.plain[pixel], sums.cos[pixel], sums.sin[pixel]];
        for step in (0..set.steps()).filter(|step| kept >> step & 1 == 0) {
            let (c, s) = set.phasor(step);
            found = [found[0] - limit, found[1] - limit * c, found[2] - limit * s];
        }
        (kept, found)
    }

    fn plane(&self, frame: usize) -> &[T] {
        self.planes[frame]
    }
}
