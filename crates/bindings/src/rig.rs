//! Bindings of triangulation and of ray casting.

use crate::rows::{refuse, rows_of, rows_of_mut};
use crate::threads::detached;
use fringeworks::mesh;
use fringeworks::triangulate::{self, Axis, Lens, Limits, Points, Spread};
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

fn wrong_length(name: &str, expected: usize, got: usize) -> PyErr {
    PyValueError::new_err(format!("{name}: expected {expected} values, got {got}"))
}

fn lens(values: &[f64]) -> PyResult<Lens> {
    let v: [f64; 9] = values
        .try_into()
        .map_err(|_| wrong_length("device", 9, values.len()))?;
    Ok(Lens {
        focal: [v[0], v[1]],
        principal: [v[2], v[3]],
        distortion: [v[4], v[5], v[6], v[7], v[8]],
    })
}

/// Coordinates, standard deviations and reasons of one axis.
type Maps<'py> = (
    PyReadonlyArray2<'py, f32>,
    PyReadonlyArray2<'py, f32>,
    PyReadonlyArray2<'py, u8>,
);

/// Arrays that points are written to.
#[derive(FromPyObject)]
pub struct PointMaps<'py> {
    #[pyo3(item)]
    xyz: PyReadwriteArray3<'py, f32>,
    #[pyo3(item)]
    sigma: PyReadwriteArray2<'py, f32>,
    #[pyo3(item)]
    noise: PyReadwriteArray2<'py, f32>,
    #[pyo3(item)]
    residual: Option<PyReadwriteArray2<'py, f32>>,
    #[pyo3(item)]
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
fn axis<'a>(maps: Option<&'a Maps<'_>>) -> PyResult<Option<Axis<'a>>> {
    maps.map(|(coordinate, sigma, reason)| {
        Ok(Axis {
            coordinate: rows_of(coordinate)?,
            sigma: rows_of(sigma)?,
            reason: rows_of(reason)?,
        })
    })
    .transpose()
}

#[pymethods]
impl Triangulation {
    #[new]
    #[pyo3(signature = (*, camera, projector, rotation, translation, spread, spread_along_x,
        spread_length, camera_shape, projector_size))]
    #[allow(clippy::too_many_arguments)] // All are keywords in Python.
    fn new(
        py: Python<'_>,
        camera: Vec<f64>,
        projector: Vec<f64>,
        rotation: Vec<f64>,
        translation: Vec<f64>,
        spread: PyReadonlyArray3<'_, f32>,
        spread_along_x: bool,
        spread_length: f32,
        camera_shape: (usize, usize),
        projector_size: (usize, usize),
    ) -> PyResult<Self> {
        let coefficients = spread.shape()[2];
        if coefficients != triangulate::SPREAD_COEFFICIENTS {
            let expected = triangulate::SPREAD_COEFFICIENTS;
            return Err(wrong_length(
                "coefficients of the spread",
                expected,
                coefficients,
            ));
        }
        let rig = triangulate::Rig {
            camera: lens(&camera)?,
            projector: lens(&projector)?,
            rotation: rotation
                .try_into()
                .map_err(|v: Vec<f64>| wrong_length("rotation", 9, v.len()))?,
            translation: translation
                .try_into()
                .map_err(|v: Vec<f64>| wrong_length("translation", 3, v.len()))?,
        };
        let spread = Spread {
            rows: spread.shape()[0],
            columns: spread.shape()[1],
            coefficients: rows_of(&spread)?.to_vec(),
            along_x: spread_along_x,
            length: spread_length,
        };
        let inner = detached(py, || {
            triangulate::Triangulation::new(&rig, &spread, camera_shape, projector_size)
        })?;
        Ok(Self { inner })
    }

    /// Triangulate one axis or both into the maps.
    #[pyo3(signature = (x, y, maps, *, residual_sigmas, residual_px))]
    fn run(
        &self,
        py: Python<'_>,
        x: Option<Maps<'_>>,
        y: Option<Maps<'_>>,
        mut maps: PointMaps<'_>,
        residual_sigmas: f32,
        residual_px: f32,
    ) -> PyResult<()> {
        let limits = Limits {
            residual_sigmas,
            residual_px,
        };
        let (along_x, along_y) = (axis(x.as_ref())?, axis(y.as_ref())?);
        let out = maps.points(self.inner.shape())?;
        detached(py, || {
            triangulate::triangulate(&self.inner, &limits, along_x, along_y, out)
        })
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
        vertices: PyReadonlyArray2<'_, f64>,
        faces: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<Self> {
        let inner = mesh::Triangles::new(rows_of(&vertices)?, rows_of(&faces)?).map_err(refuse)?;
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
