//! Bindings of the fits of planes, spheres and cylinders.

use crate::rows::{Map, image_of, refuse, rows_of};
use crate::threads::detached;
use fringeworks::form::{self, Body};
use numpy::ndarray::Array;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
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

/// For each of several bodies (m, values), the distance within which a share of the points lies, see the kernel.
#[pyfunction]
pub fn form_scores<'py>(
    py: Python<'py>,
    body: &str,
    values: PyReadonlyArray2<'py, f64>,
    points: PyReadonlyArray2<'py, f64>,
    share: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let width = values.shape()[1].max(1);
    let bodies = rows_of(&values)?
        .chunks(width)
        .map(|one| Body::new(body, one))
        .collect::<Result<Vec<_>, _>>()
        .map_err(refuse)?;
    let points = image_of(&points)?;
    let found = detached(py, || form::form_scores(&bodies, points, share))?;
    Ok(found.into_pyarray(py))
}

/// Groups of near points (groups, count), see the kernel.
#[pyfunction]
pub fn near_groups<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    count: usize,
    groups: usize,
    reach: f64,
    seed: u64,
) -> PyResult<Map<'py, u32>> {
    let points = image_of(&points)?;
    let found = detached(py, || form::near_groups(points, count, groups, reach, seed))?;
    let found = Array::from_shape_vec((found.len() / count, count), found).expect("whole groups");
    Ok(found.into_pyarray(py))
}
