//! Fits of phase steps whose phase turns by known angles while the frames are taken.
//!
//! A surface that moves along the projector turns the phase of every frame by another angle. The
//! samples I_n = A + c cos(δ_n − θ_n) + s sin(δ_n − θ_n) are fitted with these angles, and are then
//! turned back to what they would be on a surface that stands still.

use crate::{Error, check_length, check_value};
use rayon::prelude::*;

/// Pixels that are fitted together: what a fit keeps of them stays in the processor's first cache.
const BLOCK: usize = 128;

/// Blocks of a task: long enough for its start to cost nothing.
const BLOCKS: usize = 32;

/// Smallest determinant of a fit over that of equal steps. Below, the motion of the fringes undoes
/// the steps, and the samples do not determine a phase.
pub const DEGENERATE: f32 = 1e-2;

/// Two over π, and π/2 in three parts whose products with small whole numbers are exact (Cody and
/// Waite, Software Manual for the Elementary Functions, 1980).
const PER_QUARTER: f32 = std::f32::consts::FRAC_2_PI;
const QUARTER: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];

/// Adding and subtracting it rounds to a whole number: there are no bits for fractions beside it.
const ROUNDER: f32 = 12_582_912.0;

/// Coefficients of the sine, of r³, r⁵ and r⁷, over −π/4 … π/4, with the least largest error.
const SINE: [f32; 3] = [-0.166_666_55, 8.332_161e-3, -1.951_53e-4];

/// Coefficients of the cosine, of r⁴, r⁶ and r⁸, likewise.
const COSINE: [f32; 3] = [4.166_665e-2, -1.388_731_6e-3, 2.443_315_7e-5];

/// Cosine and sine of angles to 2e-7 within ±1000 rad; NaN for what is not finite.
#[inline(always)]
pub(crate) fn wave(angle: f32) -> (f32, f32) {
    let quarters = (angle * PER_QUARTER + ROUNDER) - ROUNDER;
    let r = ((angle - quarters * QUARTER[0]) - quarters * QUARTER[1]) - quarters * QUARTER[2];
    let q = r * r;
    let sine = r + r * q * (SINE[0] + q * (SINE[1] + q * SINE[2]));
    let cosine = 1.0 - 0.5 * q + q * q * (COSINE[0] + q * (COSINE[1] + q * COSINE[2]));
    // Which of four quarters: halves of whole numbers tell odd ones, quarters their signs.
    let half = 0.5 * quarters;
    let odd = half != (half + ROUNDER) - ROUNDER;
    let turned = 0.25 * (quarters + if odd { 1.0 } else { 0.0 });
    let negative_cosine = turned != (turned + ROUNDER) - ROUNDER;
    let turned = 0.25 * (quarters - if odd { 1.0 } else { 0.0 });
    let negative_sine = turned != (turned + ROUNDER) - ROUNDER;
    let (c, s) = if odd { (sine, cosine) } else { (cosine, sine) };
    (
        if negative_cosine { -c } else { c },
        if negative_sine { -s } else { s },
    )
}

/// A set of steps: its frames, and by how much the phase has turned in each.
#[derive(Clone, Copy)]
pub struct Turned<'a> {
    /// Angles θ_n of every frame, pixel after pixel, in units of `per_unit`.
    pub turned: &'a [&'a [f32]],
    /// Radians of one unit of the angles.
    pub per_unit: f32,
    /// Shifts δ_n, rad.
    pub shifts: &'a [f32],
}

impl Turned<'_> {
    fn check(&self, frames: &[usize]) -> Result<(), Error> {
        check_value("frames", frames.len() >= 3, "at least 3", frames.len())?;
        check_length("shifts", self.shifts.len(), frames.len())?;
        check_length("turned", self.turned.len(), frames.len())?;
        for (&pixels, turned) in frames.iter().zip(self.turned) {
            check_length("frame", pixels, frames[0])?;
            check_length("turned", turned.len(), frames[0])?;
        }
        Ok(())
    }

    /// Cosines and sines of δ_n − θ_n of frame `n` at some pixels from `first` on.
    #[inline(always)]
    fn waves(&self, n: usize, first: usize, cosine: &mut [f32], sine: &mut [f32]) {
        let turned = &self.turned[n][first..][..cosine.len()];
        let shift = self.shifts[n];
        for ((&t, c), s) in turned.iter().zip(cosine).zip(sine) {
            (*c, *s) = wave(shift - t * self.per_unit);
        }
    }
}

/// Results of a fit, pixel after pixel, counts; NaN where the samples do not determine them.
pub struct Fitted<'a> {
    /// A.
    pub background: &'a mut [f32],
    /// c.
    pub cosine: &'a mut [f32],
    /// s.
    pub sine: &'a mut [f32],
    /// Sum of the squared residuals, counts².
    pub square: &'a mut [f32],
}

/// Fit A, c and s of I_n = A + c cos(δ_n − θ_n) + s sin(δ_n − θ_n) at every pixel.
///
/// ```
/// use fringeworks::moving::{Fitted, Turned, fit_moving};
///
/// let shifts = [0.0, std::f32::consts::FRAC_PI_2, std::f32::consts::PI];
/// let still = [0.0];
/// let set = Turned { turned: &[&still, &still, &still], per_unit: 1.0, shifts: &shifts };
/// let (mut a, mut c, mut s, mut square) = ([0.0], [0.0], [0.0], [0.0]);
/// let out = Fitted { background: &mut a, cosine: &mut c, sine: &mut s, square: &mut square };
/// fit_moving(&[&[5.0], &[3.0], &[1.0]], set, out)?;
/// assert!((a[0] - 3.0).abs() < 1e-6 && (c[0] - 2.0).abs() < 1e-6 && s[0].abs() < 1e-6);
/// # Ok::<(), fringeworks::Error>(())
/// ```
///
/// # Errors
///
/// For fewer than three frames, and maps of other lengths than the first frame.
pub fn fit_moving(samples: &[&[f32]], set: Turned<'_>, out: Fitted<'_>) -> Result<(), Error> {
    let lengths: Vec<usize> = samples.iter().map(|frame| frame.len()).collect();
    set.check(&lengths)?;
    for (name, map) in [
        ("background", &out.background),
        ("cosine", &out.cosine),
        ("sine", &out.sine),
        ("square", &out.square),
    ] {
        check_length(name, map.len(), lengths[0])?;
    }
    let task = BLOCK * BLOCKS;
    (out.background.par_chunks_mut(task))
        .zip(out.cosine.par_chunks_mut(task))
        .zip(out.sine.par_chunks_mut(task))
        .zip(out.square.par_chunks_mut(task))
        .enumerate()
        .for_each_init(
            || vec![0.0; 2 * BLOCK * samples.len()],
            |waves, (k, (((background, cosine), sine), square))| {
                for start in (0..background.len()).step_by(BLOCK) {
                    let part = start..(start + BLOCK).min(background.len());
                    let out = Fitted {
                        background: &mut background[part.clone()],
                        cosine: &mut cosine[part.clone()],
                        sine: &mut sine[part.clone()],
                        square: &mut square[part],
                    };
                    fit_block(samples, set, k * task + start, waves, out);
                }
            },
        );
    Ok(())
}

/// Pixels of a block, one value each.
type Line = [f32; BLOCK];

/// Means over the frames at the pixels of a block: of the samples, cosines and sines.
struct Means {
    sample: Line,
    cosine: Line,
    sine: Line,
}

/// Sums of the normal equations, and of the squared samples about their mean.
struct Normal {
    cc: Line,
    cs: Line,
    ss: Line,
    p: Line,
    q: Line,
    square: Line,
}

/// As [`fit_moving`], of the pixels of a block from `first` on.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn fit_block(
    samples: &[&[f32]],
    set: Turned<'_>,
    first: usize,
    waves: &mut [f32],
    out: Fitted<'_>,
) {
    let pixels = out.background.len();
    let mean = means(samples, set, (first, pixels), waves);
    let sums = normal(samples, (first, pixels), waves, &mean);
    let least = DEGENERATE * (0.5 * samples.len() as f32).powi(2);
    for i in 0..pixels {
        let (cc, cs, ss) = (sums.cc[i], sums.cs[i], sums.ss[i]);
        let determinant = cc * ss - cs * cs;
        let inverse = 1.0
            / if determinant < least {
                f32::NAN
            } else {
                determinant
            };
        let c = (sums.p[i] * ss - sums.q[i] * cs) * inverse;
        let s = (sums.q[i] * cc - sums.p[i] * cs) * inverse;
        out.background[i] = mean.sample[i] - mean.cosine[i] * c - mean.sine[i] * s;
        out.cosine[i] = c;
        out.sine[i] = s;
        out.square[i] = sums.square[i] - c * sums.p[i] - s * sums.q[i];
    }
}

/// Fill in the waves of every frame, and average.
#[inline(always)]
fn means(
    samples: &[&[f32]],
    set: Turned<'_>,
    (first, pixels): (usize, usize),
    waves: &mut [f32],
) -> Means {
    let share = 1.0 / samples.len() as f32;
    let (mut sample, mut c1, mut s1) = ([0.0; BLOCK], [0.0; BLOCK], [0.0; BLOCK]);
    for (k, pair) in waves.chunks_exact_mut(2 * BLOCK).enumerate() {
        let (cosine, sine) = pair.split_at_mut(BLOCK);
        set.waves(k, first, &mut cosine[..pixels], &mut sine[..pixels]);
        let frame = &samples[k][first..][..pixels];
        for i in 0..pixels {
            sample[i] += frame[i] * share;
            c1[i] += cosine[i] * share;
            s1[i] += sine[i] * share;
        }
    }
    Means {
        sample,
        cosine: c1,
        sine: s1,
    }
}

/// The sums about the means.
#[inline(always)]
fn normal(
    samples: &[&[f32]],
    (first, pixels): (usize, usize),
    waves: &[f32],
    mean: &Means,
) -> Normal {
    let zero = [0.0; BLOCK];
    let mut sums = Normal {
        cc: zero,
        cs: zero,
        ss: zero,
        p: zero,
        q: zero,
        square: zero,
    };
    for (pair, frame) in waves.chunks_exact(2 * BLOCK).zip(samples) {
        let (cosine, sine) = pair.split_at(BLOCK);
        let frame = &frame[first..][..pixels];
        for i in 0..pixels {
            let (c, s) = (cosine[i] - mean.cosine[i], sine[i] - mean.sine[i]);
            let rest = frame[i] - mean.sample[i];
            sums.cc[i] += c * c;
            sums.cs[i] += c * s;
            sums.ss[i] += s * s;
            sums.p[i] += c * rest;
            sums.q[i] += s * rest;
            sums.square[i] += rest * rest;
        }
    }
    sums
}

/// Turn the samples of a set back: add c (cos δ_n − cos(δ_n − θ_n)) + s (sin δ_n − sin(δ_n − θ_n)).
///
/// ```
/// use fringeworks::moving::{Turned, turn_back};
///
/// let shifts = [0.0, 2.0, 4.0];
/// let angle = [0.5f32];
/// let set = Turned { turned: &[&angle, &angle, &angle], per_unit: 1.0, shifts: &shifts };
/// let mut frames = shifts.map(|shift: f32| [1.0 + (shift - 0.5).cos()]);
/// let [one, two, three] = &mut frames;
/// turn_back(&mut [one, two, three], set, &[1.0], &[0.0], &[false])?;
/// assert!((frames[1][0] - 1.0 - 2.0f32.cos()).abs() < 1e-6);
/// # Ok::<(), fringeworks::Error>(())
/// ```
///
/// # Errors
///
/// For fewer than three frames, and maps of other lengths than the first frame.
pub fn turn_back(
    samples: &mut [&mut [f32]],
    set: Turned<'_>,
    cosine: &[f32],
    sine: &[f32],
    kept: &[bool],
) -> Result<(), Error> {
    let lengths: Vec<usize> = samples.iter().map(|frame| frame.len()).collect();
    set.check(&lengths)?;
    check_length("cosine", cosine.len(), lengths[0])?;
    check_length("sine", sine.len(), lengths[0])?;
    check_length("kept", kept.len(), lengths[0])?;
    let task = BLOCK * BLOCKS;
    for (n, frame) in samples.iter_mut().enumerate() {
        frame
            .par_chunks_mut(task)
            .enumerate()
            .for_each(|(k, part)| {
                for (block, samples) in part.chunks_mut(BLOCK).enumerate() {
                    let first = k * task + block * BLOCK;
                    let pixels = first..first + samples.len();
                    let fitted = (
                        &cosine[pixels.clone()],
                        &sine[pixels.clone()],
                        &kept[pixels],
                    );
                    turn_block(samples, set, (n, first), fitted);
                }
            });
    }
    Ok(())
}

/// As [`turn_back`], of the pixels of a block of frame `n` from `first` on.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn turn_block(
    samples: &mut [f32],
    set: Turned<'_>,
    (n, first): (usize, usize),
    (c, s, kept): (&[f32], &[f32], &[bool]),
) {
    let (mut cosine, mut sine) = ([0.0f32; BLOCK], [0.0f32; BLOCK]);
    let pixels = samples.len();
    set.waves(n, first, &mut cosine[..pixels], &mut sine[..pixels]);
    let (there, across) = wave(set.shifts[n]);
    for i in 0..pixels {
        let moved = c[i] * (there - cosine[i]) + s[i] * (across - sine[i]);
        samples[i] += if kept[i] { 0.0 } else { moved };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_are_those_of_the_library() {
        let mut worst = 0.0f64;
        for k in -400_000..=400_000 {
            let angle = k as f32 * 2.5e-3;
            let (c, s) = wave(angle);
            let exact = f64::from(angle);
            worst = worst.max((f64::from(c) - exact.cos()).abs());
            worst = worst.max((f64::from(s) - exact.sin()).abs());
        }
        assert!(worst < 3e-7, "{worst}");
        assert!(wave(f32::NAN).0.is_nan() && wave(f32::INFINITY).1.is_nan());
    }

    #[test]
    fn motion_that_undoes_the_steps_is_unknown() {
        let shifts = [0.0, 1.0, 2.0, 3.0];
        let turned: Vec<Vec<f32>> = shifts.iter().map(|&shift| vec![shift; 5]).collect();
        let turned: Vec<&[f32]> = turned.iter().map(Vec::as_slice).collect();
        let set = Turned {
            turned: &turned,
            per_unit: 1.0,
            shifts: &shifts,
        };
        let frame: &[f32] = &[1.0, 2.0, 3.0, 4.0, 5.0];
        let mut maps = [[0.0f32; 5]; 4];
        let [background, cosine, sine, square] = &mut maps;
        let out = Fitted {
            background,
            cosine,
            sine,
            square,
        };
        fit_moving(&[frame; 4], set, out).unwrap();
        assert!(maps.iter().flatten().all(|value| value.is_nan()));
    }
}
