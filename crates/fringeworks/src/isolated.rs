//! Pixels whose decoded coordinate no neighbour shares.
//!
//! A camera pixel on the edge of a body sees two depths. Its fringes are a sum of two fringes with
//! different phases, so its coordinate belongs to neither depth, and its standard deviation does not
//! show it. With several sets of fringes the coordinate can be anywhere, because the fringe order is
//! derived from wrong phases. Such pixels form at most a line, the edge. A surface extends in two
//! directions.

use crate::{Error, Image, ImageMut, Reason, check_shape};
use rayon::prelude::*;
use std::ops::Range;

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
const NEAR_SUPPORT: u32 = 3;

/// Neighbours among the next 24 that a line through the pixel cannot have: it has four.
const WIDE_SUPPORT: u32 = 5;

/// Measured pixels among the next eight below which the next 24 are compared.
///
/// With fewer than half of the neighbours measured, three that agree are rare in noise. An empirical
/// choice: on dim surfaces where most pixels fail, it halves the number of good pixels that are lost.
const MIN_NEAR: u32 = 4;

/// Rows that one task examines: short enough to balance the load.
const BAND_ROWS: usize = 16;

/// Pixels of a row that are tested together, as one block for the vector unit.
const BLOCK: usize = 32;

/// Pixels around a block that its test reads.
pub(crate) const REACH: usize = 2;

/// The eight neighbours, as steps down and to the right.
const NEAR: [(isize, isize); 8] = [
    (0, 1),
    (0, -1),
    (1, 0),
    (-1, 0),
    (1, 1),
    (-1, -1),
    (-1, 1),
    (1, -1),
];

/// The 16 pixels around the eight neighbours.
const WIDE: [(isize, isize); 16] = [
    (-2, -2),
    (-2, -1),
    (-2, 0),
    (-2, 1),
    (-2, 2),
    (-1, -2),
    (-1, 2),
    (0, -2),
    (0, 2),
    (1, -2),
    (1, 2),
    (2, -2),
    (2, -1),
    (2, 0),
    (2, 1),
    (2, 2),
];

/// Coordinates of some rows with their standard deviations, and what differences are judged by.
struct Map<'a> {
    coordinate: &'a [f32],
    sigma: &'a [f32],
    width: usize,
    height: usize,
    limits: Smooth,
}

/// A block of pixels with its surroundings; NaN outside the frame.
struct Window {
    coordinate: [[f32; BLOCK + 2 * REACH]; 2 * REACH + 1],
    sigma: [[f32; BLOCK + 2 * REACH]; 2 * REACH + 1],
}

impl Smooth {
    /// Indices of the isolated pixels of some of the rows. The rows around them have to be given, too:
    /// two on each side, or fewer at the edge of the frame.
    pub(crate) fn isolated(
        &self,
        coordinate: &[f32],
        sigma: &[f32],
        width: usize,
        rows: Range<usize>,
    ) -> Vec<usize> {
        let map = Map {
            height: coordinate.len() / width,
            limits: *self,
            coordinate,
            sigma,
            width,
        };
        map.isolated_of(rows)
    }
}

/// Mark measured pixels that fewer neighbours share than a surface has, and return their number.
///
/// A neighbour shares the pixel's surface if their coordinates differ by no more than the larger of
/// two typical differences of neighbours and three times the neighbour's own difference to the pixel
/// beyond it, on the same line and in the same direction, plus five standard deviations. A pixel needs
/// three of its eight neighbours; where fewer than four of these are measured, five of the next 24. A
/// line of pixels, such as an edge, has two and four.
///
/// Frames of fewer than three rows or columns are left as they are, because they are lines.
///
/// ```
/// use fringeworks::isolated::{Smooth, mark_isolated};
/// use fringeworks::{ImageMut, Reason};
///
/// let mut coordinate: Vec<f32> = (0..400).map(|i| 1.5 * (i % 20) as f32).collect();
/// coordinate[210] = 300.0;
/// let (mut sigma, mut reason) = (vec![0.01; 400], vec![0; 400]);
/// let count = mark_isolated(
///     ImageMut::new(&mut coordinate, 20, 20)?,
///     ImageMut::new(&mut sigma, 20, 20)?,
///     ImageMut::new(&mut reason, 20, 20)?,
///     &Smooth::new(1.5, f32::INFINITY),
/// )?;
/// assert_eq!(count, 1);
/// assert!(coordinate[210].is_nan());
/// assert_eq!(Reason::try_from(reason[210]), Ok(Reason::Isolated));
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn mark_isolated(
    mut coordinate: ImageMut<f32>,
    mut sigma: ImageMut<f32>,
    mut reason: ImageMut<u8>,
    smooth: &Smooth,
) -> Result<usize, Error> {
    check_shape("sigma", sigma.shape(), coordinate.shape())?;
    check_shape("reason", reason.shape(), coordinate.shape())?;
    let (height, width) = coordinate.shape();
    if width < 3 || height < 3 {
        return Ok(0);
    }
    let isolated: Vec<Vec<usize>> = (0..height.div_ceil(BAND_ROWS))
        .into_par_iter()
        .map(|band| {
            let rows = band * BAND_ROWS..height.min((band + 1) * BAND_ROWS);
            smooth.isolated(&coordinate, &sigma, width, rows)
        })
        .collect();
    for &i in isolated.iter().flatten() {
        coordinate[i] = f32::NAN;
        sigma[i] = f32::NAN;
        reason[i] = Reason::Isolated.into();
    }
    Ok(isolated.iter().map(Vec::len).sum())
}

impl Map<'_> {
    /// Indices of the isolated pixels of some rows.
    fn isolated_of(&self, rows: Range<usize>) -> Vec<usize> {
        let nothing = vec![f32::NAN; self.width];
        let mut open = vec![0u32; self.width];
        let mut isolated = Vec::new();
        let row = |y: usize| &self.coordinate[y * self.width..][..self.width];
        for y in rows {
            let above = if y > 0 { row(y - 1) } else { &nothing };
            let below = if y + 1 < self.height {
                row(y + 1)
            } else {
                &nothing
            };
            let sigma = &self.sigma[y * self.width..][..self.width];
            clear_smooth([above, row(y), below], sigma, self.limits.smooth, &mut open);
            for (block, flags) in open.chunks_mut(BLOCK).enumerate() {
                // No short circuit, so that the compiler vectorises the loop.
                if flags.iter().fold(0, |all, flag| all | flag) > 0 {
                    let x = block * BLOCK;
                    keep_isolated(&self.window(x, y), self.limits, flags);
                    let found = (0..flags.len()).filter(|i| flags[*i] > 0);
                    isolated.extend(found.map(|i| y * self.width + x + i));
                }
            }
        }
        isolated
    }

    /// The block that starts at a pixel, with its surroundings.
    fn window(&self, x: usize, y: usize) -> Window {
        let mut window = Window {
            coordinate: [[f32::NAN; BLOCK + 2 * REACH]; 2 * REACH + 1],
            sigma: [[f32::NAN; BLOCK + 2 * REACH]; 2 * REACH + 1],
        };
        let (left, right) = (x.saturating_sub(REACH), (x + BLOCK + REACH).min(self.width));
        let start = left + REACH - x;
        for k in 0..2 * REACH + 1 {
            if y + k >= REACH && y + k < self.height + REACH {
                let from = (y + k - REACH) * self.width + left;
                let n = right - left;
                window.coordinate[k][start..start + n]
                    .copy_from_slice(&self.coordinate[from..from + n]);
                window.sigma[k][start..start + n].copy_from_slice(&self.sigma[from..from + n]);
            }
        }
        window
    }
}

/// Clear the flags of the pixels of a block that have as many neighbours as a surface.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn keep_isolated(window: &Window, limits: Smooth, flags: &mut [u32]) {
    let (mut measured, mut sharing) = ([0u32; BLOCK], [0u32; BLOCK]);
    for (down, right) in NEAR {
        let steps = next_steps(window, limits.circle, (down, right));
        let there = &sharers(window, limits, (down, right), &steps);
        for i in 0..BLOCK {
            sharing[i] += there[i] & 1;
            measured[i] += there[i] >> 1;
        }
    }
    let mut sparse = 0;
    for i in 0..flags.len() {
        flags[i] &= (sharing[i] < NEAR_SUPPORT) as u32;
        sparse |= flags[i] & (measured[i] < MIN_NEAR) as u32;
    }
    if sparse == 0 {
        return;
    }
    let wide = Smooth {
        smooth: REACH as f32 * limits.smooth,
        ..limits
    };
    for step in WIDE {
        let there = sharers(window, wide, step, &[0.0; BLOCK]);
        for i in 0..BLOCK {
            sharing[i] += there[i] & 1;
        }
    }
    for i in 0..flags.len() {
        flags[i] &= (measured[i] >= MIN_NEAR || sharing[i] < WIDE_SUPPORT) as u32;
    }
}

/// Differences from the neighbours of a block to the pixels beyond them, px.
#[inline(always)]
fn next_steps(window: &Window, circle: Circle, (down, right): (isize, isize)) -> [f32; BLOCK] {
    let (near, near_start) = at(&window.coordinate, down, right);
    let (far, far_start) = at(&window.coordinate, 2 * down, 2 * right);
    let (near, far) = (&near[near_start..][..BLOCK], &far[far_start..][..BLOCK]);
    let mut steps = [0.0; BLOCK];
    for i in 0..BLOCK {
        steps[i] = circle.difference(near[i], far[i]);
    }
    steps
}

/// For each pixel of a block: bit 0, whether the pixel some steps away lies on its surface; bit 1, whether
/// that pixel is measured.
#[inline(always)]
fn sharers(
    window: &Window,
    limits: Smooth,
    (down, right): (isize, isize),
    steps: &[f32; BLOCK],
) -> [u32; BLOCK] {
    let (row, start) = at(&window.coordinate, down, right);
    let there = &row[start..][..BLOCK];
    let sigma_there = &at(&window.sigma, down, right).0[start..][..BLOCK];
    let here = &window.coordinate[REACH][REACH..][..BLOCK];
    let sigma = &window.sigma[REACH][REACH..][..BLOCK];
    let mut found = [0; BLOCK];
    for i in 0..BLOCK {
        let step = limits.circle.difference(here[i], there[i]);
        // The comparison is false for NaN, where the pixel beyond is not measured.
        let onward = if step * steps[i] > 0.0 {
            steps[i].abs()
        } else {
            0.0
        };
        let surplus = (step.abs() - limits.smooth.max(MAX_STEEPENING * onward)).max(0.0);
        let variance = sigma[i] * sigma[i] + sigma_there[i] * sigma_there[i];
        // Squares instead of a root, which would take half of the time. False where σ is NaN.
        let shares = surplus * surplus <= CONFIDENCE * CONFIDENCE * variance;
        found[i] = shares as u32 | (!there[i].is_nan() as u32) << 1;
    }
    found
}

/// The row of a window some steps down, and the position in it of the block moved to the right.
#[inline(always)]
fn at(
    rows: &[[f32; BLOCK + 2 * REACH]; 2 * REACH + 1],
    down: isize,
    right: isize,
) -> (&[f32; BLOCK + 2 * REACH], usize) {
    (
        &rows[REACH.wrapping_add_signed(down)],
        REACH.wrapping_add_signed(right),
    )
}

/// Flag the measured pixels of a row that do not agree with three of the four next pixels.
///
/// The quick part of the test, which nearly all pixels pass. What passes here passes the whole test:
/// the tolerance is a lower bound of the one there.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
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

/// Difference that a smooth surface allows, in typical differences of neighbours.
///
/// Half of all neighbours differ by less than one. A factor of two allows for surfaces that are twice
/// as steep as the usual one; steeper ones are judged by [`MAX_STEEPENING`]. Factors of 1.5 to 3 give
/// the same results within 1 % of the removed pixels on ten simulated scenes.
const TYPICAL_STEPS: f32 = 2.0;

/// Differences of neighbours from which the typical one is taken. Their median is known to some 4 %.
const SAMPLE: usize = 2048;

/// Least number of differences for a median; with fewer in the sample, all pixels are used.
const MIN_SAMPLE: usize = 100;

/// What differences are judged by.
#[derive(Clone, Copy)]
pub struct Smooth {
    circle: Circle,
    /// Difference that a smooth surface allows between neighbours, px.
    smooth: f32,
}

impl Smooth {
    /// From the typical difference of neighbours, px, and the distance after which coordinates repeat,
    /// px or infinity; see [`typical_step`].
    ///
    /// ```
    /// use fringeworks::isolated::Smooth;
    ///
    /// // Absolute coordinates, of which neighbours usually differ by 0.8 px.
    /// let smooth = Smooth::new(0.8, f32::INFINITY);
    /// # let _ = smooth;
    /// ```
    pub fn new(typical: f32, repeats: f32) -> Self {
        Self {
            circle: Circle::new(repeats),
            smooth: TYPICAL_STEPS * typical,
        }
    }
}

/// Differences of coordinates that repeat.
#[derive(Clone, Copy)]
pub(crate) struct Circle {
    /// Distance after which coordinates repeat, px; 0 for absolute ones.
    length: f32,
    /// Inverse of the length, 1/px; 0 for absolute ones.
    inverse: f32,
}

impl Circle {
    pub(crate) fn new(repeats: f32) -> Self {
        let finite = repeats.is_finite();
        Self {
            length: if finite { repeats } else { 0.0 },
            inverse: if finite { 1.0 / repeats } else { 0.0 },
        }
    }

    /// Difference of two coordinates; where they repeat, the smallest one.
    #[inline(always)]
    pub(crate) fn difference(&self, a: f32, b: f32) -> f32 {
        let plain = a - b;
        plain - self.length * (plain * self.inverse).round_ties_even()
    }
}

/// Typical difference of neighbours, px: the larger of the medians along rows and along columns; 0 for
/// less than a row.
///
/// `repeats` is the distance after which coordinates repeat, px, or infinity.
///
/// ```
/// use fringeworks::{Image, isolated::typical_step};
///
/// let ramp: Vec<f32> = (0..400).map(|i| 1.5 * (i % 20) as f32).collect();
/// assert_eq!(typical_step(Image::new(&ramp, 20, 20)?, f32::INFINITY), 1.5);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn typical_step(coordinate: Image<f32>, repeats: f32) -> f32 {
    let width = coordinate.width();
    if coordinate.len() <= width {
        return 0.0;
    }
    let circle = Circle::new(repeats);
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
                .map(|i| circle.difference(coordinate[i + next], coordinate[i]).abs())
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
    if b == 0 { a } else { common_divisor(b, a % b) }
}
