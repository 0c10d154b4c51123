//! Bindings of the filters of images.

use crate::moving_mean::Values;
use crate::rows::{array_of, rows_of};
use crate::threads::detached;
use fringeworks::filters::{self, Border, Real, Weights};
use numpy::PyUntypedArrayMethods;
use numpy::{Element, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// What lies beyond the border of a map, by its name.
pub fn border_of(name: &str) -> PyResult<Border> {
    match name {
        "edge" => Ok(Border::Edge),
        "mirror" => Ok(Border::Mirror),
        "zero" => Ok(Border::Zero),
        _ => Err(PyValueError::new_err(format!(
            "border: expected \"edge\", \"mirror\" or \"zero\", got {name:?}"
        ))),
    }
}

#[pyfunction]
#[pyo3(signature = (values, *, side, border="edge"))]
pub fn box_means<'py>(
    py: Python<'py>,
    values: Values<'py>,
    side: usize,
    border: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let border = border_of(border)?;
    match values {
        Values::Double(map) => means_of(py, &map, side, border),
        Values::Single(map) => means_of(py, &map, side, border),
    }
}

fn means_of<'py, T: Real + Element>(
    py: Python<'py>,
    map: &PyReadonlyArray2<'py, T>,
    side: usize,
    border: Border,
) -> PyResult<Bound<'py, PyAny>> {
    let shape = (map.shape()[0], map.shape()[1]);
    let values = rows_of(map)?;
    let means = detached(py, || filters::box_means(values, shape.1, side, border))?;
    Ok(array_of(py, shape, means).into_any())
}

#[pyfunction]
#[pyo3(signature = (values, *, weights_y, weights_x, border="edge", step=1))]
pub fn weighted_sums<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, f32>,
    weights_y: Vec<f64>,
    weights_x: Vec<f64>,
    border: &str,
    step: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let border = border_of(border)?;
    let (height, width) = (values.shape()[0], values.shape()[1]);
    let map = rows_of(&values)?;
    let sums = detached(py, || {
        let along_y = Weights::new("weights_y", &weights_y)?;
        let along_x = Weights::new("weights_x", &weights_x)?;
        filters::weighted_sums(map, width, &along_y, &along_x, border, step)
    })?;
    let shape = (height.div_ceil(step), width.div_ceil(step));
    Ok(array_of(py, shape, sums))
}

#[pyfunction]
pub fn median_of_nine<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, f32>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let shape = (values.shape()[0], values.shape()[1]);
    let map = rows_of(&values)?;
    let medians = detached(py, || filters::median_of_nine(map, shape.1))?;
    Ok(array_of(py, shape, medians))
}

#[pyfunction]
#[pyo3(signature = (marks, *, reach))]
pub fn widen<'py>(
    py: Python<'py>,
    marks: PyReadonlyArray2<'py, bool>,
    reach: usize,
) -> PyResult<Bound<'py, PyArray2<bool>>> {
    let shape = (marks.shape()[0], marks.shape()[1]);
    let map = rows_of(&marks)?;
    let wide = detached(py, || filters::widen(map, shape.1, reach))?;
    Ok(array_of(py, shape, wide))
}

#[pyfunction]
#[pyo3(signature = (values, *, rows, columns))]
pub fn area_means<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, f32>,
    rows: usize,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let width = values.shape()[1];
    let map = rows_of(&values)?;
    let means = detached(py, || filters::area_means(map, width, (rows, columns)))?;
    Ok(array_of(py, (rows, columns), means))
}

#[pyfunction]
#[pyo3(signature = (values, *, rows, columns))]
pub fn interpolate_linear<'py>(
    py: Python<'py>,
    values: Values<'py>,
    rows: PyReadonlyArray1<'py, f64>,
    columns: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let (rows, columns) = (rows_of(&rows)?, rows_of(&columns)?);
    match values {
        Values::Double(map) => interpolated(py, &map, rows, columns),
        Values::Single(map) => interpolated(py, &map, rows, columns),
    }
}

fn interpolated<'py, T: Real + Element>(
    py: Python<'py>,
    map: &PyReadonlyArray2<'py, T>,
    rows: &[f64],
    columns: &[f64],
) -> PyResult<Bound<'py, PyAny>> {
    let width = map.shape()[1];
    let values = rows_of(map)?;
    let found = detached(py, || filters::interpolate(values, width, rows, columns))?;
    Ok(array_of(py, (rows.len(), columns.len()), found).into_any())
}
