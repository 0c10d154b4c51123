//! The phasor averaged locally along the local frequency, which guides unwrapping through noise.

use crate::{Error, Image, check_shape, check_value};
use rayon::prelude::*;

/// A complex number: real and imaginary part.
type Phasor = [f32; 2];

/// Half-width of the Gaussian window, in its σ: the weight is 0.04 there.
const WINDOW_SIGMAS: f32 = 2.5;

/// Largest σ of the window, px: beyond, the window exceeds any frame.
const MAX_SIGMA: f32 = 1e3;

/// Side of the blocks that a transposition copies, px: a block of phasors fits the first cache.
const TRANSPOSED_PIXELS: usize = 32;

#[inline(always)]
fn times([a, b]: Phasor, [c, d]: Phasor) -> Phasor {
    [a * c - b * d, a * d + b * c]
}

#[inline(always)]
fn conjugate([a, b]: Phasor) -> Phasor {
    [a, -b]
}

/// Average of `exp(iφ)` over a Gaussian window of `sigma` px, with a non-negative weight per pixel.
///
/// Every sample is first turned back by the local frequency times its distance, so that fringes of a
/// few pixels do not average out. The frequency is the mean step of the phasor over a box of
/// `2 reach + 1` px. Windows end at pixels of weight 0: no sample beyond such a pixel counts. Returns
/// a phasor per pixel, whose modulus of 0 … 1 measures how well the samples agree.
///
/// ```
/// use fringeworks::{Image, unwrap::average_phasor};
///
/// let phase: Vec<f32> = (0..900).map(|i| 0.8 * (i % 30) as f32).collect();
/// let mean = average_phasor(Image::new(&phase, 30, 30)?, Image::new(&[1.0; 900], 30, 30)?, 2.0, 5)?;
/// let [c, s] = mean[455];
/// assert!((c - phase[455].cos()).abs() < 0.01 && (s - phase[455].sin()).abs() < 0.01);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn average_phasor(
    phase: Image<f32>,
    weight: Image<f32>,
    sigma: f32,
    reach: usize,
) -> Result<Vec<Phasor>, Error> {
    check_shape("weight", weight.shape(), phase.shape())?;
    let (height, width) = phase.shape();
    check_value(
        "sigma",
        sigma > 0.0 && sigma < MAX_SIGMA,
        "0 to 1000 px",
        sigma,
    )?;
    let phasors: Vec<Phasor> = phase
        .par_iter()
        .zip(weight.par_iter())
        .map(|(p, w)| [w * p.cos(), w * p.sin()])
        .collect();
    let window: Vec<f32> = (0..=(WINDOW_SIGMAS * sigma).ceil() as usize)
        .map(|j| (-0.5 * (j as f32 / sigma).powi(2)).exp())
        .collect();
    let step = steps(&phasors, width, height, reach);
    let (sums, totals) = lines(&phasors, weight.values(), &step, width, &window);
    let step = steps(&transpose(&phasors, height, width), height, width, reach);
    let (sums, totals) = (
        transpose(&sums, height, width),
        transpose(&totals, height, width),
    );
    let (mut sums, totals) = lines(&sums, &totals, &step, height, &window);
    sums.par_iter_mut().zip(&totals).for_each(|(s, t)| {
        if *t > 0.0 {
            *s = [s[0] / t, s[1] / t];
        }
    });
    Ok(transpose(&sums, width, height))
}

/// Mean direction of z(x + 1) · conj(z(x)) around every pixel, as a unit phasor.
fn steps(phasors: &[Phasor], width: usize, height: usize, reach: usize) -> Vec<Phasor> {
    let mut rows = vec![[0.0; 2]; phasors.len()];
    rows.par_chunks_mut(width)
        .zip(phasors.par_chunks(width))
        .for_each(|(out, row)| {
            for x in 0..width - 1 {
                out[x] = times(row[x + 1], conjugate(row[x]));
            }
            box_sum(out, reach);
        });
    let mut columns = transpose(&rows, height, width);
    columns
        .par_chunks_mut(height)
        .for_each(|column| box_sum(column, reach));
    let mut out = transpose(&columns, width, height);
    out.par_iter_mut().for_each(|p| {
        let modulus = (p[0] * p[0] + p[1] * p[1]).sqrt();
        *p = if modulus > 0.0 {
            [p[0] / modulus, p[1] / modulus]
        } else {
            [1.0, 0.0]
        };
    });
    out
}

/// Sums over `reach` samples to either side, in place. The running sums are f64, so that rounding does
/// not accumulate.
fn box_sum(line: &mut [Phasor], reach: usize) {
    let source = line.to_vec();
    let n = source.len();
    let mut sum = [0.0f64; 2];
    for p in &source[..reach.min(n)] {
        sum = [sum[0] + p[0] as f64, sum[1] + p[1] as f64];
    }
    for x in 0..n {
        if x + reach < n {
            let p = source[x + reach];
            sum = [sum[0] + p[0] as f64, sum[1] + p[1] as f64];
        }
        if x > reach {
            let p = source[x - reach - 1];
            sum = [sum[0] - p[0] as f64, sum[1] - p[1] as f64];
        }
        line[x] = [sum[0] as f32, sum[1] as f32];
    }
}

/// Sums along lines of `width`, each sample turned back by its distance times the step, and the sums
/// of their weights. Both end at samples of weight 0.
fn lines(
    values: &[Phasor],
    weight: &[f32],
    step: &[Phasor],
    width: usize,
    window: &[f32],
) -> (Vec<Phasor>, Vec<f32>) {
    let mut sums = vec![[0.0; 2]; values.len()];
    let mut totals = vec![0.0; values.len()];
    sums.par_chunks_mut(width)
        .zip(totals.par_chunks_mut(width))
        .enumerate()
        .for_each_init(
            || Line::new(width),
            |line, (y, (sums, totals))| {
                let span = y * width..(y + 1) * width;
                let weight = &weight[span.clone()];
                line.load(&values[span.clone()], weight, &step[span]);
                for (j, w) in window
                    .iter()
                    .enumerate()
                    .skip(1)
                    .take_while(|(j, _)| *j < width)
                {
                    line.add(weight, j, *w);
                }
                for x in 0..width {
                    if weight[x] != 0.0 {
                        sums[x] = [line.sum[0][x], line.sum[1][x]];
                        totals[x] = line.total[x];
                    }
                }
            },
        );
    (sums, totals)
}

/// Values of one line, the waves that turn them, and their sums. Each has an array of its own, so that
/// the loops over pixels become vector operations.
struct Line {
    value: [Vec<f32>; 2],
    step: [Vec<f32>; 2],
    /// The step to the power of the distance; samples ahead are turned by its conjugate.
    wave: [Vec<f32>; 2],
    /// 1 while every sample on the way, ahead and behind, had a weight; else 0.
    open: [Vec<f32>; 2],
    sum: [Vec<f32>; 2],
    total: Vec<f32>,
}

impl Line {
    fn new(width: usize) -> Self {
        let pair = || [vec![0.0; width], vec![0.0; width]];
        Self {
            value: pair(),
            step: pair(),
            wave: pair(),
            open: pair(),
            sum: pair(),
            total: vec![0.0; width],
        }
    }

    /// Start the sums of a line.
    fn load(&mut self, values: &[Phasor], weight: &[f32], step: &[Phasor]) {
        for k in 0..2 {
            for (x, v) in values.iter().enumerate() {
                self.value[k][x] = v[k];
                self.sum[k][x] = v[k];
                self.step[k][x] = step[x][k];
                self.wave[k][x] = step[x][k];
            }
            self.open[k].fill(1.0);
        }
        self.total.copy_from_slice(weight);
    }

    /// Add the samples `j` px ahead and behind.
    fn add(&mut self, weight: &[f32], j: usize, w: f32) {
        let [value_re, value_im] = &self.value;
        let [wave_re, wave_im] = &mut self.wave;
        let [sum_re, sum_im] = &mut self.sum;
        let [ahead, behind] = &mut self.open;
        let n = weight.len() - j;
        gather(
            [&value_re[j..], &value_im[j..], &weight[j..]],
            [&wave_re[..n], &wave_im[..n]],
            -w,
            &mut ahead[..n],
            [&mut sum_re[..n], &mut sum_im[..n], &mut self.total[..n]],
        );
        gather(
            [&value_re[..n], &value_im[..n], &weight[..n]],
            [&wave_re[j..], &wave_im[j..]],
            w,
            &mut behind[j..],
            [&mut sum_re[j..], &mut sum_im[j..], &mut self.total[j..]],
        );
        turn(wave_re, wave_im, &self.step[0], &self.step[1]);
    }
}

/// Add `|w|` times the values, turned by the wave or, for a negative `w`, by its conjugate.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn gather(
    [re, im, weight]: [&[f32]; 3],
    [wave_re, wave_im]: [&[f32]; 2],
    w: f32,
    open: &mut [f32],
    [sum_re, sum_im, total]: [&mut [f32]; 3],
) {
    let n = open.len();
    let (re, im, weight) = (&re[..n], &im[..n], &weight[..n]);
    let (wave_re, wave_im) = (&wave_re[..n], &wave_im[..n]);
    let (sum_re, sum_im, total) = (&mut sum_re[..n], &mut sum_im[..n], &mut total[..n]);
    let (size, side) = (w.abs(), w.signum());
    for x in 0..n {
        open[x] = if weight[x] != 0.0 { open[x] } else { 0.0 };
        let g = size * open[x];
        let s = side * wave_im[x];
        sum_re[x] += g * (re[x] * wave_re[x] - im[x] * s);
        sum_im[x] += g * (im[x] * wave_re[x] + re[x] * s);
        total[x] += g * weight[x];
    }
}

/// Multiply the waves by the steps.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn turn(wave_re: &mut [f32], wave_im: &mut [f32], step_re: &[f32], step_im: &[f32]) {
    let n = wave_re.len();
    let (wave_im, step_re, step_im) = (&mut wave_im[..n], &step_re[..n], &step_im[..n]);
    for x in 0..n {
        let re = wave_re[x] * step_re[x] - wave_im[x] * step_im[x];
        wave_im[x] = wave_re[x] * step_im[x] + wave_im[x] * step_re[x];
        wave_re[x] = re;
    }
}

/// Transpose `height × width` values to `width × height`, in blocks that stay in the cache.
fn transpose<T: Copy + Default + Send + Sync>(values: &[T], height: usize, width: usize) -> Vec<T> {
    let mut out = vec![T::default(); values.len()];
    out.par_chunks_mut(TRANSPOSED_PIXELS * height)
        .enumerate()
        .for_each(|(k, lines)| {
            for y0 in (0..height).step_by(TRANSPOSED_PIXELS) {
                for (j, line) in lines.chunks_mut(height).enumerate() {
                    let x = k * TRANSPOSED_PIXELS + j;
                    for y in y0..(y0 + TRANSPOSED_PIXELS).min(height) {
                        line[y] = values[y * width + x];
                    }
                }
            }
        });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_fine_fringes_and_stops_at_masked_pixels() {
        let (h, w) = (60, 70);
        let truth = |y: usize, x: usize| {
            let side = if x > 34 { 1.7 } else { 0.0 };
            1.1 * x as f32 - 0.6 * y as f32 + side
        };
        let phase: Vec<f32> = (0..h * w).map(|i| truth(i / w, i % w)).collect();
        let weight: Vec<f32> = (0..h * w).map(|i| (i % w != 34) as u8 as f32).collect();
        let [turned, weights] = [&phase, &weight].map(|map| Image::new(map, h, w).unwrap());
        let mean = average_phasor(turned, weights, 2.0, 7).unwrap();
        for (i, p) in mean.iter().enumerate() {
            if weight[i] == 0.0 {
                assert_eq!(*p, [0.0; 2]);
                continue;
            }
            let back = times(*p, [phase[i].cos(), -phase[i].sin()]);
            assert!(back[0] > 0.9 && back[1].abs() < 0.05, "{i}: {back:?}");
        }
    }
}
