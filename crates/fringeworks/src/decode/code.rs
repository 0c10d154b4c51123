//! Gray code: which cell of the projector a pixel sees.

use super::{Line, Plan, Sample, Source, BLOCK};
use crate::{check_value, Error};

/// A bit nearer to its threshold than this many standard deviations is in doubt.
const DOUBT: f32 = 4.0;

/// What the bits are compared with.
pub enum Against {
    /// The frame with every bit inverted.
    Inverse(Vec<usize>),
    /// Half-way between a white and a black frame.
    Levels { white: usize, black: usize },
    /// The mean of the phase frames.
    Mean,
}

/// Gray code along one axis, the most significant bit first.
pub struct Code {
    /// Index of the frame of each bit.
    pub bits: Vec<usize>,
    pub against: Against,
    /// Width of a cell, projector px.
    pub step: f32,
    /// Number of cells; a code beyond has no meaning.
    pub cells: u32,
}

impl Code {
    pub(super) fn check(&self, frames: usize) -> Result<(), Error> {
        let n = self.bits.len();
        check_value("bits of the code", (1..=24).contains(&n), "1 to 24", n)?;
        check_value("step of the code", self.step > 0.0, "> 0", self.step)?;
        let others: Vec<usize> = match &self.against {
            Against::Inverse(inverse) => {
                check_value("inverse bits", inverse.len() == n, "one per bit", inverse)?;
                inverse.clone()
            }
            Against::Levels { white, black } => vec![*white, *black],
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

/// What the code says about the pixels of a block.
pub struct Read {
    /// Middle of the cell, projector px; NaN where bits cannot be told.
    pub coordinate: Line,
    /// Mean of white and black, or of a bit and its inverse, counts.
    pub level: Line,
    /// Half their difference, counts: how much light the projector adds.
    pub contrast: Line,
}

impl Read {
    pub fn new() -> Self {
        let zero = [0.0; BLOCK];
        Self {
            coordinate: zero,
            level: zero,
            contrast: zero,
        }
    }
}

/// Read the code of a block. `mean` and `modulation` are those of the phase frames.
#[inline(always)]
pub fn read<S: Source>(
    source: &S,
    plan: &Plan,
    code: &Code,
    at: usize,
    n: usize,
    (mean, modulation): (&Line, &Line),
    out: &mut Read,
) {
    let line = |frame: usize| &source.plane(frame)[at..at + n];
    levels(code, line, n, (mean, modulation), out);
    let noise = &plan.noise;
    let (mut gray, mut doubt) = ([0u32; BLOCK], [0u32; BLOCK]);
    for (b, &frame) in code.bits.iter().enumerate() {
        let place = (code.bits.len() - 1 - b) as u32;
        let bits = line(frame);
        // The noise of a difference of two frames, or of a frame and a mean.
        match &code.against {
            Against::Inverse(inverse) => {
                let other = line(inverse[b]);
                for i in 0..n {
                    let off = 0.5 * (bits[i].value() - other[i].value());
                    let limit = DOUBT * DOUBT * 0.5 * noise.variance(out.level[i]);
                    gray[i] |= u32::from(off > 0.0) << place;
                    doubt[i] |= u32::from(off * off < limit) << place;
                }
            }
            _ => {
                for i in 0..n {
                    let off = bits[i].value() - out.level[i];
                    let limit = DOUBT * DOUBT * 1.5 * noise.variance(out.level[i]);
                    gray[i] |= u32::from(off > 0.0) << place;
                    doubt[i] |= u32::from(off * off < limit) << place;
                }
            }
        }
    }
    for i in 0..n {
        let cell = binary(gray[i]);
        // Neighbouring cells differ in one bit: that one alone may be in doubt, on their border.
        let flipped = binary(gray[i] ^ doubt[i]);
        let sure = doubt[i] == 0 || (doubt[i].is_power_of_two() && flipped.abs_diff(cell) == 1);
        out.coordinate[i] = if sure && cell < code.cells {
            (cell as f32 + 0.5) * code.step - 0.5
        } else {
            f32::NAN
        };
    }
}

#[inline(always)]
fn levels<'a, T: Sample>(
    code: &Code,
    line: impl Fn(usize) -> &'a [T],
    n: usize,
    (mean, modulation): (&Line, &Line),
    out: &mut Read,
) {
    match &code.against {
        Against::Mean => {
            out.level = *mean;
            out.contrast = *modulation;
        }
        Against::Levels { white, black } => {
            half_way(line(*white), line(*black), n, out);
        }
        Against::Inverse(inverse) => {
            // The first bit splits the projector in half: never on a border but there.
            half_way(line(code.bits[0]), line(inverse[0]), n, out);
            for i in 0..n {
                out.contrast[i] = out.contrast[i].abs();
            }
        }
    }
}

#[inline(always)]
fn half_way<T: Sample>(bright: &[T], dark: &[T], n: usize, out: &mut Read) {
    for i in 0..n {
        out.level[i] = 0.5 * (bright[i].value() + dark[i].value());
        out.contrast[i] = 0.5 * (bright[i].value() - dark[i].value());
    }
}

/// From Gray to binary: every bit is the parity of itself and all above.
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
