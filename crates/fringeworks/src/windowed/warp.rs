//! The reference warped by the current displacement: s(x − u) and s′(x − u), by cubic B-splines along
//! rows.

use crate::{Error, MIN_WIDTH, check_length, check_value};
use rayon::prelude::*;

/// Distance from either end of a row, px, within which the reference is not used: its spline depends on
/// mirrored data there.
const END_MARGIN: f64 = 2.0;

/// A frame pair in the normalised units of the kernel (background 0, modulation 1).
#[derive(Clone, Copy)]
pub struct Pair<'a> {
    pub height: usize,
    pub width: usize,
    /// Cubic B-spline coefficients of the reference rows, `height × (width + 3)`: one mirrored
    /// coefficient before the row and two after it.
    pub spline: &'a [f32],
    /// Object frame, `height × width`.
    pub object: &'a [f32],
    /// 1 where the reference sample is valid, else 0.
    pub reference_ok: &'a [u8],
    /// 1 where the object sample is valid, else 0.
    pub object_ok: &'a [u8],
    /// Albedo of the object over that of the reference, `height × width`, where it is known: it scales
    /// the model.
    pub albedo: Option<&'a [f32]>,
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
    /// Refuse sizes that do not fit, but for the object's samples and the albedo.
    pub fn check_reference(&self) -> Result<(), Error> {
        let n = self.height * self.width;
        let wide = self.width >= MIN_WIDTH;
        check_value("width", wide, "at least 8 px", self.width)?;
        check_value("height", self.height >= 1, "at least 1 px", self.height)?;
        check_length("spline", self.spline.len(), self.height * (self.width + 3))?;
        check_length("reference_ok", self.reference_ok.len(), n)?;
        check_length("object_ok", self.object_ok.len(), n)
    }

    /// Albedo of a pixel; 1 where it is not known.
    #[inline(always)]
    pub fn albedo_at(&self, i: usize) -> f32 {
        self.albedo.map_or(1.0, |albedo| albedo[i])
    }

    /// Value and slope of the reference at x − u; `None` where either frame has no valid sample.
    #[inline(always)]
    pub fn reference_at(&self, x: usize, y: usize, u: f32) -> Option<(f32, f32)> {
        let position = x as f64 - u as f64;
        // Both comparisons are false for a NaN displacement.
        let inside = position >= END_MARGIN && position <= (self.width - 1) as f64 - END_MARGIN;
        let row = y * self.width;
        if !inside
            || self.object_ok[row + x] == 0
            || self.reference_ok[row + (position + 0.5) as usize] == 0
        {
            return None;
        }
        let coefficients = &self.spline[y * (self.width + 3)..(y + 1) * (self.width + 3)];
        Some(evaluate(coefficients, position))
    }
}

/// Warp row `y` by the displacement `u` of that row.
pub fn warp_row(pair: &Pair, y: usize, u: &[f32], out: &mut WarpedRow) {
    for x in 0..pair.width {
        let albedo = pair.albedo_at(y * pair.width + x);
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
pub fn warped(pair: &Pair, u: &[f32]) -> Result<Warped, Error> {
    pair.check_reference()?;
    let n = pair.height * pair.width;
    check_length("displacement", u.len(), n)?;
    let (mut value, mut slope, mut known) = (vec![0.0; n], vec![0.0; n], vec![0; n]);
    (value.par_chunks_mut(pair.width))
        .zip(slope.par_chunks_mut(pair.width))
        .zip(known.par_chunks_mut(pair.width))
        .enumerate()
        .for_each(|(y, ((value, slope), known))| {
            for x in 0..pair.width {
                if let Some((v, g)) = pair.reference_at(x, y, u[y * pair.width + x]) {
                    (value[x], slope[x], known[x]) = (v, g, 1);
                }
            }
        });
    Ok((value, slope, known))
}
