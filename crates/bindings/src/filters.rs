//! Bindings of the filters of images and of moving means.

use crate::rows::{Map, array_of, image_of, rows_of};
use crate::threads::detached;
use fringeworks::filters::{self, Border, Real, Weights};
use fringeworks::moving_mean::{self, Number};
use numpy::{Element, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A map in either precision.
#[derive(FromPyObject)]
pub enum Values<'py> {
    Double(PyReadonlyArray2<'py, f64>),
    Single(PyReadonlyArray2<'py, f32>),
}

/// What lies beyond the border of a map, by its name.
fn border_of(name: &str) -> PyResult<Border> {
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
        Values::Double(map) => box_means_of(py, &map, side, border),
        Values::Single(map) => box_means_of(py, &map, side, border),
    }
}

fn box_means_of<'py, T: Real + Element>(
    py: Python<'py>,
    map: &PyReadonlyArray2<'py, T>,
    side: usize,
    border: Border,
) -> PyResult<Bound<'py, PyAny>> {
    let values = image_of(map)?;
    let means = detached(py, || filters::box_means(values, side, border))?;
    Ok(array_of(py, values.shape(), means).into_any())
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
) -> PyResult<Map<'py>> {
    let border = border_of(border)?;
    let map = image_of(&values)?;
    let sums = detached(py, || {
        let weights_y = Weights::new("weights_y", &weights_y)?;
        let weights_x = Weights::new("weights_x", &weights_x)?;
        filters::weighted_sums(map, &weights_y, &weights_x, border, step)
    })?;
    let shape = (map.height().div_ceil(step), map.width().div_ceil(step));
    Ok(array_of(py, shape, sums))
}

#[pyfunction]
pub fn median_of_nine<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, f32>,
) -> PyResult<Map<'py>> {
    let map = image_of(&values)?;
    let medians = detached(py, || filters::median_of_nine(map))?;
    Ok(array_of(py, map.shape(), medians))
}

#[pyfunction]
#[pyo3(signature = (marks, *, reach))]
pub fn widen<'py>(
    py: Python<'py>,
    marks: PyReadonlyArray2<'py, bool>,
    reach: usize,
) -> PyResult<Map<'py, bool>> {
    let map = image_of(&marks)?;
    let wide = detached(py, || filters::widen(map, reach))?;
    Ok(array_of(py, map.shape(), wide))
}

#[pyfunction]
#[pyo3(signature = (values, *, rows, columns))]
pub fn area_means<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, f32>,
    rows: usize,
    columns: usize,
) -> PyResult<Map<'py>> {
    let map = image_of(&values)?;
    let means = detached(py, || filters::area_means(map, rows, columns))?;
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
    let values = image_of(map)?;
    let found = detached(py, || filters::interpolate_linear(values, rows, columns))?;
    Ok(array_of(py, (rows.len(), columns.len()), found).into_any())
}

#[pyfunction]
#[pyo3(signature = (values, *, sides_y, sides_x))]
pub fn moving_means<'py>(
    py: Python<'py>,
    values: Values<'py>,
    sides_y: Vec<usize>,
    sides_x: Vec<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    match values {
        Values::Double(map) => moving_means_of(py, &map, &sides_y, &sides_x),
        Values::Single(map) => moving_means_of(py, &map, &sides_y, &sides_x),
    }
}

fn moving_means_of<'py, T: Number + Element>(
    py: Python<'py>,
    map: &PyReadonlyArray2<'py, T>,
    sides_y: &[usize],
    sides_x: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    let values = image_of(map)?;
    let means = detached(py, || moving_mean::moving_means(values, sides_y, sides_x))?;
    Ok(array_of(py, values.shape(), means).into_any())
}
