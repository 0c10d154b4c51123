//! Binding of the test for isolated pixels.

use crate::rows::rows_of_mut;
use crate::threads::detached;
use fringeworks::isolated::mark;
use numpy::{PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

#[pyfunction]
#[pyo3(signature = (coordinate, sigma, reason, *, repeats))]
pub fn mark_isolated<'py>(
    py: Python<'py>,
    mut coordinate: PyReadwriteArray2<'py, f32>,
    mut sigma: PyReadwriteArray2<'py, f32>,
    mut reason: PyReadwriteArray2<'py, u8>,
    repeats: f32,
) -> PyResult<usize> {
    let width = coordinate.shape()[1];
    let c = rows_of_mut(&mut coordinate)?;
    let (s, r) = (rows_of_mut(&mut sigma)?, rows_of_mut(&mut reason)?);
    detached(py, || mark(c, s, r, width, repeats))
}
