//! Binding of the test for isolated pixels.

use crate::rows::{rows_of, rows_of_mut};
use crate::threads::detached;
use fringeworks::isolated::{self, Smooth};
use numpy::{PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Typical difference of neighbouring coordinates, px.
#[pyfunction]
#[pyo3(signature = (coordinate, *, repeats))]
pub fn typical_step(
    py: Python<'_>,
    coordinate: PyReadonlyArray2<'_, f32>,
    repeats: f32,
) -> PyResult<f32> {
    let width = coordinate.shape()[1];
    let c = rows_of(&coordinate)?;
    detached(py, || Ok(isolated::typical_step(c, width, repeats)))
}

/// Mark isolated pixels, by the typical difference of neighbours.
#[pyfunction]
#[pyo3(signature = (coordinate, sigma, reason, *, typical, repeats))]
pub fn mark_isolated<'py>(
    py: Python<'py>,
    mut coordinate: PyReadwriteArray2<'py, f32>,
    mut sigma: PyReadwriteArray2<'py, f32>,
    mut reason: PyReadwriteArray2<'py, u8>,
    typical: f32,
    repeats: f32,
) -> PyResult<usize> {
    let width = coordinate.shape()[1];
    let c = rows_of_mut(&mut coordinate)?;
    let (s, r) = (rows_of_mut(&mut sigma)?, rows_of_mut(&mut reason)?);
    let smooth = Smooth::new(typical, repeats);
    detached(py, || isolated::mark(c, s, r, width, &smooth))
}
