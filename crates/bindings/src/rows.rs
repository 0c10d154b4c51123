//! The values of NumPy's arrays as slices, row after row, and errors as Python's.

use numpy::ndarray::{Array2, Dimension};
use numpy::{
    Element, IntoPyArray, PyArray2, PyReadonlyArray, PyReadwriteArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Refuse an array whose values do not lie in memory row after row.
///
/// The check of the numpy crate accepts a transposed array as contiguous, and would deliver its
/// columns as rows.
fn check_rows<'py>(array: &impl PyUntypedArrayMethods<'py>) -> PyResult<()> {
    if array.is_c_contiguous() {
        return Ok(());
    }
    let message = "expected an array contiguous by rows";
    Err(PyValueError::new_err(message))
}

/// The values of an array, row after row.
pub fn rows_of<'a, T: Element, D: Dimension>(
    array: &'a PyReadonlyArray<'_, T, D>,
) -> PyResult<&'a [T]> {
    check_rows(&**array)?;
    Ok(array.as_slice()?)
}

/// The values of an array that a kernel writes to, row after row.
pub fn rows_of_mut<'a, T: Element, D: Dimension>(
    array: &'a mut PyReadwriteArray<'_, T, D>,
) -> PyResult<&'a mut [T]> {
    check_rows(&***array)?;
    Ok(array.as_slice_mut()?)
}

/// A kernel's map as an array.
pub fn array_of<T: Element>(
    py: Python<'_>,
    shape: (usize, usize),
    values: Vec<T>,
) -> Bound<'_, PyArray2<T>> {
    let map = Array2::from_shape_vec(shape, values).expect("kernel keeps the shape");
    map.into_pyarray(py)
}

/// A kernel's error as a `ValueError`.
pub fn refuse(error: fringeworks::Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}
