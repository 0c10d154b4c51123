//! The reference warped by the current displacement: s(x − u) and s′(x − u), by cubic B-splines along
//! rows.

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
}

/// One warped row: weight (0 or 1), value and slope of the reference at x − u.
pub struct WarpedRow {
    pub weight: Vec<f32>,
    pub value: Vec<f32>,
    pub slope: Vec<f32>,
}

impl WarpedRow {
    pub fn new(width: usize) -> Self {
        Self {
            weight: vec![0.0; width],
            value: vec![0.0; width],
            slope: vec![0.0; width],
        }
    }

    /// Weight, reference value, reference slope and weighted object sample at column `x`.
    #[inline(always)]
    pub fn sample(&self, x: usize, object: &[f32]) -> (f64, f64, f64, f64) {
        let weight = self.weight[x] as f64;
        (
            weight,
            self.value[x] as f64,
            self.slope[x] as f64,
            weight * object[x] as f64,
        )
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
        if let Some((value, slope)) = pair.reference_at(x, y, u[x]) {
            out.weight[x] = 1.0;
            out.value[x] = value;
            out.slope[x] = slope;
        } else {
            out.weight[x] = 0.0;
            out.value[x] = 0.0;
            out.slope[x] = 0.0;
        }
    }
}
