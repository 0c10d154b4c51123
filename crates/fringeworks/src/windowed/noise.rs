//! Correlation of the noise of neighbouring pixels.

use rayon::prelude::*;

/// Side of the blocks whose means are compared with single pixels, px.
///
/// Wider than the reach of demosaicking, and small enough that the residual of a large window is
/// noise. An empirical choice.
const MEAN_PIXELS: usize = 5;

/// Distance, in blocks along y, of the blocks that are subtracted from each other.
///
/// Fringes run along y, so that the error of a window that does not fit is nearly the same in both;
/// two blocks are further apart than the blocks of 8 px that JPEG has.
const APART: usize = 2;

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
/// It compares the median magnitude of differences of block means with that of single residuals. Medians
/// ignore the few places where a large window does not fit.
pub fn correlation(residuals: &[f32], height: usize, width: usize) -> f64 {
    let (rows, columns) = (height / MEAN_PIXELS, width / MEAN_PIXELS);
    if rows <= APART || columns == 0 {
        return 1.0;
    }
    let blocks = (rows - APART) * columns;
    // Sum and middle pixel of a block; NaN for one with a pixel without data.
    let block = |row: usize, column: usize| {
        let (top, left) = (row * MEAN_PIXELS, column * MEAN_PIXELS);
        let sum: f32 = (top..top + MEAN_PIXELS)
            .flat_map(|y| &residuals[y * width + left..y * width + left + MEAN_PIXELS])
            .sum();
        let middle = (top + MEAN_PIXELS / 2) * width + left + MEAN_PIXELS / 2;
        (sum, residuals[middle])
    };
    let stride = blocks.div_ceil(MEDIAN_VALUES).max(1);
    let (means, singles): (Vec<f32>, Vec<f32>) = (0..blocks / stride)
        .into_par_iter()
        .filter_map(|k| {
            let (row, column) = (k * stride / columns, k * stride % columns);
            let (here, there) = (block(row, column), block(row + APART, column));
            let apart = here.0 - there.0;
            (apart.is_finite()).then(|| {
                (
                    (apart / (MEAN_PIXELS * MEAN_PIXELS) as f32).abs(),
                    (here.1 - there.1).abs(),
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
