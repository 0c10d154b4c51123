//! Bindings of the wavelet ridge.

use crate::rows::{array_of, rows_of};
use crate::threads::detached;
use fringeworks::wavelet::{Options, ridge};
use numpy::{Complex32, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Phasor and local frequency.
type Maps<'py> = (Bound<'py, PyArray2<Complex32>>, Bound<'py, PyArray2<f32>>);

#[pyfunction]
#[pyo3(signature = (rows, *, frequencies, omega, smoothness))]
pub fn wavelet_ridge_rows<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f32>,
    frequencies: Vec<f64>,
    omega: f64,
    smoothness: f64,
) -> PyResult<Maps<'py>> {
    let shape = (rows.shape()[0], rows.shape()[1]);
    let values = rows_of(&rows)?;
    let options = Options {
        frequencies,
        omega,
        smoothness,
    };
    let out = detached(py, || ridge(values, shape.1, &options))?;
    let phasors = out
        .phasor
        .into_iter()
        .map(|[re, im]| Complex32::new(re, im));
    Ok((
        array_of(py, shape, phasors.collect()),
        array_of(py, shape, out.frequency),
    ))
}
