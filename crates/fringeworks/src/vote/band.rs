//! Some rows of an image, prepared for windows: what every pixel gives to the windows it lies in, and
//! the slope of the finest phase. Rows are padded with unlit pixels, so that windows need no bounds.

use super::field::Field;
use super::{MAX_RADIUS, PER_RAD2, PER_TURN, wrap};
use crate::decode::fit::angle::angle;
use crate::moving::wave;
use std::f32::consts::TAU;
use std::ops::Range;

/// Pixels that are computed together.
pub const LANES: usize = 32;

/// Unlit pixels before and after a row.
const PAD: usize = LANES;

/// Pixels from the middle of the box that the slope is averaged in to its edges.
const SLOPE_REACH: usize = 2;

const _: () = assert!(PAD >= MAX_RADIUS && PAD > SLOPE_REACH);

/// What a pixel gives to a window by one set other than the finest.
#[derive(Default)]
pub struct Given {
    /// exp(i φ) without the share that the finest phase explains, times its weight.
    pub phasor: [Vec<f32>; 2],
    /// Inverse variance, 1/rad²; 0 for a pixel that is not lit.
    pub weight: Vec<f32>,
}

/// Some rows of an image.
#[derive(Default)]
pub struct Band {
    /// Values from one row to the next.
    pub stride: usize,
    /// Number of the first stored row, from `margin` rows above the image on.
    first: usize,
    margin: usize,
    /// Wrapped finest phase, turns; NaN for a pixel that is not lit.
    pub fine: Vec<f32>,
    /// Variance of the finest phase by noise, turns².
    pub variance: Vec<f32>,
    /// Inverse variance of the finest phase, 1/rad².
    pub weight: Vec<f32>,
    /// Expected square of the phasors about their mean, times their weights, in all other sets.
    pub expected: Vec<f32>,
    /// The sets other than the finest.
    pub others: Vec<Given>,
    /// Change of the finest phase to the right and down, turns per pixel. Without the margins.
    pub slope: [Vec<f32>; 2],
    /// exp(i φ) of the finest phase; 0 for a pixel that is not lit.
    fine_phasor: [Vec<f32>; 2],
    /// Steps of that phasor to the right and down, summed along the rows.
    steps: [[Vec<f32>; 2]; 2],
    /// The steps of one row.
    step: [Vec<f32>; 2],
}

/// A vector as long as a number of values.
fn fit(values: &mut Vec<f32>, length: usize) {
    values.resize(length, 0.0);
}

impl Band {
    /// Fill with rows of an image, for windows of a radius around their pixels.
    pub fn fill(&mut self, field: &Field, rows: Range<usize>, radius: usize) {
        self.margin = radius.max(SLOPE_REACH);
        self.first = rows.start;
        self.stride = PAD + field.width().next_multiple_of(LANES) + PAD;
        let stored = rows.len() + 2 * self.margin;
        self.resize(stored * self.stride, field.others());
        for row in 0..stored {
            let inside = (row + rows.start).checked_sub(self.margin);
            match inside.filter(|&y| y < field.height()) {
                Some(y) => prepare(self, row * self.stride, field, y),
                None => self.clear(row * self.stride..(row + 1) * self.stride),
            }
            step_sums(self, row);
        }
        for row in self.margin..stored - self.margin {
            slopes(self, row);
        }
    }

    fn resize(&mut self, length: usize, others: usize) {
        self.others.resize_with(others, Given::default);
        let Self {
            fine,
            variance,
            weight,
            expected,
            slope: [across, along],
            fine_phasor: [cosine, sine],
            ..
        } = self;
        for values in [
            fine, variance, weight, expected, across, along, cosine, sine,
        ] {
            fit(values, length);
        }
        for set in &mut self.others {
            fit(&mut set.phasor[0], length);
            fit(&mut set.phasor[1], length);
            fit(&mut set.weight, length);
        }
        for values in self.steps.as_flattened_mut() {
            fit(values, length);
        }
        for values in &mut self.step {
            fit(values, self.stride);
        }
    }

    /// Have no lit pixels in a range.
    fn clear(&mut self, range: Range<usize>) {
        self.fine[range.clone()].fill(f32::NAN);
        for values in [&mut self.variance, &mut self.weight, &mut self.expected]
            .into_iter()
            .chain(&mut self.fine_phasor)
        {
            values[range.clone()].fill(0.0);
        }
        for set in &mut self.others {
            for values in set.phasor.iter_mut().chain([&mut set.weight]) {
                values[range.clone()].fill(0.0);
            }
        }
    }

    /// Place of a pixel of the image.
    #[inline(always)]
    pub fn place(&self, y: usize, x: usize) -> usize {
        (y + self.margin - self.first) * self.stride + PAD + x
    }

    /// Change of the finest phase to the right and down, turns.
    #[inline(always)]
    pub fn slope_at(&self, y: usize, x: usize) -> [f32; 2] {
        let at = self.place(y, x);
        [self.slope[0][at], self.slope[1][at]]
    }
}

/// Some values from a place on.
#[inline(always)]
pub fn lanes(values: &[f32], at: usize) -> &[f32; LANES] {
    values[at..].first_chunk().expect("rows are padded")
}

/// Values of one row of the image in a map of the band.
macro_rules! row_of {
    ($values:expr, $at:expr, $width:expr) => {
        &mut $values[$at + PAD..][..$width]
    };
}

/// Prepare one row of the image.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn prepare(band: &mut Band, at: usize, field: &Field, y: usize) {
    let width = field.width();
    band.clear(at..at + PAD);
    band.clear(at + PAD + width..at + band.stride);
    let (lit, phase, noise) = field.row(field.finest, y);
    let (lit, phase, noise) = (&lit[..width], &phase[..width], &noise[..width]);
    let fine = row_of!(band.fine, at, width);
    let variance = row_of!(band.variance, at, width);
    let weight = row_of!(band.weight, at, width);
    let [cosine, sine] = &mut band.fine_phasor;
    let (cosine, sine) = (row_of!(cosine, at, width), row_of!(sine, at, width));
    for x in 0..width {
        let on = lit[x];
        let (c, s) = wave(phase[x]);
        fine[x] = if on { phase[x] * PER_TURN } else { f32::NAN };
        variance[x] = if on { noise[x] * PER_RAD2 } else { 0.0 };
        weight[x] = if on { 1.0 / noise[x] } else { 0.0 };
        cosine[x] = if on { c } else { 0.0 };
        sine[x] = if on { s } else { 0.0 };
    }
    let expected = row_of!(band.expected, at, width);
    expected.fill(0.0);
    for (j, set) in band.others.iter_mut().enumerate() {
        let share = field.other_ratio[j];
        let (_, own, own_noise) = field.row(field.other_sets[j], y);
        let (own, own_noise) = (&own[..width], &own_noise[..width]);
        let [cosine, sine] = &mut set.phasor;
        let (cosine, sine) = (row_of!(cosine, at, width), row_of!(sine, at, width));
        let weight = row_of!(set.weight, at, width);
        for x in 0..width {
            let on = lit[x];
            let (c, s) = wave(TAU * wrap((own[x] - share * phase[x]) * PER_TURN));
            let w = 1.0 / own_noise[x];
            let square = expected_square(own_noise[x] + share * share * noise[x]);
            weight[x] = if on { w } else { 0.0 };
            cosine[x] = if on { w * c } else { 0.0 };
            sine[x] = if on { w * s } else { 0.0 };
            expected[x] += if on { w * square } else { 0.0 };
        }
    }
}

/// Expected |z − 1|² of a phasor of some phase variance, rad².
#[inline(always)]
fn expected_square(variance: f32) -> f32 {
    // 2 (1 − exp(−v/2)) within 2 % up to v = 1.
    variance * (1.0 - variance * (0.25 - variance / 28.0))
}

/// Steps of the finest phasor to the right in a row, and into it from the row above, summed along the
/// row over a box.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn step_sums(band: &mut Band, row: usize) {
    let stride = band.stride;
    let here = row * stride;
    let above = here.saturating_sub(stride);
    let [cosine, sine] = &band.fine_phasor;
    let from = |at: usize, n: usize| [&cosine[at..at + n], &sine[at..at + n]];
    let [right, down] = &mut band.steps;
    let [right, down] = [right, down].map(|sums| sums.each_mut().map(|v| &mut v[here..][..stride]));
    let n = stride - 1;
    differences(from(here, n), from(here + 1, n), &mut band.step);
    add_along::<{ 2 * SLOPE_REACH }>(&band.step, right);
    differences(from(above, stride), from(here, stride), &mut band.step);
    add_along::<{ 2 * SLOPE_REACH + 1 }>(&band.step, down);
}

/// Products of phasors with the conjugates of those they are reached from.
#[inline(always)]
fn differences(from: [&[f32]; 2], to: [&[f32]; 2], out: &mut [Vec<f32>; 2]) {
    let n = from[0].len();
    let ([a, b], [c, d]) = (from.map(|v| &v[..n]), to.map(|v| &v[..n]));
    let [real, imaginary] = out;
    let (real, imaginary) = (&mut real[..n], &mut imaginary[..n]);
    for x in 0..n {
        real[x] = a[x] * c[x] + b[x] * d[x];
        imaginary[x] = a[x] * d[x] - b[x] * c[x];
    }
}

/// Sums of `N` values along a row, of which [`SLOPE_REACH`] lie before the place of the sum.
#[inline(always)]
fn add_along<const N: usize>(values: &[Vec<f32>; 2], sums: [&mut [f32]; 2]) {
    for (values, sums) in values.iter().zip(sums) {
        let sums = &mut sums[SLOPE_REACH..];
        let n = sums.len() - N;
        let taps: [&[f32]; N] = std::array::from_fn(|k| &values[k..k + n]);
        let sums = &mut sums[..n];
        for x in 0..n {
            sums[x] = taps.iter().fold(0.0, |sum, tap| sum + tap[x]);
        }
    }
}

/// Mean direction of the steps in a box around each pixel of a row.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn slopes(band: &mut Band, row: usize) {
    let (stride, [across, along], [right, down]) = (band.stride, &mut band.slope, &band.steps);
    let at = row * stride;
    direction::<{ 2 * SLOPE_REACH + 1 }>(
        right,
        at - SLOPE_REACH * stride,
        &mut across[at..][..stride],
    );
    // Steps into a row lie in that row: the first one within the box is that into its second row.
    direction::<{ 2 * SLOPE_REACH }>(
        down,
        at - (SLOPE_REACH - 1) * stride,
        &mut along[at..][..stride],
    );
}

/// Direction of the sums of phasors over `N` rows from a place on, turns.
#[inline(always)]
fn direction<const N: usize>(phasor: &[Vec<f32>; 2], first: usize, out: &mut [f32]) {
    let n = out.len();
    let rows =
        |k: usize| -> [&[f32]; N] { std::array::from_fn(|r| &phasor[k][first + r * n..][..n]) };
    let (real, imaginary) = (rows(0), rows(1));
    for x in 0..n {
        let c = real.iter().fold(0.0, |sum, row| sum + row[x]);
        let s = imaginary.iter().fold(0.0, |sum, row| sum + row[x]);
        out[x] = angle(s, c);
    }
}
