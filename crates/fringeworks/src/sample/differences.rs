//! Differences of neighbouring pixels: second ones along both axes, and third ones along rows.

use crate::{Error, Image, check_shape};

/// χ² of the third differences along rows that are known and not larger than `most`.
///
/// `sigma` are the standard deviations of the coordinates; NaN in either is unknown.
///
/// ```
/// use fringeworks::{Image, sample::third_chi_squares};
///
/// // A parabola has no third differences.
/// let parabola: Vec<f32> = (0..20).map(|x| (x * x) as f32).collect();
/// let found = third_chi_squares(Image::new(&parabola, 1, 20)?, Image::new(&[0.1; 20], 1, 20)?, 5.0)?;
/// assert_eq!(found, [0.0; 17]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn third_chi_squares(
    coordinate: Image<f32>,
    sigma: Image<f32>,
    most: f32,
) -> Result<Vec<f32>, Error> {
    check_shape("sigma", sigma.shape(), coordinate.shape())?;
    let width = coordinate.width();
    let mut found = Vec::with_capacity(coordinate.len());
    if width < 4 {
        return Ok(found);
    }
    let mut chi = vec![0.0; width - 3];
    for (x, s) in coordinate
        .chunks_exact(width)
        .zip(sigma.chunks_exact(width))
    {
        row_chi_squares(x, s, most, &mut chi);
        found.extend(chi.iter().filter(|value| !value.is_nan()));
    }
    Ok(found)
}

/// χ² of the differences of a row, NaN where unknown.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn row_chi_squares(x: &[f32], sigma: &[f32], most: f32, chi: &mut [f32]) {
    let n = chi.len();
    let [a, b, c, d] = [0, 1, 2, 3].map(|k| &x[k..k + n]);
    let [p, q, r, s] = [0, 1, 2, 3].map(|k| &sigma[k..k + n]);
    for i in 0..n {
        let difference = (a[i] - d[i]) + 3.0 * (c[i] - b[i]);
        let variance = p[i] * p[i] + s[i] * s[i] + 9.0 * (q[i] * q[i] + r[i] * r[i]);
        let known = difference.abs() < most;
        chi[i] = if known {
            difference * difference / variance
        } else {
            f32::NAN
        };
    }
}

/// A float of either precision.
pub trait Real: Copy + Default + Send + Sync + 'static {
    #[doc(hidden)]
    fn row_magnitudes(rows: &[Self], down: &mut [Self], out: &mut [Self]);
}

macro_rules! real {
    ($type:ident, $run:ident) => {
        #[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
        fn $run(rows: &[$type], down: &mut [$type], out: &mut [$type]) {
            let (w, n) = (down.len(), out.len());
            let (above, at, below) = (&rows[..w], &rows[w..2 * w], &rows[2 * w..3 * w]);
            for i in 0..w {
                down[i] = (below[i] - at[i]) - (at[i] - above[i]);
            }
            let (left, middle, right) = (&down[..n], &down[1..n + 1], &down[2..n + 2]);
            for i in 0..n {
                out[i] = ((right[i] - middle[i]) - (middle[i] - left[i])).abs();
            }
        }

        impl Real for $type {
            fn row_magnitudes(rows: &[Self], down: &mut [Self], out: &mut [Self]) {
                $run(rows, down, out);
            }
        }
    };
}
real!(f32, magnitudes_f32);
real!(f64, magnitudes_f64);

/// Magnitudes of second differences along both axes, (h - 2, w - 2); empty for smaller frames.
///
/// ```
/// use fringeworks::{Image, sample::second_magnitudes};
///
/// let mut frame = [0.0_f32; 9];
/// frame[4] = 1.0;
/// assert_eq!(second_magnitudes(Image::new(&frame, 3, 3)?), [4.0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn second_magnitudes<T: Real>(frame: Image<T>) -> Vec<T> {
    let (height, width) = frame.shape();
    if width < 3 || height < 3 {
        return Vec::new();
    }
    let mut out = vec![T::default(); (width - 2) * (height - 2)];
    let mut down = vec![T::default(); width];
    for (row, line) in out.chunks_exact_mut(width - 2).enumerate() {
        T::row_magnitudes(&frame[row * width..(row + 3) * width], &mut down, line);
    }
    out
}
