//! Words of a Gray code: the numbers of the cells that pixels see, and which bits are in doubt.

use super::weak::settled;
use super::{Against, GrayCells, GrayCode};
use crate::decode::{Line, Sample};

/// Half width of a coordinate that the brightness of a bit tells within a blurred border, over that
/// of the border: half for blur that differs from place to place, and noise of up to a quarter of the
/// limit of doubt, by their squares.
const UNKNOWN_WITHIN_BORDER: f32 = 0.66;

/// Distance within which a border is blurred, over half the width of its stripes, below which the
/// bit is surely resolved: blur may be four times the usual one at some pixels.
const NARROW_BORDER: f32 = 0.25;

/// Share of its contrast up to which a bit in doubt shows the blur of its border. Where noise leaves
/// bits in doubt that are further from their threshold, the pixel may lie anywhere in the cells.
const WITHIN_BLUR: f32 = 0.5;

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
    let guessed = if phases { half_width } else { 0.5 * code.step };
    out.half_width[i] = if sure { 0.5 * code.step } else { guessed };
}

/// Store the cells that the bits of pixel `i` allow, where no phases follow: the middle of their
/// range, and half its width. `share` is the brightness of a bit over that at which it leaves doubt,
/// at the distance `blurred` from its border.
///
/// Bits in doubt may have either value. The cells that remain are one range where the finest bits
/// alone are in doubt, because the camera does not resolve them, or where the pixel lies on the
/// border of two coarser cells: the bits that follow are then 1, 0, 0, …, as on both sides of it.
/// Otherwise they are several ranges, and the coordinate is NaN; so it is where no bit is firm, and
/// where the range is wider than the widest.
#[inline(always)]
fn place_range(
    code: &GrayCode,
    (gray, doubt): (u32, u32),
    (share, blurred): (impl Fn(u32) -> f32, f32),
    i: usize,
    out: &mut GrayCells,
) {
    let (cell, first) = (binary(gray), code.offset - 0.5);
    let Some((top, count)) = open_bits(gray, doubt) else {
        let known = doubt == 0 && cell < code.cells;
        let middle = (cell as f32 + 0.5) * code.step + first;
        out.coordinate[i] = if known { middle } else { f32::NAN };
        out.half_width[i] = 0.5 * code.step;
        return;
    };
    let range = (1u32 << count) as f32 * code.step;
    let border = (((cell >> top >> 1) * 2 + 1) << top) as f32 * code.step;
    // A bit in doubt is on its border where finer bits are firm, or where its stripes are far wider
    // than the blur; otherwise the pixel may not resolve it.
    let resolved = top > count || blurred < NARROW_BORDER * range;
    let (within, half) = if resolved && blurred < range {
        // The bit of a border rises where the number of coarser cells is even.
        let coarser = cell >> top >> 1;
        let rises = if coarser & 1 == 0 { 1.0 } else { -1.0 };
        let half = UNKNOWN_WITHIN_BORDER * blurred;
        (rises * share(top) * blurred, half)
    } else {
        (0.0, range)
    };
    let some_firm = doubt.count_ones() < code.bits.len() as u32;
    let inside = border - half < code.cells as f32 * code.step && range <= code.widest;
    let known = some_firm && inside;
    let middle = border + within + first;
    out.coordinate[i] = if known { middle } else { f32::NAN };
    out.half_width[i] = half;
}

/// Place of the most significant bit in doubt, and the number of finest bits in doubt below it; `None`
/// where no bit is in doubt, or where the cells that the firm bits allow are several ranges.
#[inline(always)]
fn open_bits(gray: u32, doubt: u32) -> Option<(u32, u32)> {
    let top = 31 - (doubt | 1).leading_zeros();
    let finer = (1u32 << top) - 1;
    let open = doubt & finer;
    // The finest bits in doubt are contiguous; the others, from the border on, are 1, 0, 0, …
    let contiguous = open & open.wrapping_add(1) == 0;
    let count = open.count_ones();
    let firm = (gray & finer) >> count;
    let at_border = firm == (finer.wrapping_add(1) >> count) >> 1;
    (doubt != 0 && contiguous && at_border).then_some((top, count))
}

/// Store the ranges of `n` pixels by their bits, which of these are in doubt, and whether any light
/// is not that of the projector alone; there, every bit is in doubt.
#[inline(always)]
fn place_ranges<'a, T: Sample>(
    code: &GrayCode,
    line: impl Fn(usize) -> &'a [T],
    n: usize,
    (gray, doubt, alien): (&Line<u32>, &Line<u32>, &Line<u32>),
    out: &mut GrayCells,
) {
    let last = code.bits.len() - 1;
    for i in 0..n {
        let limit = out.doubt_below[i].max(f32::MIN_POSITIVE).sqrt();
        let threshold = out.threshold[i];
        let off = |place: u32| distance(code, &line, threshold, place, i);
        let share = |place: u32| (off(place) / limit).clamp(-1.0, 1.0);
        let known = alien[i] == 0;
        let unknown = if known {
            doubt[i]
        } else {
            u32::MAX >> (31 - last)
        };
        // Noise leaves the bits of a weak pixel in doubt farther from the border than blur does.
        let seen = code.doubt_share * out.contrast[i];
        let blurred = if limit <= seen || seen <= 0.0 {
            code.blurred
        } else if limit < WITHIN_BLUR * out.contrast[i] {
            code.blurred * limit / seen
        } else {
            f32::INFINITY
        };
        place_range(code, (gray[i], unknown), (share, blurred), i, out);
        if known
            && out.coordinate[i].is_nan()
            && let Some(bits) = settled(code, &off, i, out)
        {
            place_range(code, bits, (share, blurred), i, out);
        }
    }
}

/// Distance of a bit of pixel `i` from its threshold, above 0 where the bit is 1, counts.
#[inline(always)]
fn distance<'a, T: Sample>(
    code: &GrayCode,
    line: &impl Fn(usize) -> &'a [T],
    threshold: f32,
    place: u32,
    i: usize,
) -> f32 {
    let b = code.bits.len() - 1 - place as usize;
    let bit = line(code.bits[b])[i].value();
    let off = match &code.against {
        Against::Inverse(inverse) => 0.5 * (bit - line(inverse[b])[i].value()),
        Against::WhiteBlack { .. } | Against::Mean => bit - threshold,
    };
    if code.inverted >> place & 1 == 1 {
        -off
    } else {
        off
    }
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
    for word in gray.iter_mut() {
        *word ^= code.inverted;
    }
    if phases {
        place_words(code, line, n, (&gray, &doubt, &alien), out);
    } else {
        place_ranges(code, line, n, (&gray, &doubt, &alien), out);
    }
}

/// Store where `n` pixels lie whose phases tell the rest, by their bits, which of these are in doubt,
/// and whether any light is not that of the projector alone.
#[inline(always)]
fn place_words<'a, T: Sample>(
    code: &GrayCode,
    line: impl Fn(usize) -> &'a [T],
    n: usize,
    (gray, doubt, alien): (&Line<u32>, &Line<u32>, &Line<u32>),
    out: &mut GrayCells,
) {
    for i in 0..n {
        let own = alien[i] == 0;
        place(code, &word_of(gray[i], doubt[i], own), true, i, out);
        if doubt[i] == 0 || !own {
            continue;
        }
        let threshold = out.threshold[i];
        let off = |place: u32| distance(code, &line, threshold, place, i);
        let word = word_of(gray[i], doubt[i], own);
        if out.half_width[i] < 0.5 * code.step && out.coordinate[i].is_finite() {
            over_own_cell(code, &word, off(doubt[i].trailing_zeros()), i, out);
        }
        // A weak bit in doubt may be far from its border.
        let weak = out.half_width[i] >= code.step;
        if (out.coordinate[i].is_nan() || weak)
            && let Some((gray, doubt)) = settled(code, &off, i, out)
        {
            place(code, &word_of(gray, doubt, true), true, i, out);
        }
    }
}

/// Extend the range of a pixel on the border of two cells over the cell that its bit shows.
///
/// `off` is the distance of the bit from its threshold: the closer, the farther the pixel may lie
/// beyond the border. But light of other surfaces makes bits as weak far from their border, anywhere
/// in the cell.
#[inline(always)]
fn over_own_cell(code: &GrayCode, word: &Word, off: f32, i: usize, out: &mut GrayCells) {
    let limit = out.doubt_below[i].max(f32::MIN_POSITIVE).sqrt();
    let beyond = (1.0 - off.abs() / limit).max(0.0) * out.half_width[i];
    let side = if word.cell > word.other { 1.0 } else { -1.0 };
    out.coordinate[i] += side * 0.5 * (code.step - beyond);
    out.half_width[i] = 0.5 * (code.step + beyond);
}

/// The word of some bits, which of them are in doubt, and whether the light is the projector's.
#[inline(always)]
fn word_of(gray: u32, doubt: u32, own_light: bool) -> Word {
    Word {
        cell: binary(gray),
        other: binary(gray ^ doubt),
        sure: doubt == 0 && own_light,
        one_doubt: doubt.is_power_of_two() && own_light,
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
    for (b, &frame) in code.bits.iter().enumerate() {
        let inverted = code.inverted >> (code.bits.len() - 1 - b) & 1 == 1;
        let sign = if inverted { -1.0 } else { 1.0 };
        let samples = line(frame);
        for i in 0..n {
            let half_level = out.contrast[i] / top as f32;
            let off = sign * (samples[i].value() - out.threshold[i]);
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
    use super::super::tests_of_words::code;
    use super::*;

    /// Middle and half width of the cells that agree with the firm bits; none for several ranges.
    fn allowed(bits: u32, gray: u32, doubt: u32) -> Option<(f32, f32)> {
        let cells: Vec<u32> = (0..1 << bits)
            .filter(|k| (k ^ (k >> 1) ^ gray) & !doubt == 0)
            .collect();
        let (first, last) = (cells[0], cells[cells.len() - 1]);
        let one_range = (last - first) as usize == cells.len() - 1;
        let width = cells.len() as f32;
        let some_firm = doubt.count_ones() < bits;
        (one_range && some_firm).then_some((first as f32 + 0.5 * width, 0.5 * width))
    }

    #[test]
    fn ranges_are_the_cells_that_firm_bits_allow() {
        let bits = 7;
        let code = code(bits as usize);
        let mut out = GrayCells::new();
        for gray in 0..1u32 << bits {
            for doubt in 0..1u32 << bits {
                place_range(&code, (gray, doubt), (|_| 0.0, code.blurred), 0, &mut out);
                let found = (out.coordinate[0], out.half_width[0]);
                match allowed(bits, gray, doubt) {
                    Some(expected) => assert_eq!(found, expected, "{gray:b} {doubt:b}"),
                    None => assert!(found.0.is_nan(), "{gray:b} {doubt:b}"),
                }
            }
        }
    }

    #[test]
    fn brightness_tells_the_place_within_a_blurred_border() {
        let mut code = code(7);
        code.blurred = 0.2;
        let mut out = GrayCells::new();
        for border in 1..1u32 << 7 {
            let (below, above) = (border - 1, border);
            let (gray, next) = (below ^ (below >> 1), above ^ (above >> 1));
            let doubt = gray ^ next;
            for share in [-1.0f32, -0.4, 0.0, 1.0] {
                place_range(&code, (gray, doubt), (|_| share, code.blurred), 0, &mut out);
                // Brighter towards the cell whose bit is 1.
                let towards = if next & doubt != 0 { share } else { -share };
                let expected = border as f32 + 0.2 * towards;
                assert!((out.coordinate[0] - expected).abs() < 1e-5);
                assert!((out.half_width[0] - 0.2 * UNKNOWN_WITHIN_BORDER).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_bit_in_doubt_leaves_its_own_cell_and_a_part_of_the_next() {
        let code = code(7);
        for border in 1..1u32 << 7 {
            let (below, above) = (border - 1, border);
            let doubt = (below ^ (below >> 1)) ^ (above ^ (above >> 1));
            for (own, side) in [(below, -1.0), (above, 1.0)] {
                let word = word_of(own ^ (own >> 1), doubt, true);
                for share in [0.0f32, 0.4, 1.0] {
                    let mut out = GrayCells::new();
                    out.doubt_below[0] = 9.0;
                    out.half_width[0] = 0.25;
                    place(&code, &word, true, 0, &mut out);
                    over_own_cell(&code, &word, 3.0 * share, 0, &mut out);
                    let (middle, half) = (out.coordinate[0], out.half_width[0]);
                    let inner = middle + side * half - border as f32;
                    let beyond = border as f32 - (middle - side * half);
                    assert!((inner - side).abs() < 1e-5, "{border} {share}");
                    assert!((side * beyond - 0.25 * (1.0 - share)).abs() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn gray_and_back() {
        for k in 0..5000u32 {
            assert_eq!(binary(k ^ (k >> 1)), k);
        }
    }
}
