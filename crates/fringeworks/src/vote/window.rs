//! Means of the windows around pixels that lie beside each other in a row.

use super::band::{Band, LANES, lanes};
use super::field::{Field, MAX_OTHERS, bend, continues};
use super::wrap;
use crate::decode::fit::angle::angle;
use crate::moving::wave;
use std::f32::consts::TAU;

/// Standard deviations by which the squared scatter in a window may exceed that of noise. Two surfaces in
/// it scatter more, even where their mean is the phase of an order between them.
const SCATTER_SIGMAS: f32 = 4.0;

/// Least pixels of a window that can vote: those of the smallest window in a right-angled corner.
const LEAST_PIXELS: f32 = 4.0;

/// A value of every pixel that is computed together with others.
pub type Lane = [f32; LANES];

/// Phases of the sets but the finest, less the share that the finest one explains, averaged over windows.
pub struct Means {
    /// Turns.
    pub turns: [Lane; MAX_OTHERS],
    /// By noise, rad².
    pub variance: [Lane; MAX_OTHERS],
    pub finest_variance: Lane,
    /// Number of pixels.
    pub pixels: Lane,
    /// Squared scatter of their phases over that of noise.
    pub scatter: Lane,
}

impl Default for Means {
    fn default() -> Self {
        Self {
            turns: [[0.0; LANES]; MAX_OTHERS],
            variance: [[1.0; LANES]; MAX_OTHERS],
            finest_variance: [1.0; LANES],
            pixels: [0.0; LANES],
            scatter: [0.0; LANES],
        }
    }
}

impl Means {
    /// Copy those of one pixel, of some sets beside the finest.
    pub fn copy(&mut self, to: usize, from: &Self, lane: usize, others: usize) {
        for j in 0..others {
            self.turns[j][to] = from.turns[j][lane];
            self.variance[j][to] = from.variance[j][lane];
        }
        self.finest_variance[to] = from.finest_variance[lane];
        self.pixels[to] = from.pixels[lane];
        self.scatter[to] = from.scatter[lane];
    }

    /// Mean variance of the sets but the finest, rad².
    pub fn coarse_variance(&self, others: usize, lane: usize) -> f32 {
        let sum: f32 = self.variance[..others].iter().map(|v| v[lane]).sum();
        sum / others as f32
    }

    /// Whether a window has pixels enough, whose phases scatter as those of one surface.
    pub fn is_even(&self, field: &Field, lane: usize) -> bool {
        let freedom = (self.pixels[lane] - 1.0).max(1.0) * field.others() as f32;
        let most = 1.0 + SCATTER_SIGMAS * (2.0 / freedom).sqrt();
        self.pixels[lane] >= LEAST_PIXELS && self.scatter[lane] <= field.usual_scatter * most
    }

    /// Means of the windows around the pixels of a band from a place on. Those of unlit pixels are NaN.
    pub fn fill(&mut self, field: &Field, band: &Band, place: usize, radius: usize) {
        match field.others() {
            1 => means::<1>(field, band, place, radius, self),
            2 => means::<2>(field, band, place, radius, self),
            3 => means::<3>(field, band, place, radius, self),
            4..=6 => means::<6>(field, band, place, radius, self),
            _ => means::<MAX_OTHERS>(field, band, place, radius, self),
        }
    }
}

/// Sums over windows.
struct Sums<const M: usize> {
    phasor: [[Lane; 2]; M],
    weight: [Lane; M],
    finest_weight: Lane,
    expected: Lane,
    pixels: Lane,
}

/// For `M` or fewer sets beside the finest.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn means<const M: usize>(field: &Field, band: &Band, place: usize, radius: usize, out: &mut Means) {
    let mut sums = Sums::<M> {
        phasor: [[[0.0; LANES]; 2]; M],
        weight: [[0.0; LANES]; M],
        finest_weight: [0.0; LANES],
        expected: [0.0; LANES],
        pixels: [0.0; LANES],
    };
    let reach = radius as isize;
    for down in -reach..=reach {
        for right in -reach..=reach {
            add::<M>(field, band, place, (down, right), &mut sums);
        }
    }
    for j in 0..M.min(field.others()) {
        let [real, imaginary] = &sums.phasor[j];
        for i in 0..LANES {
            out.turns[j][i] = angle(imaginary[i], real[i]);
            out.variance[j][i] = 1.0 / sums.weight[j][i];
        }
    }
    for i in 0..LANES {
        let mut square = 0.0;
        for j in 0..M {
            let [a, b] = [sums.phasor[j][0][i], sums.phasor[j][1][i]];
            square += 2.0 * (sums.weight[j][i] - (a * a + b * b).sqrt());
        }
        let pixels = sums.pixels[i];
        // The mean takes a degree of freedom.
        let free = sums.expected[i] * (pixels - 1.0) / pixels;
        out.scatter[i] = if pixels > 1.0 { square / free } else { 0.0 };
        out.finest_variance[i] = 1.0 / sums.finest_weight[i];
        out.pixels[i] = pixels;
    }
}

/// Add the pixels that are some rows and columns away to the sums, where they continue the finest phase.
#[inline(always)]
fn add<const M: usize>(
    field: &Field,
    band: &Band,
    place: usize,
    (down, right): (isize, isize),
    sums: &mut Sums<M>,
) {
    let there = place.wrapping_add_signed(down * band.stride as isize + right);
    let (turns, member) = members(band, place, there, (right as f32, down as f32));
    let mut most = 0;
    for turns in &turns {
        // Numbers that are not negative are in the order of their bits.
        most = turns.abs().to_bits().max(most);
    }
    let (weight, expected) = (lanes(&band.weight, there), lanes(&band.expected, there));
    for i in 0..LANES {
        let near = member[i] > 0.0;
        sums.pixels[i] += member[i];
        sums.finest_weight[i] += if near { weight[i] } else { 0.0 };
        sums.expected[i] += if near { expected[i] } else { 0.0 };
    }
    for j in 0..M.min(field.others()) {
        let given = &band.others[j];
        let (cosine, sine) = (
            lanes(&given.phasor[0], there),
            lanes(&given.phasor[1], there),
        );
        let weight = lanes(&given.weight, there);
        let turned = turn(field.other_ratio[j], &turns, f32::from_bits(most));
        let [real, imaginary] = &mut sums.phasor[j];
        for i in 0..LANES {
            let near = member[i] > 0.0;
            let (c, s) = (turned[0][i], turned[1][i]);
            real[i] += if near {
                cosine[i] * c - sine[i] * s
            } else {
                0.0
            };
            imaginary[i] += if near {
                cosine[i] * s + sine[i] * c
            } else {
                0.0
            };
            sums.weight[j][i] += if near { weight[i] } else { 0.0 };
        }
    }
}

/// Whole turns of the finest phase from the pixels at one place to those at another one, and 1 where these
/// continue it.
#[inline(always)]
fn members(band: &Band, place: usize, there: usize, (across, along): (f32, f32)) -> (Lane, Lane) {
    let [slope_across, slope_along] = [lanes(&band.slope[0], place), lanes(&band.slope[1], place)];
    let (from, to) = (lanes(&band.fine, place), lanes(&band.fine, there));
    let (noise, noise_there) = (lanes(&band.variance, place), lanes(&band.variance, there));
    let (mut turns, mut member) = ([0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        let slope = [slope_across[i], slope_along[i]];
        let off = to[i] - from[i] - (slope[0] * across + slope[1] * along);
        let (whole, near) = continues(off, noise[i] + noise_there[i], bend(slope, across, along));
        turns[i] = if near { whole } else { 0.0 };
        member[i] = if near { 1.0 } else { 0.0 };
    }
    (turns, member)
}

/// By what whole turns of the finest phase turn a set, up to `most` of them.
#[inline(always)]
fn turn(ratio: f32, turns: &Lane, most: f32) -> [Lane; 2] {
    let mut turned = [[1.0; LANES], [0.0; LANES]];
    if most > 1.0 {
        for i in 0..LANES {
            let (c, s) = wave(TAU * wrap(ratio * turns[i]));
            (turned[0][i], turned[1][i]) = (c, s);
        }
    } else if most > 0.0 {
        let (c, s) = wave(TAU * wrap(ratio));
        for i in 0..LANES {
            turned[0][i] = if turns[i] == 0.0 { 1.0 } else { c };
            turned[1][i] = turns[i] * s;
        }
    }
    turned
}
