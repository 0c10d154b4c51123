//! Words of a Gray code: the numbers of the cells that pixels see, and which bits are in doubt.

use super::{Against, GrayCells, GrayCode};
use crate::decode::{Line, Sample};

/// What the bits of a pixel say.
struct Word {
    /// Number of the cell.
    cell: u32,
    /// Number of the cell if the bits in doubt are wrong.
    other: u32,
    /// Whether no bit is in doubt.
    sure: bool,
    /// Whether one bit is in doubt.
    one_doubt: bool,
}

/// Store where pixel `i` lies: in the middle of a cell or, where `phases` follow, on the border of
/// two cells.
#[inline(always)]
fn place(code: &GrayCode, word: &Word, phases: bool, i: usize, out: &mut GrayCells) {
    let first = code.offset - 0.5;
    let (cell, other) = (word.cell, word.other);
    let sure = word.sure && cell < code.cells;
    // Neighbouring cells differ in one bit. On their border that bit may be in doubt, because
    // either cell is right there; any other bit may not.
    let border = word.one_doubt && cell.abs_diff(other) == 1 && cell.min(other) < code.cells;
    let middle = (cell as f32 + 0.5) * code.step + first;
    let between = cell.max(other) as f32 * code.step + first;
    // Without phases, the bit in doubt is a better guess than none.
    let guess = if phases { between } else { middle };
    let uncertain = if border { guess } else { f32::NAN };
    out.coordinate[i] = if sure { middle } else { uncertain };
    let half_width = out.half_width[i];
    out.half_width[i] = if sure { 0.5 * code.step } else { half_width };
}

/// Read a code of two levels.
#[inline(always)]
pub fn read_bits<'a, T: Sample>(
    code: &GrayCode,
    line: impl Fn(usize) -> &'a [T],
    n: usize,
    phases: bool,
    out: &mut GrayCells,
) {
    let zero = Line::of(0u32);
    let (mut gray, mut doubt, mut alien) = (zero, zero, zero);
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
                    alien[i] |= u32::from(off * off > out.alien_above[i]);
                }
            }
            Against::WhiteBlack { .. } | Against::Mean => {
                for i in 0..n {
                    let off = bits[i].value() - out.threshold[i];
                    gray[i] |= u32::from(off > 0.0) << place;
                    doubt[i] |= u32::from(off * off < out.doubt_below[i]) << place;
                    alien[i] |= u32::from(off * off > out.alien_above[i]);
                }
            }
        }
    }
    for i in 0..n {
        let word = Word {
            cell: binary(gray[i]),
            other: binary(gray[i] ^ doubt[i]),
            sure: doubt[i] == 0 && alien[i] == 0,
            one_doubt: doubt[i].is_power_of_two() && alien[i] == 0,
        };
        place(code, &word, phases, i, out);
    }
}

/// Read a reflected code of more than two levels.
///
/// A digit rises with the number where the digits before it form an even number, and falls where
/// they form an odd one.
#[inline(always)]
pub fn read_digits<'a, T: Sample>(
    code: &GrayCode,
    line: impl Fn(usize) -> &'a [T],
    n: usize,
    phases: bool,
    out: &mut GrayCells,
) {
    let zero = Line::of(0u32);
    let (mut cells, mut others, mut doubts) = (zero, zero, zero);
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
            cells[i] = number(cells[i], digit as u32);
            others[i] = number(others[i], next as u32);
            doubts[i] += u32::from(!sure);
        }
    }
    for i in 0..n {
        let word = Word {
            cell: cells[i],
            other: others[i],
            sure: doubts[i] == 0,
            one_doubt: doubts[i] == 1,
        };
        place(code, &word, phases, i, out);
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
