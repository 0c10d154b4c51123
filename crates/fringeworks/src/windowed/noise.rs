//! Correlation of the noise of neighbouring pixels.

use rayon::prelude::*;

/// Side of the blocks whose means are compared with single pixels, px.
///
/// Wider than the reach of demosaicking, and small enough that the residual of a large window is
/// noise. An empirical choice.
const MEAN_PIXELS: usize = 5;

/// Number of values that a median is taken of: its scatter is then about half a per cent.
const MEDIAN_VALUES: usize = 100_000;

/// Median of values that are not negative; 0 for none.
fn median_magnitude(mut values: Vec<f32>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    let (_, median, _) = values.select_nth_unstable_by(middle, f32::total_cmp);
    *median as f64
}

/// Variance of a mean over many pixels' noise divided by that of independent noise: 1 for white noise,
/// more where compression, demosaicking or paint correlate neighbours.
///
/// It compares the median magnitude of block means with that of single residuals. Medians ignore the
/// few places where a large window does not fit.
pub fn correlation(residuals: &[f32], height: usize, width: usize) -> f64 {
    if height < MEAN_PIXELS || width < MEAN_PIXELS {
        return 1.0;
    }
    let blocks = (height / MEAN_PIXELS) * (width / MEAN_PIXELS);
    let stride = blocks.div_ceil(MEDIAN_VALUES).max(1);
    let (means, singles): (Vec<f32>, Vec<f32>) = (0..blocks / stride)
        .into_par_iter()
        .filter_map(|k| {
            let (row, column) = (
                k * stride / (width / MEAN_PIXELS),
                k * stride % (width / MEAN_PIXELS),
            );
            let mut sum = 0.0f32;
            for y in row * MEAN_PIXELS..(row + 1) * MEAN_PIXELS {
                for x in column * MEAN_PIXELS..(column + 1) * MEAN_PIXELS {
                    sum += residuals[y * width + x];
                }
            }
            let middle = (row * MEAN_PIXELS + MEAN_PIXELS / 2) * width
                + column * MEAN_PIXELS
                + MEAN_PIXELS / 2;
            // A block with a pixel without data has a NaN sum.
            sum.is_finite().then(|| {
                (
                    (sum / (MEAN_PIXELS * MEAN_PIXELS) as f32).abs(),
                    residuals[middle].abs(),
                )
            })
        })
        .unzip();
    let (mean, single) = (median_magnitude(means), median_magnitude(singles));
    if single <= 0.0 {
        return 1.0;
    }
    ((MEAN_PIXELS * MEAN_PIXELS) as f64 * (mean / single).powi(2))
        .clamp(1.0, (MEAN_PIXELS * MEAN_PIXELS) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Uniform noise from a linear congruential generator.
    fn noise(n: usize) -> Vec<f32> {
        let mut state = 1u64;
        (0..n)
            .map(|_| {
                state = state
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5
            })
            .collect()
    }

    #[test]
    fn white_and_smoothed_noise() {
        let (h, w) = (300, 400);
        let white = noise(h * w);
        assert!(correlation(&white, h, w) < 1.5);
        let smooth: Vec<f32> = (0..h * w)
            .map(|i| {
                let (y, x) = (i / w, i % w);
                let at = |dy: usize, dx: usize| white[((y + dy) % h) * w + (x + dx) % w];
                at(0, 0) + at(0, 1) + at(1, 0) + at(1, 1)
            })
            .collect();
        let found = correlation(&smooth, h, w);
        assert!((2.5..4.5).contains(&found), "{found}");
    }
}
