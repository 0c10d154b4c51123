//! Bindings of sums of errors.

use crate::rows::{Map, image_of, rows_of};
use crate::threads::detached;
use fringeworks::propagate::{self, Errors};
use numpy::ndarray::Array;
use numpy::{IntoPyArray, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

/// Errors of points: by_value, noise, common, blur, group.
#[derive(FromPyObject)]
pub struct ErrorArrays<'py>(
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, i64>,
);

/// Variance by noise, change by blur, and the sums of each group (groups, 4), see the kernel.
#[pyfunction]
pub fn error_sums<'py>(
    py: Python<'py>,
    errors: ErrorArrays<'py>,
    weights: PyReadonlyArray1<'py, f64>,
    directions: PyReadonlyArray2<'py, f64>,
    groups: usize,
) -> PyResult<(f64, f64, Map<'py, f64>)> {
    let errors = Errors {
        by_value: image_of(&errors.0)?,
        noise: rows_of(&errors.1)?,
        common: rows_of(&errors.2)?,
        blur: rows_of(&errors.3)?,
        group: rows_of(&errors.4)?,
    };
    let (weights, directions) = (rows_of(&weights)?, image_of(&directions)?);
    let sums = detached(py, || {
        propagate::error_sums(errors, weights, directions, groups)
    })?;
    let flat = sums.groups.into_flattened();
    let table = Array::from_shape_vec((groups, flat.len() / groups.max(1)), flat)
        .expect("four sums a group");
    Ok((sums.variance, sums.blur, table.into_pyarray(py)))
}
