//! A rig prepared for a camera's frame: everything that does not depend on decoded coordinates.

use super::arithmetic::Cubic;
use super::field::Field;
use super::rays::{Rays, SegmentSpread};
use super::shift::Shift;
use super::{Rig, SEGMENT_PIXELS, SPREAD_COEFFICIENTS, Spread};
use crate::{Error, check_length, check_value};
use rayon::prelude::*;

/// Rays and calibration variance of one segment.
pub struct Segment {
    pub rays: Rays,
    pub spread: SegmentSpread,
    /// What distortion moves the main coordinate by, in the variable of the spread.
    pub shift: Cubic,
}

/// The projector and the pose in single precision.
#[derive(Clone, Copy)]
pub struct Projector {
    pub focal: [f32; 2],
    pub principal: [f32; 2],
    pub distortion: [f32; 5],
    /// Rotation matrix, row by row.
    pub rotation: [f32; 9],
    pub translation: [f32; 3],
    /// Newton steps that the distortion takes from the shifted coordinate; one or more.
    pub newton_steps: usize,
}

/// Variable of the calibration variance: offset + factor × projector coordinate along an axis.
pub struct SpreadVariable {
    pub along_x: bool,
    pub offset: f32,
    pub factor: f32,
}

/// A rig prepared for a camera's frame.
pub struct Triangulation {
    /// Rows and columns.
    shape: (usize, usize),
    /// Row by row, [`SEGMENT_PIXELS`] pixels each.
    segments: Vec<Segment>,
    pub(super) projector: Projector,
    pub(super) spread_variable: SpreadVariable,
    projector_field: Option<Field>,
}

impl Triangulation {
    /// Prepare a rig. `camera_shape` is rows and columns of the camera, `projector_size` columns and
    /// rows of the projector.
    ///
    /// ```
    /// use fringeworks::triangulate::{Lens, Rig, Spread, Triangulation};
    ///
    /// // The projector stands 100 mm beside the camera.
    /// let camera = Lens { focal: [1000.0; 2], principal: [319.5, 239.5], distortion: [0.0; 5] };
    /// let projector = Lens { principal: [511.5, 383.5], ..camera };
    /// let rig = Rig {
    ///     camera,
    ///     projector,
    ///     rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    ///     translation: [-100.0, 0.0, 0.0],
    /// };
    /// let spread = Spread::none(true, 1024.0);
    /// assert!(Triangulation::new(&rig, &spread, (480, 640), (1024, 768)).is_ok());
    /// ```
    pub fn new(
        rig: &Rig,
        spread: &Spread,
        camera_shape: (usize, usize),
        projector_size: (usize, usize),
    ) -> Result<Self, Error> {
        Self::with_fields(rig, spread, camera_shape, projector_size, [None, None])
    }

    /// Prepare a rig whose camera and projector have corrections of their pixels.
    ///
    /// ```
    /// use fringeworks::triangulate::{Field, Lens, Rig, Spread, Triangulation};
    ///
    /// # let lens = Lens { focal: [1000.0; 2], principal: [15.5, 7.5], distortion: [0.0; 5] };
    /// # let rig = Rig {
    /// #     camera: lens,
    /// #     projector: lens,
    /// #     rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    /// #     translation: [-100.0, 0.0, 0.0],
    /// # };
    /// let field = Field::new([-10.0; 2], [10.0; 2], 5, vec![0.1; 50])?;
    /// let spread = Spread::none(true, 1024.0);
    /// let fields = [Some(field), None];
    /// assert!(Triangulation::with_fields(&rig, &spread, (16, 32), (1024, 768), fields).is_ok());
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn with_fields(
        rig: &Rig,
        spread: &Spread,
        camera_shape: (usize, usize),
        projector_size: (usize, usize),
        [camera_field, projector_field]: [Option<Field>; 2],
    ) -> Result<Self, Error> {
        let shape = camera_shape;
        let ray = |column: f64, row: f64| {
            let [x, y] = camera_field
                .as_ref()
                .map_or([0.0; 2], |field| field.at(column, row));
            rig.camera.ray(column - x, row - y)
        };
        let nodes = spread.columns * spread.rows;
        check_length(
            "spread",
            spread.coefficients.len(),
            nodes * SPREAD_COEFFICIENTS,
        )?;
        let enough = spread.columns >= 2 && spread.rows >= 2;
        check_value("spread", enough, "2 × 2 nodes or more", nodes)?;
        let per_row = shape.1.div_ceil(SEGMENT_PIXELS);
        let shift = Shift::new(rig, &ray, spread, shape, projector_size);
        let segments = (0..shape.0 * per_row)
            .into_par_iter()
            .map(|k| {
                let (row, column) = (k / per_row, k % per_row * SEGMENT_PIXELS);
                Segment {
                    rays: Rays::new(ray, column, row),
                    spread: SegmentSpread::new(spread, shape, column, row),
                    shift: shift.at(shape, (column + SEGMENT_PIXELS / 2) as f32, row),
                }
            })
            .collect();
        Ok(Self {
            shape,
            segments,
            projector: Projector::new(rig, shift.newton_steps),
            spread_variable: SpreadVariable {
                along_x: spread.along_x,
                offset: 1.0 / spread.length - 1.0,
                factor: 2.0 / spread.length,
            },
            projector_field,
        })
    }

    /// Rows and columns of the camera's frame.
    ///
    /// ```
    /// # use fringeworks::triangulate::{Lens, Rig, Spread, Triangulation};
    /// # let lens = Lens { focal: [1000.0; 2], principal: [15.5, 7.5], distortion: [0.0; 5] };
    /// # let rig = Rig {
    /// #     camera: lens,
    /// #     projector: lens,
    /// #     rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
    /// #     translation: [-100.0, 0.0, 0.0],
    /// # };
    /// # let rig = Triangulation::new(&rig, &Spread::none(true, 1024.0), (16, 32), (1024, 768))?;
    /// assert_eq!(rig.shape(), (16, 32));
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn shape(&self) -> (usize, usize) {
        self.shape
    }

    pub(super) fn projector_field(&self) -> Option<&Field> {
        self.projector_field.as_ref()
    }

    pub(super) fn spread_along_x(&self) -> bool {
        self.spread_variable.along_x
    }

    /// Segments of one row of the frame.
    #[inline(always)]
    pub(super) fn segments_of(&self, row: usize) -> &[Segment] {
        let per_row = self.shape.1.div_ceil(SEGMENT_PIXELS);
        &self.segments[row * per_row..(row + 1) * per_row]
    }
}

impl Projector {
    fn new(rig: &Rig, newton_steps: usize) -> Self {
        let single = |v: f64| v as f32;
        Self {
            focal: rig.projector.focal.map(single),
            principal: rig.projector.principal.map(single),
            distortion: rig.projector.distortion.map(single),
            rotation: rig.rotation.map(single),
            translation: rig.translation.map(single),
            newton_steps,
        }
    }
}
