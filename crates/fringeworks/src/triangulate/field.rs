//! What a device's lens model does not hold: a smooth correction of its pixels.

use super::prepare::{Projector, Triangulation};
use super::{Axis, Points};
use crate::{Error, check_length, check_value};

/// Control points that a place depends on, along each axis.
const SUPPORT: usize = 4;

/// A correction of pixels as a surface of cubic B-splines over a device's frame.
///
/// It is subtracted from a measured pixel; what is left follows the [`Lens`](super::Lens). Beyond the
/// outer control points it is constant.
///
/// ```
/// use fringeworks::triangulate::Field;
///
/// let control = [0.1, -0.2].repeat(20);
/// let field = Field::new([-10.0, -10.0], [10.0, 10.0], 5, control)?;
/// let [x, y] = field.at(7.0, 3.0);
/// assert!((x - 0.1).abs() < 1e-12 && (y + 0.2).abs() < 1e-12);
/// # Ok::<(), fringeworks::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Field {
    first: [f64; 2],
    step: [f64; 2],
    columns: usize,
    rows: usize,
    control: Vec<f64>,
}

impl Field {
    /// `first` is the place of the first control point, `step` their distance, both along columns and
    /// rows in px. `control` has corrections of column and row, point after point of each row.
    pub fn new(
        first: [f64; 2],
        step: [f64; 2],
        columns: usize,
        control: Vec<f64>,
    ) -> Result<Self, Error> {
        check_value("columns", columns >= SUPPORT, "4 or more", columns)?;
        let rows = control.len() / (2 * columns);
        check_value("rows", rows >= SUPPORT, "4 or more", rows)?;
        check_length("control points", control.len(), 2 * columns * rows)?;
        let wide = step.iter().all(|&s| s > 0.0);
        check_value("step", wide, "> 0", format!("{step:?}"))?;
        Ok(Self {
            first,
            step,
            columns,
            rows,
            control,
        })
    }

    /// Correction at a pixel.
    #[must_use]
    pub fn at(&self, column: f64, row: f64) -> [f64; 2] {
        let (i, across) = self.cell(0, self.columns, column);
        let (j, down) = self.cell(1, self.rows, row);
        let mut found = [0.0; 2];
        for (b, of_row) in down.iter().enumerate() {
            let first = 2 * ((j + b) * self.columns + i);
            let control = &self.control[first..first + 2 * SUPPORT];
            for (weight, point) in across.iter().zip(control.chunks_exact(2)) {
                found[0] += of_row * weight * point[0];
                found[1] += of_row * weight * point[1];
            }
        }
        found
    }

    /// First of four control points along an axis, and their weights.
    fn cell(&self, axis: usize, count: usize, place: f64) -> (usize, [f64; SUPPORT]) {
        let at = (place - self.first[axis]) / self.step[axis];
        let at = at.clamp(1.0, count as f64 - 2.0);
        let cell = (at as usize).min(count - SUPPORT + 1);
        let u = at - cell as f64;
        let rest = 1.0 - u;
        let weights = [
            rest * rest * rest / 6.0,
            2.0 / 3.0 - u * u * (1.0 - 0.5 * u),
            2.0 / 3.0 - rest * rest * (1.0 - 0.5 * rest),
            u * u * u / 6.0,
        ];
        (cell - 1, weights)
    }
}

/// Coordinates of a row as the projector's lens model has them, along both axes.
///
/// The correction depends on both coordinates. Where one was not decoded, it is that of the points
/// `out` which were found without the correction: it hardly changes over so short a way.
pub fn corrected(
    field: &Field,
    rig: &Triangulation,
    x: Option<Axis<'_>>,
    y: Option<Axis<'_>>,
    out: &Points<'_>,
) -> [Vec<f32>; 2] {
    let decoded = [x, y].map(|axis| axis.map(|axis| axis.coordinate));
    let mut found = decoded.map(|axis| axis.map_or_else(Vec::new, <[f32]>::to_vec));
    for i in 0..out.reason.len() {
        let seen = match decoded {
            [Some(x), Some(y)] => [x[i], y[i]],
            _ => {
                let seen = rig.projector.pixel(&out.xyz[3 * i..3 * i + 3]);
                [0, 1].map(|k| decoded[k].map_or(seen[k], |axis| axis[i]))
            }
        };
        if seen[0].is_finite() && seen[1].is_finite() {
            let by = field.at(f64::from(seen[0]), f64::from(seen[1]));
            for (axis, by) in found.iter_mut().zip(by) {
                if let Some(coordinate) = axis.get_mut(i) {
                    *coordinate = (f64::from(*coordinate) - by) as f32;
                }
            }
        }
    }
    found
}

impl Projector {
    /// Pixel that lights a point, after its lens model.
    fn pixel(&self, point: &[f32]) -> [f32; 2] {
        let r = &self.rotation;
        let [x, y, z] = [0, 1, 2].map(|k| {
            r[3 * k] * point[0]
                + r[3 * k + 1] * point[1]
                + r[3 * k + 2] * point[2]
                + self.translation[k]
        });
        let (x, y) = (x / z, y / z);
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let distorted = [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ];
        [0, 1].map(|k| distorted[k] * self.focal[k] + self.principal[k])
    }
}
