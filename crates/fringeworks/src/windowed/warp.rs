//! The reference warped by the current displacement: s(x − u) and s′(x − u), by cubic B-splines along
//! rows.

use crate::{Error, Image, MIN_WIDTH, check_shape, check_value};
use rayon::prelude::*;

/// Distance from either end of a row, px, within which the reference is not used: its spline depends on
/// mirrored data there.
const END_MARGIN: f64 = 2.0;

/// A frame pair in the normalised units of the kernel (background 0, modulation 1).
#[derive(Clone, Copy)]
pub struct Pair<'a> {
    /// Cubic B-spline coefficients of the reference rows, three more than the frame has columns: one
    /// mirrored coefficient before the row and two after it.
    pub spline: Image<'a, f32>,
    /// Object frame.
    pub object: Image<'a, f32>,
    /// 1 where the reference sample is valid, else 0.
    pub reference_ok: Image<'a, u8>,
    /// 1 where the object sample is valid, else 0.
    pub object_ok: Image<'a, u8>,
    /// Albedo of the object over that of the reference, where it is known: it scales the model.
    pub albedo: Option<Image<'a, f32>>,
}

/// One warped row: the albedo (0 without data), and the value and slope of the reference at x − u, times
/// the albedo.
pub struct WarpedRow {
    pub albedo: Vec<f32>,
    pub value: Vec<f32>,
    pub slope: Vec<f32>,
}

/// The products of one pixel in a model that is linear in β, β s and β g.
pub struct Sample {
    /// 1 where there is data, else 0.
    pub weight: f64,
    /// β.
    pub albedo: f64,
    /// β s.
    pub value: f64,
    /// β g.
    pub slope: f64,
    /// d.
    pub object: f64,
}

impl WarpedRow {
    pub fn new(width: usize) -> Self {
        Self {
            albedo: vec![0.0; width],
            value: vec![0.0; width],
            slope: vec![0.0; width],
        }
    }

    #[inline(always)]
    pub fn sample(&self, x: usize, object: &[f32]) -> Sample {
        let weight = (self.albedo[x] > 0.0) as u8 as f64;
        Sample {
            weight,
            albedo: self.albedo[x] as f64,
            value: self.value[x] as f64,
            slope: self.slope[x] as f64,
            object: weight * object[x] as f64,
        }
    }
}

/// Value and slope of the row's spline at `position`, which must lie in `[0, width − 1]`.
#[inline(always)]
fn evaluate(coefficients: &[f32], position: f64) -> (f32, f32) {
    let last = coefficients.len() - 4;
    let k = (position as usize).min(last);
    let t = (position - k as f64) as f32;
    let c = &coefficients[k..k + 4];
    let r = 1.0 - t;
    let value = (c[0] * (r * r * r)
        + c[1] * ((3.0 * t - 6.0) * t * t + 4.0)
        + c[2] * (((3.0 - 3.0 * t) * t + 3.0) * t + 1.0)
        + c[3] * (t * t * t))
        / 6.0;
    let slope = (-c[0] * (r * r)
        + c[1] * ((3.0 * t - 4.0) * t)
        + c[2] * ((2.0 - 3.0 * t) * t + 1.0)
        + c[3] * (t * t))
        * 0.5;
    (value, slope)
}

impl Pair<'_> {
    /// Number of rows.
    #[inline(always)]
    pub(super) fn height(&self) -> usize {
        self.object.height()
    }

    /// Number of columns.
    #[inline(always)]
    pub(super) fn width(&self) -> usize {
        self.object.width()
    }

    /// Refuse sizes that do not fit, and an albedo that is none.
    pub(super) fn check(&self) -> Result<(), Error> {
        let (height, width) = self.object.shape();
        check_value("width", width >= MIN_WIDTH, "at least 8 px", width)?;
        check_value("height", height >= 1, "at least 1 px", height)?;
        check_shape("spline", self.spline.shape(), (height, width + 3))?;
        check_shape("reference_ok", self.reference_ok.shape(), (height, width))?;
        check_shape("object_ok", self.object_ok.shape(), (height, width))?;
        if let Some(albedo) = self.albedo {
            check_shape("albedo", albedo.shape(), (height, width))?;
            let positive = albedo.iter().all(|a| *a > 0.0 && a.is_finite());
            check_value("albedo", positive, "finite values above 0", "others")?;
        }
        Ok(())
    }

    /// Albedo of a pixel; 1 where it is not known.
    #[inline(always)]
    pub(super) fn albedo_at(&self, i: usize) -> f32 {
        self.albedo.map_or(1.0, |albedo| albedo[i])
    }

    /// Value and slope of the reference at x − u; `None` where either frame has no valid sample.
    #[inline(always)]
    pub(super) fn reference_at(&self, x: usize, y: usize, u: f32) -> Option<(f32, f32)> {
        let position = x as f64 - u as f64;
        // Both comparisons are false for a NaN displacement.
        let inside = position >= END_MARGIN && position <= (self.width() - 1) as f64 - END_MARGIN;
        let row = y * self.width();
        if !inside
            || self.object_ok[row + x] == 0
            || self.reference_ok[row + (position + 0.5) as usize] == 0
        {
            return None;
        }
        Some(evaluate(self.spline.row(y), position))
    }
}

/// Warp row `y` by the displacement `u` of that row.
pub fn warp_row(pair: &Pair, y: usize, u: &[f32], out: &mut WarpedRow) {
    for x in 0..pair.width() {
        let albedo = pair.albedo_at(y * pair.width() + x);
        if let Some((value, slope)) = pair.reference_at(x, y, u[x]) {
            out.albedo[x] = albedo;
            out.value[x] = albedo * value;
            out.slope[x] = albedo * slope;
        } else {
            out.albedo[x] = 0.0;
            out.value[x] = 0.0;
            out.slope[x] = 0.0;
        }
    }
}

/// Value, slope, and 1 where there is data.
pub type Warped = (Vec<f32>, Vec<f32>, Vec<u8>);

/// Value and slope of the reference at x − u for every pixel, 0 without data, and 1 where there is data.
/// The object's samples are not used.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::windowed::{Pair, warp_windowed};
///
/// // Fringes of 20 px; see `invert_windowed`.
/// # let wave = |x: f32| (std::f32::consts::TAU * x / 20.0).cos();
/// # let factor = 3.0 / (2.0 + wave(1.0));
/// # let (h, w) = (40, 60);
/// # let spline: Vec<f32> = (0..h * (w + 3)).map(|i| factor * wave((i % (w + 3)) as f32 - 1.0)).collect();
/// # let object: Vec<f32> = (0..h * w).map(|i| wave((i % w) as f32 - 1.5)).collect();
/// # let ok = vec![1; h * w];
/// # let pair = Pair {
/// #     spline: Image::new(&spline, h, w + 3)?,
/// #     object: Image::new(&object, h, w)?,
/// #     reference_ok: Image::new(&ok, h, w)?,
/// #     object_ok: Image::new(&ok, h, w)?,
/// #     albedo: None,
/// # };
/// let u = vec![1.5; h * w];
/// let (value, _slope, known) = warp_windowed(&pair, Image::new(&u, h, w)?)?;
/// assert_eq!((known[0], known[30]), (0, 1));
/// assert!((value[30] - object[30]).abs() < 1e-3);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn warp_windowed(pair: &Pair, u: Image<f32>) -> Result<Warped, Error> {
    pair.check()?;
    check_shape("displacement", u.shape(), pair.object.shape())?;
    let n = u.len();
    let (mut value, mut slope, mut known) = (vec![0.0; n], vec![0.0; n], vec![0; n]);
    (value.par_chunks_mut(pair.width()))
        .zip(slope.par_chunks_mut(pair.width()))
        .zip(known.par_chunks_mut(pair.width()))
        .enumerate()
        .for_each(|(y, ((value, slope), known))| {
            for x in 0..pair.width() {
                if let Some((v, g)) = pair.reference_at(x, y, u[y * pair.width() + x]) {
                    (value[x], slope[x], known[x]) = (v, g, 1);
                }
            }
        });
    Ok((value, slope, known))
}
