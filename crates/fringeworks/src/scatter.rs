//! By how much the coordinates around a pixel scatter beyond their standard deviations.
//!
//! Along a smooth surface the third difference of the coordinate is noise. Its χ² is averaged over a
//! square around every pixel.

use crate::{Error, Image, ImageMut, check_shape, check_value};
use rayon::prelude::*;

/// Rows of a task. The rows around it are computed twice: twelve at most.
const BAND_ROWS: usize = 64;

/// What differences are taken and averaged over.
#[derive(Clone, Copy)]
pub struct Scale {
    /// Distance of the pixels of a difference, px.
    pub step: usize,
    /// Side of the square, px; odd.
    pub side: usize,
}

/// When a difference counts, and when a mean does.
#[derive(Clone, Copy)]
pub struct Limits {
    /// Largest difference on one surface, px.
    pub most: f32,
    /// Excess of a mean over 1 from which on it counts, in standard deviations.
    pub excess: f32,
    /// Differences that share what one independent one says.
    pub shared: f32,
}

/// A frame whose differences are averaged.
struct Map<'a> {
    coordinate: &'a [f32],
    sigma: &'a [f32],
    width: usize,
    height: usize,
    scale: Scale,
    limits: Limits,
}

/// Sums of χ² and numbers of differences at the pixels of a row.
#[derive(Clone)]
struct Sums {
    square: Vec<f32>,
    count: Vec<f32>,
}

impl Sums {
    fn zero(width: usize) -> Self {
        Self {
            square: vec![0.0; width],
            count: vec![0.0; width],
        }
    }
}

/// Raise the factors on the variances to the mean χ² around every pixel, where that is significant.
///
/// Beyond the edges of the frame the sums are reflected.
///
/// ```
/// use fringeworks::scatter::{Limits, Scale, raise_factors};
/// use fringeworks::{Image, ImageMut};
///
/// // Neighbours scatter by 0.2 px, ten times their standard deviation.
/// let noisy: Vec<f32> = (0..900).map(|i| (i % 30) as f32 + 0.2 * (((i * 7919) % 11) as f32 - 5.0) / 3.2).collect();
/// let mut factors = vec![1.0; 900];
/// raise_factors(
///     Image::new(&noisy, 30, 30)?,
///     Image::new(&[0.02; 900], 30, 30)?,
///     Scale { step: 1, side: 9 },
///     Limits { most: 5.0, excess: 4.0, shared: 4.6 },
///     ImageMut::new(&mut factors, 30, 30)?,
/// )?;
/// assert!(factors[450] > 25.0);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn raise_factors(
    coordinate: Image<f32>,
    sigma: Image<f32>,
    scale: Scale,
    limits: Limits,
    mut factors: ImageMut<f32>,
) -> Result<(), Error> {
    check_shape("sigma", sigma.shape(), coordinate.shape())?;
    check_shape("factors", factors.shape(), coordinate.shape())?;
    let odd = scale.side % 2 == 1 && scale.step > 0;
    check_value("scale", odd, "a step and an odd side", scale.side)?;
    if coordinate.is_empty() {
        return Ok(());
    }
    let (height, width) = coordinate.shape();
    let map = Map {
        coordinate: coordinate.values(),
        sigma: sigma.values(),
        width,
        height,
        scale,
        limits,
    };
    factors
        .par_chunks_mut(BAND_ROWS * width)
        .enumerate()
        .for_each(|(band, out)| raise_band(&map, band * BAND_ROWS, out));
    Ok(())
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn raise_band(map: &Map<'_>, top: usize, out: &mut [f32]) {
    let (width, half) = (map.width, map.scale.side / 2);
    let first = top.saturating_sub(half);
    let end = (top + out.len() / width + half).min(map.height);
    let mut line = Sums::zero(width);
    let mut rows = vec![Sums::zero(width); end - first];
    for (row, sums) in (first..end).zip(&mut rows) {
        map.sum_differences(row, &mut line);
        sum_along(&line.square, half, &mut sums.square);
        sum_along(&line.count, half, &mut sums.count);
    }
    for (row, factors) in (top..).zip(out.chunks_mut(width)) {
        line.square.fill(0.0);
        line.count.fill(0.0);
        for k in 0..map.scale.side {
            let at = reflected(row as isize + k as isize - half as isize, map.height);
            add(&rows[at - first].square, &mut line.square);
            add(&rows[at - first].count, &mut line.count);
        }
        raise_row(&line, map.limits, factors);
    }
}

#[inline(always)]
fn raise_row(sums: &Sums, limits: Limits, factors: &mut [f32]) {
    let (square, count) = (&sums.square[..factors.len()], &sums.count[..factors.len()]);
    for i in 0..factors.len() {
        let mean = square[i] / count[i];
        let least = 1.0 + limits.excess * (2.0 * limits.shared / count[i]).sqrt();
        let significant = (count[i] > 0.5) & (mean > least);
        let factor = if significant { mean } else { 1.0 };
        factors[i] = factors[i].max(factor);
    }
}

impl Map<'_> {
    /// χ² of the differences of a row and of the columns through it, at their two middle pixels.
    #[inline(always)]
    fn sum_differences(&self, row: usize, sums: &mut Sums) {
        let Self { width, height, .. } = *self;
        let step = self.scale.step;
        sums.square.fill(0.0);
        sums.count.fill(0.0);
        let line = |row: usize| {
            let place = row * width..(row + 1) * width;
            (&self.coordinate[place.clone()], &self.sigma[place])
        };
        if width > 3 * step {
            let n = width - 3 * step;
            let (x, sigma) = line(row);
            let part = |k: usize| (&x[k * step..][..n], &sigma[k * step..][..n]);
            let parts = [part(0), part(1), part(2), part(3)];
            let mut found = Sums::zero(n);
            add_differences(parts, self.limits.most, &mut found.square, &mut found.count);
            for place in [step, 2 * step] {
                add(&found.square, &mut sums.square[place..place + n]);
                add(&found.count, &mut sums.count[place..place + n]);
            }
        }
        for place in [step, 2 * step] {
            if row >= place && row - place + 3 * step < height {
                let lines = [0, 1, 2, 3].map(|k| line(row - place + k * step));
                let Sums { square, count } = sums;
                add_differences(lines, self.limits.most, square, count);
            }
        }
    }
}

/// Add the χ² of third differences, and 1 for each that is known.
#[inline(always)]
fn add_differences(parts: [(&[f32], &[f32]); 4], most: f32, square: &mut [f32], count: &mut [f32]) {
    let n = square.len();
    let [a, b, c, d] = parts.map(|(x, sigma)| (&x[..n], &sigma[..n]));
    let count = &mut count[..n];
    for i in 0..n {
        let difference = (d.0[i] - a.0[i]) + 3.0 * (b.0[i] - c.0[i]);
        let outer = a.1[i] * a.1[i] + d.1[i] * d.1[i];
        let inner = b.1[i] * b.1[i] + c.1[i] * c.1[i];
        let chi = difference * difference / (outer + 9.0 * inner);
        // False for NaN, where a coordinate is unknown.
        let known = difference.abs() < most;
        square[i] += if known { chi } else { 0.0 };
        count[i] += if known { 1.0 } else { 0.0 };
    }
}

/// Sums of the values around every pixel of a row, up to `half` pixels away; reflected at the ends.
#[inline(always)]
fn sum_along(values: &[f32], half: usize, out: &mut [f32]) {
    let n = values.len();
    let mut padded = vec![0.0; n + 2 * half];
    padded[half..half + n].copy_from_slice(values);
    for k in 1..=half as isize {
        padded[half - k as usize] = values[reflected(-k, n)];
        padded[half + n + k as usize - 1] = values[reflected(n as isize + k - 1, n)];
    }
    out.fill(0.0);
    for k in 0..=2 * half {
        add(&padded[k..k + n], out);
    }
}

#[inline(always)]
fn add(values: &[f32], to: &mut [f32]) {
    for (sum, value) in to.iter_mut().zip(values) {
        *sum += value;
    }
}

/// Place of an index beyond the ends of `n` values that are reflected there, the last one repeated.
fn reflected(index: isize, n: usize) -> usize {
    let n = n as isize;
    let place = index.rem_euclid(2 * n);
    place.min(2 * n - 1 - place) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_reflected() {
        let found: Vec<usize> = (-3..6).map(|k| reflected(k, 3)).collect();
        assert_eq!(found, [2, 1, 0, 0, 1, 2, 2, 1, 0]);
        let mut out = [0.0; 4];
        sum_along(&[1.0, 2.0, 4.0, 8.0], 1, &mut out);
        assert_eq!(out, [4.0, 7.0, 14.0, 20.0]);
    }

    #[test]
    fn a_polynomial_of_degree_two_does_not_scatter() {
        let (width, height) = (40, 30);
        let x: Vec<f32> = (0..width * height)
            .map(|i| ((i % width) as f32).powi(2) + 3.0 * (i / width) as f32)
            .collect();
        let sigma = vec![0.1; x.len()];
        let limits = Limits {
            most: 5.0,
            excess: 4.0,
            shared: 4.6,
        };
        let mut factors = vec![1.0; x.len()];
        let scale = Scale { step: 2, side: 13 };
        let [x, sigma] = [&x, &sigma].map(|map| Image::new(map, height, width).unwrap());
        let out = ImageMut::new(&mut factors, height, width).unwrap();
        raise_factors(x, sigma, scale, limits, out).unwrap();
        assert!(factors.iter().all(|&f| f == 1.0));
    }
}
