//! The values of NumPy's arrays as slices and pictures, row after row, and errors as Python's.

use fringeworks::{Image, ImageMut};
use numpy::ndarray::{Array2, Dimension};
use numpy::{
    Element, IntoPyArray, PyArray2, PyReadonlyArray, PyReadonlyArray2, PyReadwriteArray,
    PyReadwriteArray2, PyUntypedArrayMethods,
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

/// An array as a picture.
pub fn image_of<'a, T: Element>(array: &'a PyReadonlyArray2<'_, T>) -> PyResult<Image<'a, T>> {
    Image::new(rows_of(array)?, array.shape()[0], array.shape()[1]).map_err(refuse)
}

/// An array that a kernel changes, as a picture.
pub fn image_of_mut<'a, T: Element>(
    array: &'a mut PyReadwriteArray2<'_, T>,
) -> PyResult<ImageMut<'a, T>> {
    let (height, width) = (array.shape()[0], array.shape()[1]);
    ImageMut::new(rows_of_mut(array)?, height, width).map_err(refuse)
}

/// A kernel's map as an array.
pub fn array_of<T: Element>(py: Python<'_>, shape: (usize, usize), values: Vec<T>) -> Map<'_, T> {
    let map = Array2::from_shape_vec(shape, values).expect("kernel keeps the shape");
    map.into_pyarray(py)
}

/// A two-dimensional array of a kernel's floats.
pub type Map<'py, T = f32> = Bound<'py, PyArray2<T>>;

/// A kernel's error as a `ValueError`.
pub fn refuse(error: fringeworks::Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}
