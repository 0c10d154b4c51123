//! Words of a Gray code: the numbers of the cells that pixels see, and which bits are in doubt.

use super::{Against, GrayCells, GrayCode};
use crate::decode::{Sample, BLOCK_PIXELS};

/// Words of the pixels of a block, and the second word of those with a bit in doubt.
pub struct Words {
    /// Number of the cell.
    pub cell: [u32; BLOCK_PIXELS],
    /// Number of the cell if the bits in doubt are wrong.
    pub other: [u32; BLOCK_PIXELS],
    /// Number of bits in doubt; more than one count as two.
    pub doubts: [u32; BLOCK_PIXELS],
}

impl Words {
    fn new() -> Self {
        Self {
            cell: [0; BLOCK_PIXELS],
            other: [0; BLOCK_PIXELS],
            doubts: [0; BLOCK_PIXELS],
        }
    }
}

/// The words of a code of two levels.
#[inline(always)]
pub fn read_bits<'a, T: Sample>(
    code: &GrayCode,
    line: impl Fn(usize) -> &'a [T],
    n: usize,
    out: &GrayCells,
) -> Words {
    let (mut gray, mut doubt) = ([0u32; BLOCK_PIXELS], [0u32; BLOCK_PIXELS]);
    for (b, &frame) in code.bits.iter().enumerate() {
        let place = (code.bits.len() - 1 - b) as u32;
        let bits = line(frame);
        match &code.against {
            Against::Inverse(inverse) => {
                let other = line(inverse[b]);
                for i in 0..n {
                    let off = 0.5 * (bits[i].value() - other[i].value());
                    gray[i] |= u32::from(off > 0.0) << place;
                    doubt[i] |= u32::from(off * off < out.doubt_below[i]) << place;
                }
            }
            Against::WhiteBlack { .. } | Against::Mean => {
                for i in 0..n {
                    let off = bits[i].value() - out.threshold[i];
                    gray[i] |= u32::from(off > 0.0) << place;
                    doubt[i] |= u32::from(off * off < out.doubt_below[i]) << place;
                }
            }
        }
    }
    let mut words = Words::new();
    for i in 0..n {
        words.cell[i] = binary(gray[i]);
        words.other[i] = binary(gray[i] ^ doubt[i]);
        let several = doubt[i] & doubt[i].wrapping_sub(1) != 0;
        words.doubts[i] = u32::from(doubt[i] != 0) + u32::from(several);
    }
    words
}

/// The words of a reflected code of more than two levels.
///
/// A digit rises with the number where the digits before it form an even number, and falls where
/// they form an odd one.
#[inline(always)]
pub fn read_digits<'a, T: Sample>(
    code: &GrayCode,
    line: impl Fn(usize) -> &'a [T],
    n: usize,
    out: &GrayCells,
) -> Words {
    let mut words = Words::new();
    let (levels, top) = (code.levels, code.levels - 1);
    let number = |before: u32, digit: u32| {
        before * levels + if before % 2 == 1 { top - digit } else { digit }
    };
    for &frame in &code.bits {
        let samples = line(frame);
        for i in 0..n {
            let half_level = out.contrast[i] / top as f32;
            let off = samples[i].value() - out.threshold[i];
            let level = 0.5 * (off / half_level + top as f32);
            let digit = level.round().clamp(0.0, top as f32);
            let away = level - digit;
            // Beyond the darkest and the brightest level, the only border is behind.
            let outside = if level < 0.0 || level > top as f32 {
                -1.0
            } else {
                1.0
            };
            let to_border = (1.0 - outside * 2.0 * away.abs()) * half_level;
            let sure = half_level > 0.0 && to_border * to_border >= out.doubt_below[i];
            let step = if sure { 0.0 } else { outside * away.signum() };
            let next = (digit + step).clamp(0.0, top as f32);
            words.cell[i] = number(words.cell[i], digit as u32);
            words.other[i] = number(words.other[i], next as u32);
            words.doubts[i] += u32::from(!sure);
        }
    }
    words
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
