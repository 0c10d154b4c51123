//! Triangulation: from projector coordinates to points (theory §8 and §9).
//!
//! The unknown of a pixel is w = 1/z along its ray. In the projector's coordinates, divided by its
//! depth z, a point is R r + w t, which is linear in w. Without distortion, one axis gives w in
//! closed form. With distortion, the coordinate is first moved by what distortion does along this
//! ray, which is known from the rig, so that one step of Newton's method is enough. The same step
//! takes in the second axis.
//!
//! A row of the frame is cut into segments of 32 pixels. The rays of a segment are cubics through
//! four pixels, whose distortion is inverted in double precision when the rig is prepared.
//!
//! Polynomials use fused multiply-add where the processor has it, so results of different
//! instruction sets agree to rounding only.

pub(crate) mod arithmetic;
mod depth;
mod field;
mod lens;
mod points;
mod prepare;
mod rays;
mod row;
mod shift;

use crate::{Error, check_length, check_value};
use rayon::prelude::*;

pub use field::Field;
pub use lens::Lens;
pub use prepare::Triangulation;

/// Pixels of a segment, which are computed together.
///
/// 32 single-precision values fill two registers of 512 bit, or four of 256 bit, so that the
/// latency of one operation is hidden by the next. All arrays of a segment stay in the first cache.
const SEGMENT_PIXELS: usize = 32;

/// One value per pixel of a segment.
type Values = [f32; SEGMENT_PIXELS];

/// Coefficients of the polynomial in [`Spread`], per node.
///
/// Must be the number that the Python side fits (`fringeworks.rig.triangulate`): degree 4 follows
/// the logarithm of the variance along a ray over the depths that the projector lights.
pub const SPREAD_COEFFICIENTS: usize = 5;

/// Binary logarithm that stands for a variance of zero: the least exponent of single precision.
const NO_VARIANCE: f32 = -126.0;

/// Camera, projector, and the pose that maps camera coordinates to projector coordinates.
pub struct Rig {
    /// The camera.
    pub camera: Lens,
    /// The projector, as a camera that sends light.
    pub projector: Lens,
    /// Rotation matrix, row by row.
    pub rotation: [f64; 9],
    /// Translation, mm.
    pub translation: [f64; 3],
}

/// Variance of 1/z that comes from the calibration: a polynomial along the ray of each node.
///
/// The nodes are evenly spaced and cover the camera's frame.
pub struct Spread {
    /// Nodes in a row.
    pub columns: usize,
    /// Rows of nodes.
    pub rows: usize,
    /// Coefficients of the binary logarithm of the variance, [`SPREAD_COEFFICIENTS`] per node from
    /// the constant on, node after node of each row. The variable is the projector coordinate,
    /// scaled to −1…1 over the projector's length.
    pub coefficients: Vec<f32>,
    /// Whether the variable is the projector's column (x) or its row (y).
    pub along_x: bool,
    /// Length of the projector along that axis, px.
    pub length: f32,
}

impl Spread {
    /// A calibration without errors.
    ///
    /// ```
    /// use fringeworks::triangulate::Spread;
    ///
    /// let spread = Spread::none(true, 1024.0);
    /// assert_eq!((spread.rows, spread.columns), (2, 2));
    /// ```
    pub fn none(along_x: bool, length: f32) -> Self {
        let node = [NO_VARIANCE, 0.0, 0.0, 0.0, 0.0];
        Self {
            columns: 2,
            rows: 2,
            coefficients: node.repeat(4),
            along_x,
            length,
        }
    }
}

/// Decoded maps along one axis of the projector, one value per camera pixel.
#[derive(Clone, Copy)]
pub struct Axis<'a> {
    /// Projector coordinate, px.
    pub coordinate: &'a [f32],
    /// Standard deviation of the coordinate, px.
    pub sigma: &'a [f32],
    /// Codes of [`crate::Reason`].
    pub reason: &'a [u8],
}

/// Limits that a point must keep.
pub struct Limits {
    /// Largest distance from the epipolar line, in standard deviations of that distance.
    pub residual_sigmas: f32,
    /// Share of the calibration in that standard deviation, px.
    pub residual_px: f32,
}

/// Output maps with one value per pixel of the camera's frame; `xyz` has three.
pub struct Points<'a> {
    /// Camera coordinates, mm; NaN where not measured.
    pub xyz: &'a mut [f32],
    /// Standard deviation along the ray from noise and calibration, mm.
    pub sigma: &'a mut [f32],
    /// Standard deviation along the ray from noise alone, mm.
    pub noise: &'a mut [f32],
    /// Distance from the epipolar line, px; empty for one axis.
    pub residual: &'a mut [f32],
    /// Codes of [`crate::Reason`].
    pub reason: &'a mut [u8],
}

impl<'a> Axis<'a> {
    fn check(&self, pixels: usize) -> Result<(), Error> {
        check_length("coordinate", self.coordinate.len(), pixels)?;
        check_length("sigma", self.sigma.len(), pixels)?;
        check_length("reason", self.reason.len(), pixels)
    }

    /// The same maps with other coordinates.
    fn with(self, coordinate: &'a [f32]) -> Axis<'a> {
        Axis { coordinate, ..self }
    }

    /// One row of the maps.
    fn row(self, index: usize, width: usize) -> Axis<'a> {
        let range = index * width..(index + 1) * width;
        Axis {
            coordinate: &self.coordinate[range.clone()],
            sigma: &self.sigma[range.clone()],
            reason: &self.reason[range],
        }
    }
}

impl<'a> Points<'a> {
    /// The same maps, borrowed for a shorter time.
    fn again(&mut self) -> Points<'_> {
        Points {
            xyz: self.xyz,
            sigma: self.sigma,
            noise: self.noise,
            residual: self.residual,
            reason: self.reason,
        }
    }

    /// Cut into bands of `rows` rows, each with the index of its first row.
    pub(crate) fn split_rows(self, width: usize, rows: usize) -> Vec<(usize, Points<'a>)> {
        let pixels = (width * rows).max(1);
        let mut residuals = self.residual.chunks_mut(pixels);
        self.xyz
            .chunks_mut(3 * pixels)
            .zip(self.sigma.chunks_mut(pixels))
            .zip(self.noise.chunks_mut(pixels))
            .zip(self.reason.chunks_mut(pixels))
            .enumerate()
            .map(|(k, (((xyz, sigma), noise), reason))| {
                let band = Points {
                    xyz,
                    sigma,
                    noise,
                    residual: residuals.next().unwrap_or_default(),
                    reason,
                };
                (k * rows, band)
            })
            .collect()
    }

    fn check(&self, pixels: usize, both_axes: bool) -> Result<(), Error> {
        check_length("points", self.xyz.len(), 3 * pixels)?;
        check_length("sigma", self.sigma.len(), pixels)?;
        check_length("noise", self.noise.len(), pixels)?;
        check_length("reason", self.reason.len(), pixels)?;
        let residuals = if both_axes { pixels } else { 0 };
        check_length("residual", self.residual.len(), residuals)
    }
}

/// Refuse axes and outputs that do not fit the rig; of coordinates, only whether they are given.
pub(crate) fn check(rig: &Triangulation, x: bool, y: bool, out: &Points<'_>) -> Result<(), Error> {
    let pixels = rig.shape().0 * rig.shape().1;
    check_value("axes", x || y, "one or two", "none")?;
    out.check(pixels, x && y)?;
    let given = if rig.spread_along_x() { x } else { y };
    check_value("spread", given, "an axis that is given", "the other")
}

impl Triangulation {
    /// Triangulate a frame from one axis or both.
    ///
    /// ```
    /// use fringeworks::triangulate::{Axis, Limits, Points};
    ///
    /// // Camera and projector look the same way from 100 mm apart; see `Triangulation::new`.
    /// # use fringeworks::triangulate::{Lens, Rig, Spread, Triangulation};
    /// # let lens = Lens { focal: [1000.0; 2], principal: [15.5, 7.5], distortion: [0.0; 5] };
    /// # let rig = Rig {
    /// #     camera: lens,
    /// #     projector: lens,
    /// #     rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    /// #     translation: [-100.0, 0.0, 0.0],
    /// # };
    /// # let rig = Triangulation::new(&rig, &Spread::none(true, 1024.0), (16, 32), (1024, 768))?;
    /// // At a depth of 1 m the projector's column lies f · 100 / 1000 = 100 px beside the camera's.
    /// let coordinate: Vec<f32> = (0..512).map(|i| (i % 32) as f32 - 100.0).collect();
    /// let x = Axis { coordinate: &coordinate, sigma: &[0.05; 512], reason: &[0; 512] };
    /// let (mut xyz, mut sigma, mut noise, mut reason) = ([0.0; 1536], [0.0; 512], [0.0; 512], [0; 512]);
    /// let out = Points {
    ///     xyz: &mut xyz,
    ///     sigma: &mut sigma,
    ///     noise: &mut noise,
    ///     residual: &mut [],
    ///     reason: &mut reason,
    /// };
    /// let limits = Limits { residual_sigmas: 5.0, residual_px: 0.1 };
    /// rig.triangulate(Some(x), None, &limits, out)?;
    /// assert!((xyz[2] - 1000.0).abs() < 0.1);
    /// // An error of 0.05 px is 0.5 mm there.
    /// assert!((noise[0] - 0.5).abs() < 0.01);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn triangulate(
        &self,
        x: Option<Axis<'_>>,
        y: Option<Axis<'_>>,
        limits: &Limits,
        out: Points<'_>,
    ) -> Result<(), Error> {
        let (rows, width) = self.shape();
        check(self, x.is_some(), y.is_some(), &out)?;
        for axis in [x, y].into_iter().flatten() {
            axis.check(rows * width)?;
        }
        out.split_rows(width, 1)
            .into_par_iter()
            .for_each(|(index, out)| {
                let [x, y] = [x, y].map(|axis| axis.map(|axis| axis.row(index, width)));
                triangulate_row(self, limits, index, x, y, out);
            });
        Ok(())
    }
}

/// Triangulate one row of the camera; axes and outputs hold that row only.
pub(crate) fn triangulate_row(
    rig: &Triangulation,
    limits: &Limits,
    index: usize,
    x: Option<Axis<'_>>,
    y: Option<Axis<'_>>,
    mut out: Points<'_>,
) {
    let Some(field) = rig.projector_field() else {
        return as_decoded(rig, limits, index, x, y, out);
    };
    if x.is_none() || y.is_none() {
        as_decoded(rig, limits, index, x, y, out.again());
    }
    let [along_x, along_y] = field::corrected(field, rig, x, y, &out);
    let x = x.map(|axis| axis.with(&along_x));
    let y = y.map(|axis| axis.with(&along_y));
    as_decoded(rig, limits, index, x, y, out);
}

/// Triangulate a row whose coordinates need no correction.
fn as_decoded(
    rig: &Triangulation,
    limits: &Limits,
    index: usize,
    x: Option<Axis<'_>>,
    y: Option<Axis<'_>>,
    out: Points<'_>,
) {
    row::triangulate_row(row::Row {
        rig,
        limits,
        index,
        x,
        y,
        out,
    });
}
