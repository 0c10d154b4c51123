//! Sums taken from the frames themselves.

use super::set::PhaseSet;
use super::sums::{lanes, Saturated, Sums};
use crate::decode::{Sample, LANES};

/// The planes of a stack, along one axis.
pub struct Frames<'a, T> {
    pub planes: &'a [&'a [T]],
}

impl<T: Sample> Frames<'_, T> {
    /// Sums of a set over a group of pixels; true where a sample is at the sensor's limit.
    #[inline(always)]
    pub fn sums(&self, set: &PhaseSet, at: usize, limit: f32) -> (Sums, bool) {
        let mut out = Sums::zero();
        let mut brightest = [T::default(); LANES];
        for (k, &frame) in set.frames.iter().enumerate() {
            let (c, s) = set.phasor(k);
            let counts = lanes(self.planes[frame], at);
            for i in 0..LANES {
                let v = counts[i].value();
                out.plain[i] += v;
                out.cos[i] += v * c;
                out.sin[i] += v * s;
            }
            for i in 0..LANES {
                brightest[i] = brightest[i].larger(counts[i]);
            }
        }
        let mut above = 0;
        for v in brightest {
            above |= u32::from(v.value() >= limit);
        }
        (out, above > 0)
    }

    /// The same sums without the samples at the limit, and the sums of those samples' phasors.
    #[inline(always)]
    pub fn sums_below(&self, set: &PhaseSet, at: usize, limit: f32) -> (Sums, Saturated) {
        let (mut out, mut saturated) = (Sums::zero(), Saturated::none());
        for (k, &frame) in set.frames.iter().enumerate() {
            let (c, s) = set.phasor(k);
            let counts = lanes(self.planes[frame], at);
            let (mut below, mut above) = ([0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                // NaN counts as kept: it makes the sums NaN and the pixel masked.
                let v = counts[i].value();
                above[i] = if v >= limit { 1.0 } else { 0.0 };
                below[i] = if v >= limit { 0.0 } else { v };
            }
            // A loop of its own: together with the choices above, the compiler would emit
            // conditional stores.
            for i in 0..LANES {
                out.plain[i] += below[i];
                out.cos[i] += below[i] * c;
                out.sin[i] += below[i] * s;
                saturated.count[i] += above[i];
                saturated.cos[i] += above[i] * c;
                saturated.sin[i] += above[i] * s;
            }
        }
        (out, saturated)
    }

    /// Which frames of the set are below the limit at a pixel (one bit each), and their sums.
    #[inline(always)]
    pub fn kept(&self, set: &PhaseSet, pixel: usize, limit: f32) -> (u64, [f32; 3]) {
        let (mut kept, mut sums) = (0, [0.0f32; 3]);
        for (k, &frame) in set.frames.iter().enumerate() {
            let value = self.planes[frame][pixel].value();
            let above = value >= limit;
            if !above {
                let (c, s) = set.phasor(k);
                kept |= 1 << k;
                sums = [sums[0] + value, sums[1] + value * c, sums[2] + value * s];
            }
        }
        (kept, sums)
    }
}
