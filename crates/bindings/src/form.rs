//! Bindings of the fits of planes, spheres and cylinders.

use crate::rows::{Map, image_of, refuse, rows_of};
use crate::threads::detached;
use fringeworks::form::{self, Body};
use numpy::ndarray::Array;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

/// Signed distances of points from a body, see the kernel.
#[pyfunction]
pub fn form_distances<'py>(
    py: Python<'py>,
    body: &str,
    values: PyReadonlyArray1<'py, f64>,
    points: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let body = Body::new(body, rows_of(&values)?).map_err(refuse)?;
    let points = image_of(&points)?;
    let found = detached(py, || form::form_distances(body, points))?;
    Ok(found.into_pyarray(py))
}

/// Sums of the normal equations of a body's fit, see the kernel.
#[pyfunction]
pub fn form_moments<'py>(
    py: Python<'py>,
    body: &str,
    values: PyReadonlyArray1<'py, f64>,
    points: PyReadonlyArray2<'py, f64>,
    weight: PyReadonlyArray1<'py, f64>,
) -> PyResult<Map<'py, f64>> {
    let body = Body::new(body, rows_of(&values)?).map_err(refuse)?;
    let (points, weight) = (image_of(&points)?, rows_of(&weight)?);
    let sums = detached(py, || form::form_moments(body, points, weight))?;
    let side = sums.len().isqrt();
    let sums = Array::from_shape_vec((side, side), sums).expect("kernel keeps the shape");
    Ok(sums.into_pyarray(py))
}
