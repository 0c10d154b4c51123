//! Rays along a segment as cubics, and the calibration's variance along it.

use super::arithmetic::Cubic;
use super::{SEGMENT_PIXELS, SPREAD_COEFFICIENTS, Spread};

/// Pixels of a segment at which the rays are computed exactly, counted from its first pixel.
///
/// Close to the Chebyshev nodes of 0 … 31, which spread the error of a cubic evenly.
const NODES: [f64; 4] = [1.0, 10.0, 21.0, 30.0];

/// Middle of a segment, px from its first pixel.
const MIDDLE: f64 = 15.5;

/// Half the length of a segment, px: scales the variable of the cubics to about −1…1.
const HALF_LENGTH: f64 = 16.0;

/// Variable of the cubics at a pixel of the segment.
#[inline(always)]
pub fn variable(pixel: usize) -> f32 {
    (pixel as f32 - MIDDLE as f32) * (1.0 / HALF_LENGTH as f32)
}

/// Rays of one segment: cubics in [`variable`].
pub struct Rays {
    /// Ray r of the camera, with r_z = 1.
    pub camera_x: Cubic,
    pub camera_y: Cubic,
    /// |r|.
    pub length: Cubic,
}

impl Rays {
    /// Rays of a segment that begins at a pixel; `ray` is the direction of a pixel.
    pub fn new(ray: impl Fn(f64, f64) -> (f64, f64), column: usize, row: usize) -> Self {
        let mut values = [[0.0; 4]; 3];
        for (k, node) in NODES.iter().enumerate() {
            let (x, y) = ray(column as f64 + node, row as f64);
            let at_node = [x, y, (x * x + y * y + 1.0).sqrt()];
            for (quantity, value) in values.iter_mut().zip(at_node) {
                quantity[k] = value;
            }
        }
        let at = NODES.map(|n| (n - MIDDLE) / HALF_LENGTH);
        let [camera_x, camera_y, length] = values.map(|v| interpolate(at, v));
        Self {
            camera_x,
            camera_y,
            length,
        }
    }
}

/// The cubic through four values: Newton's divided differences, multiplied out.
pub fn interpolate(at: [f64; 4], values: [f64; 4]) -> Cubic {
    let mut d = values;
    for order in 1..4 {
        for k in (order..4).rev() {
            d[k] = (d[k] - d[k - 1]) / (at[k] - at[k - order]);
        }
    }
    let mut c = [d[3], 0.0, 0.0, 0.0];
    for k in (0..3).rev() {
        c = [
            d[k] - at[k] * c[0],
            c[0] - at[k] * c[1],
            c[1] - at[k] * c[2],
            c[2] - at[k] * c[3],
        ];
    }
    c.map(|v| v as f32)
}

/// Coefficients of [`Spread`] along a segment: linear in the pixel.
pub struct SegmentSpread {
    /// Coefficients at the segment's first pixel.
    pub first: [f32; SPREAD_COEFFICIENTS],
    /// Their slopes, 1/px.
    pub slope: [f32; SPREAD_COEFFICIENTS],
}

impl SegmentSpread {
    pub fn new(spread: &Spread, shape: (usize, usize), column: usize, row: usize) -> Self {
        let first = spread.at(shape, column as f32, row);
        let last = spread.at(shape, (column + SEGMENT_PIXELS) as f32, row);
        let mut slope = [0.0; SPREAD_COEFFICIENTS];
        for k in 0..SPREAD_COEFFICIENTS {
            slope[k] = (last[k] - first[k]) / SEGMENT_PIXELS as f32;
        }
        Self { first, slope }
    }
}

impl Spread {
    /// Coefficients at a pixel of a frame of `shape` (rows, columns).
    fn at(&self, shape: (usize, usize), column: f32, row: usize) -> [f32; SPREAD_COEFFICIENTS] {
        between(
            &self.coefficients,
            (self.rows, self.columns),
            shape,
            (column, row),
        )
    }
}

/// `N` values at a pixel of a frame of `shape` (rows, columns), bilinear between nodes that cover it.
pub fn between<const N: usize>(
    nodes: &[f32],
    (rows, columns): (usize, usize),
    shape: (usize, usize),
    (column, row): (f32, usize),
) -> [f32; N] {
    let scale = |nodes: usize, pixels: usize| (nodes - 1) as f32 / (pixels - 1).max(1) as f32;
    let down = row as f32 * scale(rows, shape.0);
    let j = (down as usize).min(rows - 2);
    let v = down - j as f32;
    let across = column * scale(columns, shape.1);
    let i = (across as usize).min(columns - 2);
    let u = across - i as f32;
    std::array::from_fn(|k| {
        let node = |j: usize, i: usize| nodes[(j * columns + i) * N + k];
        let upper = node(j, i) + u * (node(j, i + 1) - node(j, i));
        let lower = node(j + 1, i) + u * (node(j + 1, i + 1) - node(j + 1, i));
        upper + v * (lower - upper)
    })
}

#[cfg(test)]
mod tests {
    use super::super::arithmetic::cubic;
    use super::*;

    #[test]
    fn cubic_goes_through_its_values() {
        let values = [0.3, -0.1, 0.25, 0.7];
        let at = NODES.map(|n| (n - MIDDLE) / HALF_LENGTH);
        let c = interpolate(at, values);
        for (node, value) in NODES.iter().zip(values) {
            let u = variable(*node as usize);
            assert!((f64::from(cubic::<false>(&c, u)) - value).abs() < 1e-6);
        }
    }
}
