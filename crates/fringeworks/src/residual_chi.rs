//! χ² of what the fits of phase steps leave of their samples, pixel after pixel.

use crate::decode::Sample;
use crate::{Error, check_length, check_value};
use rayon::prelude::*;

/// Pixels that are computed together, so that their samples stay in the first cache.
const BLOCK: usize = 128;

/// Blocks of a task: long enough for its start to cost nothing.
const BLOCKS: usize = 32;

/// Pixels of a block, one value each.
type Line = [f32; BLOCK];

/// What the frames of a set show, and the variances of their samples.
#[derive(Clone, Copy)]
pub struct Judged<'a> {
    /// What every frame shows of A, c and s.
    pub design: &'a [f32],
    /// Row after row, what A, c and s take from every frame.
    pub solver: &'a [f32],
    /// What every frame shows of B cos kφ and B sin kφ for each order; nothing where empty.
    pub harmonics: &'a [f32],
    /// The orders k of the harmonics, rising from 2.
    pub orders: &'a [u32],
    /// Variance of a sample at the brightness 0, counts².
    pub dark: f32,
    /// What a count of brightness adds to it, counts.
    pub gain: f32,
    /// What a squared modulation adds to it: errors of the phase that are no noise.
    pub floor: f32,
    /// Counts from which on a sample is not trusted; NaN for none.
    pub saturation: f32,
    /// Largest χ² per degree of freedom that counts.
    pub most: f32,
}

/// Sums to which a set is added, pixel after pixel.
pub struct Totals<'a> {
    /// Whether a pixel is judged.
    pub lit: &'a [bool],
    /// Sum of χ².
    pub square: &'a mut [f32],
    /// Degrees of freedom.
    pub freedom: &'a mut [f32],
}

/// Add the χ² of the residuals of a set of four steps or more, and its degrees of freedom.
///
/// Pixels that are not lit, have a sample at the saturation or one that is not finite, add nothing.
///
/// ```
/// use fringeworks::residual_chi::{Judged, Totals, add_residual_chi};
///
/// let judged = Judged {
///     design: &[1., 1., 0., 1., 0., 1., 1., -1., 0., 1., 0., -1.],
///     solver: &[0.25, 0.25, 0.25, 0.25, 0.5, 0., -0.5, 0., 0., 0.5, 0., -0.5],
///     harmonics: &[], orders: &[],
///     dark: 1.0, gain: 0.0, floor: 0.0, saturation: 255.0, most: 100.0,
/// };
/// let (mut square, mut freedom) = ([0.0], [0.0]);
/// let totals = Totals { lit: &[true], square: &mut square, freedom: &mut freedom };
/// add_residual_chi(&[&[42_u8], &[30], &[22], &[30]], judged, totals)?;
/// // Opposite frames add up to 64 and 60 counts: each sample is a count off.
/// assert_eq!((square, freedom), ([4.0], [1.0]));
/// # Ok::<(), fringeworks::Error>(())
/// ```
///
/// # Errors
///
/// For fewer than four frames, and values whose number does not fit.
pub fn add_residual_chi<T: Sample>(
    planes: &[&[T]],
    judged: Judged<'_>,
    totals: Totals<'_>,
) -> Result<(), Error> {
    check(planes, &judged, &totals)?;
    let task = BLOCK * BLOCKS;
    (totals.square.par_chunks_mut(task))
        .zip(totals.freedom.par_chunks_mut(task))
        .zip(totals.lit.par_chunks(task))
        .enumerate()
        .for_each_init(
            || vec![[0.0; BLOCK]; planes.len()],
            |values, (k, ((square, freedom), lit))| {
                for start in (0..lit.len()).step_by(BLOCK) {
                    let part = start..(start + BLOCK).min(lit.len());
                    let first = k * task + start;
                    for (line, plane) in values.iter_mut().zip(planes) {
                        for (value, sample) in line.iter_mut().zip(&plane[first..][..part.len()]) {
                            *value = sample.value();
                        }
                    }
                    let totals = Totals {
                        lit: &lit[part.clone()],
                        square: &mut square[part.clone()],
                        freedom: &mut freedom[part],
                    };
                    add_block(values, judged, totals);
                }
            },
        );
    Ok(())
}

fn check<T>(planes: &[&[T]], judged: &Judged<'_>, totals: &Totals<'_>) -> Result<(), Error> {
    let n = planes.len();
    check_value("planes", n >= 4, "at least 4", n)?;
    check_length("design", judged.design.len(), 3 * n)?;
    check_length("solver", judged.solver.len(), 3 * n)?;
    check_length(
        "harmonics",
        judged.harmonics.len(),
        2 * n * judged.orders.len(),
    )?;
    let mut before = 1;
    for &order in judged.orders {
        check_value("orders", order > before, "rising from 2", order)?;
        before = order;
    }
    for plane in planes {
        check_length("plane", plane.len(), totals.lit.len())?;
    }
    check_length("square", totals.square.len(), totals.lit.len())?;
    check_length("freedom", totals.freedom.len(), totals.lit.len())
}

/// As [`add_residual_chi`], of the pixels of a block.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn add_block(values: &[Line], judged: Judged<'_>, totals: Totals<'_>) {
    let mut fitted = [[0.0f32; BLOCK]; 3];
    for (row, line) in judged.solver.chunks_exact(values.len()).zip(&mut fitted) {
        for (&weight, samples) in row.iter().zip(values) {
            for i in 0..BLOCK {
                line[i] += weight * samples[i];
            }
        }
    }
    let chi = squares(values, &judged, &fitted);
    let [background, c, s] = &fitted;
    let freedom = (values.len() - 3) as f32;
    let most = judged.most * freedom;
    for i in 0..totals.lit.len() {
        let light = if background[i] > 0.0 {
            background[i]
        } else {
            0.0
        };
        let square = c[i] * c[i] + s[i] * s[i];
        let value = chi[i] / (judged.dark + judged.gain * light + judged.floor * square);
        let usable = totals.lit[i] && value.is_finite();
        let counted = if value < most { value } else { most };
        totals.square[i] += if usable { counted } else { 0.0 };
        totals.freedom[i] += if usable { freedom } else { 0.0 };
    }
}

/// Sums of the squared residuals; NaN for pixels with a sample at the saturation.
#[inline(always)]
fn squares(values: &[Line], judged: &Judged<'_>, [background, c, s]: &[Line; 3]) -> Line {
    let parts = harmonics(c, s, judged.orders);
    let mut chi = [0.0f32; BLOCK];
    for (k, samples) in values.iter().enumerate() {
        let shown = &judged.design[3 * k..][..3];
        let mut left = [0.0f32; BLOCK];
        for i in 0..BLOCK {
            left[i] = samples[i] - shown[0] * background[i] - shown[1] * c[i] - shown[2] * s[i];
        }
        for (part, &share) in parts.iter().zip(&judged.harmonics[k * parts.len()..]) {
            for i in 0..BLOCK {
                left[i] -= share * part[i];
            }
        }
        for i in 0..BLOCK {
            let bright = samples[i] >= judged.saturation;
            chi[i] += if bright { f32::NAN } else { left[i] * left[i] };
        }
    }
    chi
}

/// B cos kφ and B sin kφ of fringes c + i s = B e^{iφ} for each of some orders, one after another.
#[inline(always)]
fn harmonics(c: &Line, s: &Line, orders: &[u32]) -> Vec<Line> {
    let mut parts = Vec::with_capacity(2 * orders.len());
    let (mut real, mut imaginary) = (*c, *s);
    let mut order = 1;
    for &next in orders {
        while order < next {
            for i in 0..BLOCK {
                let size = (c[i] * c[i] + s[i] * s[i]).sqrt();
                let inverse = 1.0
                    / if size > f32::MIN_POSITIVE {
                        size
                    } else {
                        f32::MIN_POSITIVE
                    };
                let (x, y) = (c[i] * inverse, s[i] * inverse);
                (real[i], imaginary[i]) = (
                    real[i] * x - imaginary[i] * y,
                    real[i] * y + imaginary[i] * x,
                );
            }
            order += 1;
        }
        parts.push(real);
        parts.push(imaginary);
    }
    parts
}
