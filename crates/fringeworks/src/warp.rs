//! Maps moved back along a flow, by cubic B-splines.
//!
//! The coefficients come from the recursive filter of Unser (IEEE Signal Processing Magazine 16,
//! 1999) along columns and then along rows, mirrored at the borders.

use crate::{Error, Image, check_length};
use rayon::prelude::*;

/// Pole of the filter of cubic B-splines, √3 − 2.
const POLE: f64 = -0.267_949_192_431_122_7;

/// Gain of the filter, (1 − z)(1 − 1/z) for its pole z.
const GAIN: f64 = 6.0;

/// Terms of the start of the filter: the 28th power of the pole is below 1e-16.
const TERMS: usize = 28;

/// Columns and rows that are filtered side by side, one in each lane of vectors.
const LANES: usize = 16;

/// Return a map as it would be `time` frames earlier: what moves along the flow is moved back.
///
/// `flow` has the columns and rows per frame of each pixel. Pixels without flow keep their values.
/// NaN where a value would come from outside, or from next to what is not finite.
///
/// ```
/// use fringeworks::{Image, warp::warp_by_flow};
///
/// let map = Image::new(&[1.0, 2.0, 3.0, 4.0, 5.0], 1, 5)?;
/// let flow = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
/// let found = warp_by_flow(map, &flow, 1.0)?;
/// assert!((found[1] - 3.0).abs() < 1e-6 && found[2] == 3.0 && found[4].is_nan());
/// # Ok::<(), fringeworks::Error>(())
/// ```
///
/// # Errors
///
/// For a flow of another length than two per pixel.
pub fn warp_by_flow(values: Image<f32>, flow: &[f32], time: f32) -> Result<Vec<f32>, Error> {
    let (height, width) = values.shape();
    check_length("flow", flow.len(), 2 * height * width)?;
    let mut out = values.to_vec();
    if flow.par_iter().all(|&off| off == 0.0) {
        return Ok(out);
    }
    let coefficients = coefficients(values);
    let source = Source {
        coefficients: &coefficients,
        values: &values,
        finite: values.par_iter().all(|value| value.is_finite()),
        height,
        width,
    };
    out.par_chunks_exact_mut(width)
        .zip(flow.par_chunks_exact(2 * width))
        .enumerate()
        .for_each(|(y, (out, flow))| move_row(&source, y, flow, time, out));
    Ok(out)
}

/// Take the values of a row from where they were; those without flow stay.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn move_row(source: &Source, y: usize, flow: &[f32], time: f32, out: &mut [f32]) {
    for (x, (value, off)) in out.iter_mut().zip(flow.chunks_exact(2)).enumerate() {
        if off[0] != 0.0 || off[1] != 0.0 {
            let row = y as f64 + f64::from(time * off[1]);
            let column = x as f64 + f64::from(time * off[0]);
            *value = source.at(row, column);
        }
    }
}

/// What values are taken from.
struct Source<'a> {
    coefficients: &'a [f32],
    values: &'a [f32],
    /// Whether all values are finite.
    finite: bool,
    height: usize,
    width: usize,
}

impl Source<'_> {
    /// Value at a place; NaN outside of the map, and next to values that are not finite.
    #[inline(always)]
    fn at(&self, row: f64, column: f64) -> f32 {
        let inside = row >= 0.0
            && row <= (self.height - 1) as f64
            && column >= 0.0
            && column <= (self.width - 1) as f64;
        if !inside {
            return f32::NAN;
        }
        let (y, x) = (row as usize, column as usize);
        let (down, right) = (row - y as f64, column - x as f64);
        if !(self.finite || self.known((y, down > 0.0), (x, right > 0.0))) {
            return f32::NAN;
        }
        let (vertical, horizontal) = (weights(down), weights(right));
        // Sums over four rows, side by side for four columns.
        let mut sums = [0.0; 4];
        let inner = y >= 1 && y + 2 < self.height && x >= 1 && x + 2 < self.width;
        let first = if inner {
            (y - 1) * self.width + x - 1
        } else {
            0
        };
        for (k, weight) in vertical.iter().enumerate() {
            let four: [f32; 4] = if inner {
                let line = &self.coefficients[first + k * self.width..][..4];
                [line[0], line[1], line[2], line[3]]
            } else {
                let line = mirrored(y + k, self.height) * self.width;
                std::array::from_fn(|i| self.coefficients[line + mirrored(x + i, self.width)])
            };
            for i in 0..4 {
                sums[i] += weight * f64::from(four[i]);
            }
        }
        (0..4).map(|i| horizontal[i] * sums[i]).sum::<f64>() as f32
    }

    /// Whether the values around a place are finite; the next row and column count where the place
    /// lies between.
    fn known(&self, (y, below): (usize, bool), (x, beside): (usize, bool)) -> bool {
        (y..=y + usize::from(below)).all(|row| {
            let first = row * self.width + x;
            self.values[first..=first + usize::from(beside)]
                .iter()
                .all(|value| value.is_finite())
        })
    }
}

/// Index of sample `k − 1` of a mirrored line.
#[inline(always)]
fn mirrored(k: usize, length: usize) -> usize {
    let (at, last) = (k.abs_diff(1), length - 1);
    if last == 0 {
        return 0;
    }
    let at = at % (2 * last);
    at.min(2 * last - at)
}

/// Weights of the four coefficients around a place, at a share of the way to the third.
#[inline(always)]
fn weights(share: f64) -> [f64; 4] {
    let rest = 1.0 - share;
    let first = rest * rest * rest / 6.0;
    let second = (share * share * (share - 2.0) * 3.0 + 4.0) / 6.0;
    let third = (rest * rest * (rest - 2.0) * 3.0 + 4.0) / 6.0;
    [first, second, third, 1.0 - first - second - third]
}

/// Coefficients of the splines through the values; those that are not finite count as zero.
fn coefficients(values: Image<f32>) -> Vec<f32> {
    let (height, width) = values.shape();
    let strips = along_columns(values);
    // Rows are filtered side by side, in the lanes.
    let mut out = vec![0.0; height * width];
    out.par_chunks_mut(LANES * width)
        .enumerate()
        .for_each_init(Vec::new, |lines, (band, out)| {
            lines.clear();
            lines.resize(width, [0.0; LANES]);
            for (lane, y) in (band * LANES..).take(out.len() / width).enumerate() {
                for (strip, lines) in strips.iter().zip(lines.chunks_mut(LANES)) {
                    let row = &strip[y * LANES..];
                    for (line, &value) in lines.iter_mut().zip(row) {
                        line[lane] = f64::from(value);
                    }
                }
            }
            filter(lines);
            for (lane, row) in out.chunks_exact_mut(width).enumerate() {
                for (value, line) in row.iter_mut().zip(&*lines) {
                    *value = line[lane] as f32;
                }
            }
        });
    out
}

/// The values filtered along columns: strips of as many columns as lanes, row after row.
fn along_columns(values: Image<f32>) -> Vec<Vec<f32>> {
    let (height, width) = values.shape();
    (0..width.div_ceil(LANES))
        .into_par_iter()
        .map_init(Vec::new, |lines, strip| {
            let first = strip * LANES;
            let count = LANES.min(width - first);
            lines.clear();
            lines.resize(height, [0.0; LANES]);
            for (line, row) in lines.iter_mut().zip(values.chunks_exact(width)) {
                for (lane, &value) in line.iter_mut().zip(&row[first..first + count]) {
                    *lane = if value.is_finite() {
                        f64::from(value)
                    } else {
                        0.0
                    };
                }
            }
            filter(lines);
            lines.iter().flatten().map(|&lane| lane as f32).collect()
        })
        .collect()
}

/// Replace samples along the first axis by coefficients, in every lane.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn filter(lines: &mut [[f64; LANES]]) {
    let last = lines.len().saturating_sub(1);
    if last == 0 {
        return;
    }
    for line in lines.iter_mut() {
        for lane in line {
            *lane *= GAIN;
        }
    }
    lines[0] = start(lines);
    for k in 1..=last {
        let before = lines[k - 1];
        for (lane, &one) in lines[k].iter_mut().zip(&before) {
            *lane += POLE * one;
        }
    }
    let before = lines[last - 1];
    for (lane, &one) in lines[last].iter_mut().zip(&before) {
        *lane = (POLE * one + *lane) * (POLE / (POLE * POLE - 1.0));
    }
    for k in (0..last).rev() {
        let after = lines[k + 1];
        for (lane, &one) in lines[k].iter_mut().zip(&after) {
            *lane = POLE * (one - *lane);
        }
    }
}

/// First value of the forward filter of mirrored lines.
#[inline(always)]
fn start(lines: &[[f64; LANES]]) -> [f64; LANES] {
    let last = lines.len() - 1;
    let mut sum = lines[0];
    let mut power = 1.0;
    // A mirrored line repeats after twice its length. Later terms are below the rounding.
    for k in 1..=TERMS {
        power *= POLE;
        let at = k % (2 * last);
        let line = lines[at.min(2 * last - at)];
        for (lane, one) in sum.iter_mut().zip(line) {
            *lane += power * one;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values that no polynomial has, the same in every run.
    fn rough(count: usize) -> Vec<f32> {
        let mut state = 1u32;
        (0..count)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 16) as f32 / 65_536.0
            })
            .collect()
    }

    #[test]
    fn splines_go_through_the_values() {
        for (height, width) in [(1, 1), (1, 2), (2, 3), (3, 40), (37, 19), (64, 33)] {
            let values = rough(height * width);
            let map = Image::new(&values, height, width).unwrap();
            let coefficients = coefficients(map);
            let source = Source {
                coefficients: &coefficients,
                values: &values,
                finite: true,
                height,
                width,
            };
            for y in 0..height {
                for x in 0..width {
                    let found = source.at(y as f64, x as f64);
                    assert!(
                        (found - values[y * width + x]).abs() < 1e-5,
                        "{height} {width}"
                    );
                }
            }
        }
    }

    #[test]
    fn what_is_not_finite_reaches_its_neighbours_only() {
        let mut values = rough(200);
        values[105] = f32::NAN;
        let map = Image::new(&values, 10, 20).unwrap();
        let flow: Vec<f32> = [0.5, 0.0].repeat(200);
        let found = warp_by_flow(map, &flow, 1.0).unwrap();
        let unknown: Vec<usize> = (0..200).filter(|&k| found[k].is_nan()).collect();
        let edge = (0..10).map(|y| 20 * y + 19);
        let mut wanted: Vec<usize> = edge.chain([104, 105]).collect();
        wanted.sort_unstable();
        assert_eq!(unknown, wanted);
        assert!(warp_by_flow(map, &flow[1..], 1.0).is_err());
    }
}
