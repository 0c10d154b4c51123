//! Sums over the samples of a block of pixels.

use crate::decode::{BLOCK_PIXELS, Line, Sample};

/// Sums of the samples of every pixel of a block: Σ I, Σ I cos δ and Σ I sin δ.
pub trait SumsAt {
    fn at(&self, i: usize) -> [f32; 3];
}

/// Σ I, Σ I cos δ and Σ I sin δ of a block.
pub struct Sums {
    pub plain: Line,
    pub cos: Line,
    pub sin: Line,
}

impl Sums {
    pub const fn zero() -> Self {
        let zero = Line::of(0.0);
        Self {
            plain: zero,
            cos: zero,
            sin: zero,
        }
    }
}

impl SumsAt for Sums {
    #[inline(always)]
    fn at(&self, i: usize) -> [f32; 3] {
        [self.plain[i], self.cos[i], self.sin[i]]
    }
}

/// Four steps of a quarter turn, in the order of their cosines and sines: 1, −1, then 1, −1. Their
/// sums are differences.
pub struct Quarters<'a, T>(pub [&'a [T; BLOCK_PIXELS]; 4]);

impl<T: Sample> SumsAt for Quarters<'_, T> {
    #[inline(always)]
    fn at(&self, i: usize) -> [f32; 3] {
        let [right, left, up, down] = self.0.map(|counts| counts[i].value());
        [(right + left) + (up + down), right - left, up - down]
    }
}

/// A few steps, which are summed while they are fitted.
pub struct Steps<'a, T, const N: usize> {
    pub counts: [&'a [T; BLOCK_PIXELS]; N],
    /// Cosine and sine of every shift.
    pub phasors: [(f32, f32); N],
}

impl<T: Sample, const N: usize> SumsAt for Steps<'_, T, N> {
    #[inline(always)]
    fn at(&self, i: usize) -> [f32; 3] {
        let mut sums = [0.0; 3];
        for n in 0..N {
            let (value, (c, s)) = (self.counts[n][i].value(), self.phasors[n]);
            sums = [sums[0] + value, sums[1] + value * c, sums[2] + value * s];
        }
        sums
    }
}

/// Samples of a block at the sensor's limit: their number, and Σ cos δ and Σ sin δ over them.
pub struct Saturated {
    pub count: Line,
    pub cos: Line,
    pub sin: Line,
}

impl Saturated {
    pub const fn none() -> Self {
        let zero = Line::of(0.0);
        Self {
            count: zero,
            cos: zero,
            sin: zero,
        }
    }
}
