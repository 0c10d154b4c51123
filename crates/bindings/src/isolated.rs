//! Binding of the test for isolated pixels.

use crate::refuse;
use fringeworks::isolated::mark;
use numpy::{Element, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Writable values of an array, row after row.
fn writable_rows<'a, T: Element>(array: &'a mut PyReadwriteArray2<'_, T>) -> PyResult<&'a mut [T]> {
    if !array.is_c_contiguous() {
        return Err(PyValueError::new_err(
            "expected an array contiguous by rows",
        ));
    }
    Ok(array.as_slice_mut()?)
}

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
    let c = writable_rows(&mut coordinate)?;
    let (s, r) = (writable_rows(&mut sigma)?, writable_rows(&mut reason)?);
    py.detach(|| mark(c, s, r, width, repeats)).map_err(refuse)
}
