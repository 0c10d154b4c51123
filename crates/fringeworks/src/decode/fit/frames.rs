//! Sums taken from the frames themselves.

use super::set::PhaseSet;
use super::sums::{Quarters, Saturated, Steps, Sums};
use crate::decode::{BLOCK_PIXELS, Line, Sample};

/// The planes of a stack, along one axis.
pub struct Frames<'a, T> {
    pub planes: &'a [&'a [T]],
}

impl<'a, T: Sample> Frames<'a, T> {
    /// Pixels of a plane.
    pub fn pixels(&self) -> usize {
        self.planes.first().map_or(0, |plane| plane.len())
    }

    /// The planes from a pixel on, followed by zeros up to a whole block.
    #[cold]
    pub fn padded(&self, at: usize) -> Vec<Vec<T>> {
        let block = |plane: &&[T]| {
            let mut out = plane[at..].to_vec();
            out.resize(BLOCK_PIXELS, T::default());
            out
        };
        self.planes.iter().map(block).collect()
    }

    /// The samples of a frame in the block from `at` on.
    #[inline(always)]
    pub fn block(&self, frame: usize, at: usize) -> &'a [T; BLOCK_PIXELS] {
        let plane = self.planes[frame];
        plane[at..].first_chunk().expect("a whole block")
    }

    /// Whether a sample of a set's block is at the sensor's limit.
    #[inline(always)]
    pub fn reach(&self, set: &PhaseSet, at: usize, limit: f32) -> bool {
        if limit > T::LARGEST || limit.is_nan() {
            return false;
        }
        let mut brightest = Line::of(T::default());
        for &frame in &set.frames {
            let counts = self.block(frame, at);
            for i in 0..BLOCK_PIXELS {
                brightest[i] = brightest[i].larger(counts[i]);
            }
        }
        let largest = brightest.iter().copied().fold(T::default(), T::larger);
        largest.value() >= limit
    }

    /// The steps of a set whose shifts are quarter turns.
    #[inline(always)]
    pub fn quarters(&self, set: &PhaseSet, at: usize) -> Option<Quarters<'a, T>> {
        let quarters = set.quarters?;
        Some(Quarters(quarters.map(|k| self.block(set.frames[k], at))))
    }

    /// The steps of a set of `N`.
    #[inline(always)]
    pub fn steps<const N: usize>(&self, set: &PhaseSet, at: usize) -> Option<Steps<'a, T, N>> {
        (set.steps() == N).then(|| Steps {
            counts: std::array::from_fn(|k| self.block(set.frames[k], at)),
            phasors: std::array::from_fn(|k| set.phasor(k)),
        })
    }

    /// Sums of a set over a block.
    #[inline(always)]
    pub fn sums(&self, set: &PhaseSet, at: usize, out: &mut Sums) {
        *out = Sums::zero();
        let mut n = 0;
        // Four frames at a time, three where three are left: the sums are loaded and stored once.
        while n < set.steps() {
            n += match set.steps() - n {
                1 => self.add::<1>(set, n, at, out),
                2 => self.add::<2>(set, n, at, out),
                3 => self.add::<3>(set, n, at, out),
                _ => self.add::<4>(set, n, at, out),
            };
        }
    }

    /// Add `N` steps from the first one on to the sums. Returns N.
    #[inline(always)]
    fn add<const N: usize>(
        &self,
        set: &PhaseSet,
        first: usize,
        at: usize,
        out: &mut Sums,
    ) -> usize {
        let counts: [_; N] = std::array::from_fn(|k| self.block(set.frames[first + k], at));
        let phasors: [_; N] = std::array::from_fn(|k| set.phasor(first + k));
        for i in 0..BLOCK_PIXELS {
            let (mut plain, mut cos, mut sin) = (out.plain[i], out.cos[i], out.sin[i]);
            for k in 0..N {
                let v = counts[k][i].value();
                plain += v;
                cos += v * phasors[k].0;
                sin += v * phasors[k].1;
            }
            (out.plain[i], out.cos[i], out.sin[i]) = (plain, cos, sin);
        }
        N
    }

    /// The same sums without the samples at the limit, and the sums of those samples' phasors.
    #[inline(always)]
    pub fn sums_below(&self, set: &PhaseSet, at: usize, limit: f32, out: &mut Sums) -> Saturated {
        *out = Sums::zero();
        let mut saturated = Saturated::none();
        for (k, &frame) in set.frames.iter().enumerate() {
            let (c, s) = set.phasor(k);
            let counts = self.block(frame, at);
            let (mut below, mut above) = (Line::of(0.0), Line::of(0.0));
            for i in 0..BLOCK_PIXELS {
                // NaN counts as kept: it makes the sums NaN and the pixel masked.
                let v = counts[i].value();
                above[i] = if v >= limit { 1.0 } else { 0.0 };
                below[i] = if v >= limit { 0.0 } else { v };
            }
            // A loop of its own: together with the choices above, the compiler would emit
            // conditional stores.
            for i in 0..BLOCK_PIXELS {
                out.plain[i] += below[i];
                out.cos[i] += below[i] * c;
                out.sin[i] += below[i] * s;
                saturated.count[i] += above[i];
                saturated.cos[i] += above[i] * c;
                saturated.sin[i] += above[i] * s;
            }
        }
        saturated
    }

    /// Which frames of the set are below the limit at a pixel (one bit each), and their sums.
    #[inline(always)]
    pub fn kept(&self, set: &PhaseSet, pixel: usize, limit: f32) -> (u64, [f32; 3]) {
        let (mut kept, mut sums) = (0, [0.0f32; 3]);
        for (k, &frame) in set.frames.iter().enumerate() {
            let value = self.planes[frame][pixel].value();
            let (c, s) = set.phasor(k);
            // Without a branch, which nobody could predict. NaN counts as kept.
            let above = value >= limit;
            let value = if above { 0.0 } else { value };
            kept |= u64::from(!above) << k;
            sums = [sums[0] + value, sums[1] + value * c, sums[2] + value * s];
        }
        (kept, sums)
    }
}
