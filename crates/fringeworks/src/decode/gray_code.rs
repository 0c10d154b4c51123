//! Gray code: which cell of the projector a pixel sees.

use super::{Line, Plan, Sample, Source, BLOCK_PIXELS};
use crate::{check_value, Error};

/// Distance of a bit's brightness from its threshold below which the bit is in doubt, in standard
/// deviations of the noise.
///
/// At 4, noise flips a bit that is not in doubt in 3 of 100 000 cases. A larger value rejects more
/// pixels of weak contrast.
const DOUBT_SIGMAS: f32 = 4.0;

/// Variance of half the difference of two frames, in units of the variance of one frame.
pub const HALF_DIFFERENCE: f32 = 0.5;

/// Variance of a frame minus the mean of two other frames, in units of the variance of one frame.
///
/// Also used where the threshold is the mean of the phase frames, which is less noisy.
const FRAME_MINUS_MEAN: f32 = 1.5;

/// Largest number of bits: 2²⁴ cells, the whole numbers that an f32 holds exactly.
const MAX_BITS: usize = 24;

/// Threshold that the bits are compared with.
pub enum Against {
    /// The frame with this bit inverted, one per bit.
    Inverse(Vec<usize>),
    /// The mean of a white and a black frame.
    WhiteBlack { white: usize, black: usize },
    /// The mean of the phase frames.
    Mean,
}

/// Gray code along one axis, the most significant bit first.
pub struct GrayCode {
    /// Index of the frame of each bit.
    pub bits: Vec<usize>,
    pub against: Against,
    /// Width of a cell, projector px.
    pub step: f32,
    /// Number of cells; a code word beyond has no meaning.
    pub cells: u32,
}

impl GrayCode {
    pub(super) fn check(&self, frames: usize) -> Result<(), Error> {
        let n = self.bits.len();
        check_value(
            "bits of the code",
            (1..=MAX_BITS).contains(&n),
            "1 to 24",
            n,
        )?;
        check_value("step of the code", self.step > 0.0, "> 0", self.step)?;
        let others: Vec<usize> = match &self.against {
            Against::Inverse(inverse) => {
                check_value("inverse bits", inverse.len() == n, "one per bit", inverse)?;
                inverse.clone()
            }
            Against::WhiteBlack { white, black } => vec![*white, *black],
            Against::Mean => Vec::new(),
        };
        let inside = self.bits.iter().chain(&others).all(|&k| k < frames);
        check_value(
            "frames of the code",
            inside,
            "frames that exist",
            &self.bits,
        )
    }
}

/// Gray code of the pixels of a block.
pub struct GrayCells {
    /// Middle of the cell, projector px; NaN where the bits are in doubt.
    pub coordinate: Line,
    /// Threshold: mean of white and black, or of a bit and its inverse, counts.
    pub threshold: Line,
    /// Half their difference, counts: the modulation of the Gray code.
    pub contrast: Line,
}

impl GrayCells {
    pub fn new() -> Self {
        let zero = [0.0; BLOCK_PIXELS];
        Self {
            coordinate: zero,
            threshold: zero,
            contrast: zero,
        }
    }
}

/// Read the Gray code of `n` pixels from `at` on. `mean` and `modulation` are of the phase frames.
#[inline(always)]
pub fn read_gray_code<S: Source>(
    source: &S,
    plan: &Plan,
    code: &GrayCode,
    (at, n): (usize, usize),
    (mean, modulation): (&Line, &Line),
    out: &mut GrayCells,
) {
    let line = |frame: usize| &source.plane(frame)[at..at + n];
    thresholds(code, line, n, (mean, modulation), out);
    let noise = &plan.noise;
    let (mut gray, mut doubt) = ([0u32; BLOCK_PIXELS], [0u32; BLOCK_PIXELS]);
    for (b, &frame) in code.bits.iter().enumerate() {
        let place = (code.bits.len() - 1 - b) as u32;
        let bits = line(frame);
        match &code.against {
            Against::Inverse(inverse) => {
                let other = line(inverse[b]);
                for i in 0..n {
                    let off = 0.5 * (bits[i].value() - other[i].value());
                    let variance = noise.variance(out.threshold[i]);
                    let limit = DOUBT_SIGMAS * DOUBT_SIGMAS * HALF_DIFFERENCE * variance;
                    gray[i] |= u32::from(off > 0.0) << place;
                    doubt[i] |= u32::from(off * off < limit) << place;
                }
            }
            Against::WhiteBlack { .. } | Against::Mean => {
                for i in 0..n {
                    let off = bits[i].value() - out.threshold[i];
                    let variance = noise.variance(out.threshold[i]);
                    let limit = DOUBT_SIGMAS * DOUBT_SIGMAS * FRAME_MINUS_MEAN * variance;
                    gray[i] |= u32::from(off > 0.0) << place;
                    doubt[i] |= u32::from(off * off < limit) << place;
                }
            }
        }
    }
    cells(code, n, &gray, &doubt, out);
}

/// Middles of the cells of `n` code words, given which bits are in doubt.
#[inline(always)]
fn cells(
    code: &GrayCode,
    n: usize,
    gray: &[u32; BLOCK_PIXELS],
    doubt: &[u32; BLOCK_PIXELS],
    out: &mut GrayCells,
) {
    for i in 0..n {
        let cell = binary(gray[i]);
        // Neighbouring cells differ in one bit. On their border that bit may be in doubt, because
        // either cell is right there; any other bit may not.
        let flipped = binary(gray[i] ^ doubt[i]);
        let sure = doubt[i] == 0 || (doubt[i].is_power_of_two() && flipped.abs_diff(cell) == 1);
        out.coordinate[i] = if sure && cell < code.cells {
            (cell as f32 + 0.5) * code.step - 0.5
        } else {
            f32::NAN
        };
    }
}

/// Threshold and contrast of `n` pixels.
#[inline(always)]
fn thresholds<'a, T: Sample>(
    code: &GrayCode,
    line: impl Fn(usize) -> &'a [T],
    n: usize,
    (mean, modulation): (&Line, &Line),
    out: &mut GrayCells,
) {
    match &code.against {
        Against::Mean => {
            out.threshold = *mean;
            out.contrast = *modulation;
        }
        Against::WhiteBlack { white, black } => {
            mean_and_contrast(line(*white), line(*black), n, out);
        }
        Against::Inverse(inverse) => {
            // The first bit has a single border, in the middle of the projector. Elsewhere it and
            // its inverse show full white and full black.
            mean_and_contrast(line(code.bits[0]), line(inverse[0]), n, out);
            for i in 0..n {
                out.contrast[i] = out.contrast[i].abs();
            }
        }
    }
}

#[inline(always)]
fn mean_and_contrast<T: Sample>(bright: &[T], dark: &[T], n: usize, out: &mut GrayCells) {
    for i in 0..n {
        out.threshold[i] = 0.5 * (bright[i].value() + dark[i].value());
        out.contrast[i] = 0.5 * (bright[i].value() - dark[i].value());
    }
}

/// Binary number of a Gray code word: every bit is the parity of itself and all higher bits.
#[inline(always)]
fn binary(gray: u32) -> u32 {
    let mut b = gray;
    b ^= b >> 16;
    b ^= b >> 8;
    b ^= b >> 4;
    b ^= b >> 2;
    b ^ (b >> 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gray_and_back() {
        for k in 0..5000u32 {
            assert_eq!(binary(k ^ (k >> 1)), k);
        }
    }
}
