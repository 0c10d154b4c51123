//! Bindings of triangulation and of ray casting.

use crate::rows::{refuse, rows_of, rows_of_mut};
use crate::threads::detached;
use fringeworks::mesh;
use fringeworks::triangulate::{self, Axis, Field, Lens, Limits, Points, Spread};
use numpy::{
    IntoPyArray, PyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2,
    PyReadwriteArray3, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A calibrated rig, and the variance of 1/z that comes from its calibration.
#[pyclass(frozen, module = "fringeworks._core")]
pub struct Triangulation {
    pub inner: triangulate::Triangulation,
}

/// Camera, projector and pose, see the kernel. Devices are focal lengths, principal point and five
/// coefficients of the distortion.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct RigItems {
    camera: [f64; 9],
    projector: [f64; 9],
    rotation: [f64; 9],
    translation: [f64; 3],
    camera_field: Option<FieldItems>,
    projector_field: Option<FieldItems>,
}

/// Correction of a device's pixels, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct FieldItems {
    first: [f64; 2],
    step: [f64; 2],
    columns: usize,
    control: Vec<f64>,
}

fn field(items: Option<FieldItems>) -> PyResult<Option<Field>> {
    items
        .map(|f| Field::new(f.first, f.step, f.columns, f.control).map_err(refuse))
        .transpose()
}

fn lens([fx, fy, cx, cy, distortion @ ..]: [f64; 9]) -> Lens {
    Lens {
        focal: [fx, fy],
        principal: [cx, cy],
        distortion,
    }
}

/// Variance of 1/z that comes from the calibration, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct SpreadItems<'py> {
    coefficients: PyReadonlyArray3<'py, f32>,
    along_x: bool,
    length: f32,
}

impl SpreadItems<'_> {
    fn spread(&self) -> PyResult<Spread> {
        let &[rows, columns, count] = self.coefficients.shape() else {
            unreachable!("the array has three axes");
        };
        if count != triangulate::SPREAD_COEFFICIENTS {
            return Err(PyValueError::new_err(format!(
                "coefficients of the spread: expected {} values, got {count}",
                triangulate::SPREAD_COEFFICIENTS
            )));
        }
        Ok(Spread {
            rows,
            columns,
            coefficients: rows_of(&self.coefficients)?.to_vec(),
            along_x: self.along_x,
            length: self.length,
        })
    }
}

/// Limits that a point must keep, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct LimitItems {
    residual_sigmas: f32,
    residual_px: f32,
}

impl From<LimitItems> for Limits {
    fn from(items: LimitItems) -> Self {
        Self {
            residual_sigmas: items.residual_sigmas,
            residual_px: items.residual_px,
        }
    }
}

/// Decoded maps along one axis.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct AxisMaps<'py> {
    coordinate: PyReadonlyArray2<'py, f32>,
    sigma: PyReadonlyArray2<'py, f32>,
    reason: PyReadonlyArray2<'py, u8>,
}

/// Arrays that points are written to.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PointMaps<'py> {
    xyz: PyReadwriteArray3<'py, f32>,
    sigma: PyReadwriteArray2<'py, f32>,
    noise: PyReadwriteArray2<'py, f32>,
    residual: Option<PyReadwriteArray2<'py, f32>>,
    reason: PyReadwriteArray2<'py, u8>,
}

impl PointMaps<'_> {
    /// The arrays as the kernels borrow them, for a camera of this shape.
    pub fn points(&mut self, expected: (usize, usize)) -> PyResult<Points<'_>> {
        let shape = (self.reason.shape()[0], self.reason.shape()[1]);
        if shape != expected {
            return Err(PyValueError::new_err(format!(
                "reason: expected shape {expected:?}, got {shape:?}"
            )));
        }
        Ok(Points {
            xyz: rows_of_mut(&mut self.xyz)?,
            sigma: rows_of_mut(&mut self.sigma)?,
            noise: rows_of_mut(&mut self.noise)?,
            residual: match &mut self.residual {
                Some(map) => rows_of_mut(map)?,
                None => &mut [],
            },
            reason: rows_of_mut(&mut self.reason)?,
        })
    }
}

/// Decoded maps as the kernel borrows them.
fn axis<'a>(maps: Option<&'a AxisMaps<'_>>) -> PyResult<Option<Axis<'a>>> {
    maps.map(|maps| {
        Ok(Axis {
            coordinate: rows_of(&maps.coordinate)?,
            sigma: rows_of(&maps.sigma)?,
            reason: rows_of(&maps.reason)?,
        })
    })
    .transpose()
}

#[pymethods]
impl Triangulation {
    #[new]
    #[pyo3(signature = (rig, spread, *, camera_shape, projector_size))]
    fn new(
        py: Python<'_>,
        rig: RigItems,
        spread: SpreadItems<'_>,
        camera_shape: (usize, usize),
        projector_size: (usize, usize),
    ) -> PyResult<Self> {
        let fields = [field(rig.camera_field)?, field(rig.projector_field)?];
        let rig = triangulate::Rig {
            camera: lens(rig.camera),
            projector: lens(rig.projector),
            rotation: rig.rotation,
            translation: rig.translation,
        };
        let spread = spread.spread()?;
        let inner = detached(py, || {
            triangulate::Triangulation::with_fields(
                &rig,
                &spread,
                camera_shape,
                projector_size,
                fields,
            )
        })?;
        Ok(Self { inner })
    }

    /// Triangulate one axis or both into the maps.
    #[pyo3(signature = (x, y, maps, *, limits))]
    fn triangulate(
        &self,
        py: Python<'_>,
        x: Option<AxisMaps<'_>>,
        y: Option<AxisMaps<'_>>,
        mut maps: PointMaps<'_>,
        limits: LimitItems,
    ) -> PyResult<()> {
        let (x, y) = (axis(x.as_ref())?, axis(y.as_ref())?);
        let out = maps.points(self.inner.shape())?;
        detached(py, || self.inner.triangulate(x, y, &limits.into(), out))
    }
}

/// Triangles that rays can be cast at, and that points have a distance from.
#[pyclass(frozen, module = "fringeworks._core")]
pub struct Triangles {
    inner: mesh::Triangles,
}

/// Distances and triangles.
type Hits<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i32>>);

#[pymethods]
impl Triangles {
    #[new]
    fn new(
        py: Python<'_>,
        vertices: PyReadonlyArray2<'_, f64>,
        faces: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<Self> {
        let (vertices, faces) = (rows_of(&vertices)?, rows_of(&faces)?);
        let inner = detached(py, || mesh::Triangles::new(vertices, faces))?;
        Ok(Self { inner })
    }

    /// Distance of every ray's first hit beyond `near` (∞ for none), and the index of the triangle that is
    /// hit (−1 for none).
    fn hit<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray2<'py, f64>,
        directions: PyReadonlyArray2<'py, f64>,
        near: f64,
    ) -> PyResult<Hits<'py>> {
        let n = directions.shape()[0];
        let (mut distance, mut face) = (vec![0.0; n], vec![0; n]);
        let (o, d) = (rows_of(&origins)?, rows_of(&directions)?);
        detached(py, || self.inner.hit(o, d, near, &mut distance, &mut face))?;
        Ok((distance.into_pyarray(py), face.into_pyarray(py)))
    }

    /// Index of the triangle that is nearest to every point; −1 where none lies within `reach`.
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        reach: f64,
    ) -> PyResult<Bound<'py, PyArray1<i32>>> {
        let mut face = vec![0; points.shape()[0]];
        let p = rows_of(&points)?;
        detached(py, || self.inner.nearest(p, reach, &mut face))?;
        Ok(face.into_pyarray(py))
    }
}
