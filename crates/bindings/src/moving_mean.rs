//! Binding of moving means.

use crate::rows::{array_of, rows_of};
use crate::threads::detached;
use fringeworks::moving_mean::{self, Number};
use numpy::{Element, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// A map in either precision.
#[derive(FromPyObject)]
pub enum Values<'py> {
    Double(PyReadonlyArray2<'py, f64>),
    Single(PyReadonlyArray2<'py, f32>),
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
        Values::Double(map) => means_of(py, &map, &sides_y, &sides_x),
        Values::Single(map) => means_of(py, &map, &sides_y, &sides_x),
    }
}

fn means_of<'py, T: Number + Element>(
    py: Python<'py>,
    map: &PyReadonlyArray2<'py, T>,
    sides_y: &[usize],
    sides_x: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    let (height, width) = (map.shape()[0], map.shape()[1]);
    let values = rows_of(map)?;
    let means = detached(py, || {
        moving_mean::moving_means(values, width, sides_y, sides_x)
    })?;
    Ok(array_of(py, (height, width), means).into_any())
}
