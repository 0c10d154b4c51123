//! Pixels whose decoded coordinate no neighbour shares.
//!
//! A camera pixel on the edge of a body sees two depths. Its fringes are a sum of two fringes with
//! different phases, so its coordinate belongs to neither depth, and its standard deviation does not
//! show it. With several sets of fringes the coordinate can be anywhere, because the fringe order is
//! derived from wrong phases. Such pixels form at most a line, the edge. A surface extends in two
//! directions.

use crate::{check_length, reason, Error};
use rayon::prelude::*;

/// Difference that a smooth surface allows, in typical differences of neighbours.
///
/// Half of all neighbours differ by less than one. A factor of two allows for surfaces that are twice
/// as steep as the usual one; steeper ones are judged by [`MAX_STEEPENING`]. Factors of 1.5 to 3 give
/// the same results within 1 % of the removed pixels on ten simulated scenes.
const TYPICAL_STEPS: f32 = 2.0;

/// How much steeper than the next step of the same surface a step may be.
///
/// The depth of a round body varies as √d at the distance d from its rim. Its steepest ratio is that of
/// the first step to the second one, 1/(√2 − 1) = 2.41. The rest is a margin for noise.
const MAX_STEEPENING: f32 = 3.0;

/// Standard deviations by which two measured coordinates of one surface may differ.
///
/// The confidence with which the decoder judges fringe orders, too.
const CONFIDENCE: f32 = 5.0;

/// Neighbours among the next eight that a line through the pixel cannot have: it has two.
const NEAR_SUPPORT: usize = 3;

/// Neighbours among the next 24 that a line through the pixel cannot have: it has four.
const WIDE_SUPPORT: usize = 5;

/// Measured pixels among the next eight below which the next 24 are compared.
///
/// With fewer than half of the neighbours measured, three that agree are rare in noise. An empirical
/// choice: on dim surfaces where most pixels fail, it halves the number of good pixels that are lost.
const MIN_NEAR: usize = 4;

/// Differences of neighbours from which the typical one is taken. Their median is known to 2 %.
const SAMPLE: usize = 8192;

/// Least number of differences for a median; with fewer in the sample, all pixels are used.
const MIN_SAMPLE: usize = 100;

/// Rows that one task examines: short enough to balance the load.
const BAND_ROWS: usize = 16;

/// Pixels that are looked through at once for those that the quick test did not clear.
const CHUNK: usize = 32;

/// The eight neighbours, as steps in x and y.
const NEAR: [(isize, isize); 8] = [
    (1, 0),
    (-1, 0),
    (0, 1),
    (0, -1),
    (1, 1),
    (-1, -1),
    (1, -1),
    (-1, 1),
];

/// Coordinates of one frame with their standard deviations, and what differences are judged by.
struct Map<'a> {
    coordinate: &'a [f32],
    sigma: &'a [f32],
    width: usize,
    height: usize,
    /// Distance after which coordinates repeat, px; infinite for absolute ones.
    repeats: f32,
    /// Difference that a smooth surface allows between neighbours, px.
    smooth: f32,
}

/// Mark measured pixels that fewer neighbours share than a surface has, and return their number.
///
/// A neighbour shares the pixel's surface if their coordinates differ by no more than the larger of
/// two typical differences of neighbours and three times the neighbour's own difference to the pixel
/// beyond it, on the same line and in the same direction, plus five standard deviations. A pixel needs
/// three of its eight neighbours; where fewer than four of these are measured, five of the next 24. A
/// line of pixels, such as an edge, has two and four.
///
/// `repeats` is the distance after which coordinates repeat, px, or infinity. Frames of fewer than three
/// rows or columns are left as they are, because they are lines.
pub fn mark(
    coordinate: &mut [f32],
    sigma: &mut [f32],
    reasons: &mut [u8],
    width: usize,
    repeats: f32,
) -> Result<usize, Error> {
    check_length("sigma", sigma.len(), coordinate.len())?;
    check_length("reason", reasons.len(), coordinate.len())?;
    if width < 3 || coordinate.len() < 3 * width {
        return Ok(0);
    }
    let map = Map {
        height: coordinate.len() / width,
        smooth: TYPICAL_STEPS * typical_step(coordinate, width, repeats),
        coordinate,
        sigma,
        width,
        repeats,
    };
    let bands = map.height.div_ceil(BAND_ROWS);
    let isolated: Vec<Vec<usize>> = (0..bands)
        .into_par_iter()
        .map(|band| map.isolated_of_band(band))
        .collect();
    for &i in isolated.iter().flatten() {
        coordinate[i] = f32::NAN;
        sigma[i] = f32::NAN;
        reasons[i] = reason::ISOLATED;
    }
    Ok(isolated.iter().map(Vec::len).sum())
}

/// Difference of two coordinates, where coordinates repeat: the one of the smallest size.
fn difference(a: f32, b: f32, repeats: f32) -> f32 {
    let plain = a - b;
    if plain.abs() > 0.5 * repeats {
        plain - repeats * (plain / repeats).round()
    } else {
        plain
    }
}

/// Typical difference of neighbours, px: the larger of the medians along rows and along columns.
fn typical_step(coordinate: &[f32], width: usize, repeats: f32) -> f32 {
    let median_step = |next: usize| {
        // A stride without a common divisor with the width reaches all columns.
        let mut stride = (coordinate.len() / SAMPLE).max(1);
        while stride > 1 && common_divisor(stride, width) > 1 {
            stride += 1;
        }
        let steps = |stride: usize| -> Vec<f32> {
            (0..coordinate.len() - next)
                .step_by(stride)
                .filter(|i| next > 1 || (i + 1) % width > 0)
                .map(|i| difference(coordinate[i + next], coordinate[i], repeats).abs())
                .filter(|step| step.is_finite())
                .collect()
        };
        let mut found = steps(stride);
        if found.len() < MIN_SAMPLE {
            found = steps(1);
        }
        if found.is_empty() {
            return 0.0;
        }
        let middle = found.len() / 2;
        *found.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    median_step(1).max(median_step(width))
}

fn common_divisor(a: usize, b: usize) -> usize {
    if b == 0 {
        a
    } else {
        common_divisor(b, a % b)
    }
}

impl Map<'_> {
    /// Indices of the isolated pixels of a band of rows.
    fn isolated_of_band(&self, band: usize) -> Vec<usize> {
        let nothing = vec![f32::NAN; self.width];
        let mut open = vec![0u32; self.width];
        let mut isolated = Vec::new();
        let row = |y: usize| &self.coordinate[y * self.width..][..self.width];
        for y in band * BAND_ROWS..self.height.min((band + 1) * BAND_ROWS) {
            let above = if y > 0 { row(y - 1) } else { &nothing };
            let below = if y + 1 < self.height {
                row(y + 1)
            } else {
                &nothing
            };
            let sigma = &self.sigma[y * self.width..][..self.width];
            clear_smooth([above, row(y), below], sigma, self.smooth, &mut open);
            for (chunk, flags) in open.chunks(CHUNK).enumerate() {
                if flags.iter().any(|flag| *flag > 0) {
                    for x in chunk * CHUNK..chunk * CHUNK + flags.len() {
                        if open[x] > 0 && self.is_isolated(x, y) {
                            isolated.push(y * self.width + x);
                        }
                    }
                }
            }
        }
        isolated
    }

    /// Whether a measured pixel has fewer neighbours on its surface than a surface has.
    fn is_isolated(&self, x: usize, y: usize) -> bool {
        let (mut measured, mut sharing) = (0, 0);
        for (dx, dy) in NEAR {
            if let Some(neighbour) = self.index(x, y, dx, dy) {
                let beyond = self.index(x, y, 2 * dx, 2 * dy);
                measured += self.coordinate[neighbour].is_finite() as usize;
                sharing += self.share(y * self.width + x, neighbour, beyond, 1.0) as usize;
            }
        }
        if sharing >= NEAR_SUPPORT || measured >= MIN_NEAR {
            return sharing < NEAR_SUPPORT;
        }
        for dy in -2isize..=2 {
            for dx in -2isize..=2 {
                if dx.abs().max(dy.abs()) == 2 {
                    if let Some(neighbour) = self.index(x, y, dx, dy) {
                        sharing += self.share(y * self.width + x, neighbour, None, 2.0) as usize;
                    }
                }
            }
        }
        sharing < WIDE_SUPPORT
    }

    /// Whether two pixels at a distance lie on one surface, as far as the pixel beyond tells.
    fn share(&self, at: usize, neighbour: usize, beyond: Option<usize>, distance: f32) -> bool {
        let step =
            |a: usize, b: usize| difference(self.coordinate[a], self.coordinate[b], self.repeats);
        let here = step(at, neighbour);
        let mut allowed = self.smooth * distance;
        if let Some(beyond) = beyond {
            let next = step(neighbour, beyond);
            // False for NaN, where the pixel beyond is not measured.
            if here * next > 0.0 {
                allowed = allowed.max(MAX_STEEPENING * next.abs());
            }
        }
        let variance = self.sigma[at].powi(2) + self.sigma[neighbour].powi(2);
        here.abs() <= allowed + CONFIDENCE * variance.sqrt()
    }

    /// Index of the pixel at a distance from another one, if it is in the frame.
    fn index(&self, x: usize, y: usize, dx: isize, dy: isize) -> Option<usize> {
        let column = x.checked_add_signed(dx).filter(|x| *x < self.width)?;
        let row = y.checked_add_signed(dy).filter(|y| *y < self.height)?;
        Some(row * self.width + column)
    }
}

/// Flag the measured pixels of a row that do not agree with three of the four next pixels.
///
/// The quick part of the test, which nearly all pixels pass. What passes here passes the whole test:
/// the tolerance is a lower bound of the one there.
#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx512f+avx512vl"))]
fn clear_smooth(rows: [&[f32]; 3], sigma: &[f32], smooth: f32, open: &mut [u32]) {
    let width = open.len();
    let [above, here, below] = [&rows[0][..width], &rows[1][..width], &rows[2][..width]];
    let sigma = &sigma[..width];
    // A frame's first and last column have fewer neighbours; they take the whole test.
    open[0] = here[0].is_finite() as u32;
    open[width - 1] = here[width - 1].is_finite() as u32;
    for x in 1..width - 1 {
        let allowed = smooth + CONFIDENCE * sigma[x];
        let agrees = |other: f32| ((here[x] - other).abs() <= allowed) as u32;
        let sharing =
            agrees(here[x - 1]) + agrees(here[x + 1]) + agrees(above[x]) + agrees(below[x]);
        open[x] = ((sharing < 3) & !here[x].is_nan()) as u32;
    }
}
