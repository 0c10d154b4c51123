//! Python bindings of the kernels: borrow the arrays, detach from the interpreter, call the kernel and
//! return its result.

mod decode;
mod emd;
mod inverse;
mod isolated;
mod rig;
mod unwrap;
mod wavelet;
mod windowed;

use numpy::ndarray::Dimension;
use numpy::{Element, PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The values of an array, row after row.
///
/// A transposed view is refused. The check of the numpy crate accepts it as contiguous, and would
/// deliver its columns as rows.
fn rows_of<'a, T: Element, D: Dimension>(
    array: &'a PyReadonlyArray<'_, T, D>,
) -> PyResult<&'a [T]> {
    if !array.is_c_contiguous() {
        return Err(PyValueError::new_err(
            "expected an array contiguous by rows",
        ));
    }
    Ok(array.as_slice()?)
}

/// A kernel's error as a `ValueError`.
fn refuse(error: fringeworks::Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}

#[pymodule]
mod _core {
    #[pymodule_export]
    use super::decode::{decode_frames, DecodeSettings, StreamSums};
    #[pymodule_export]
    use super::emd::{decompose_rows, row_envelopes};
    #[pymodule_export]
    use super::inverse::{invert_rows, row_extrema};
    #[pymodule_export]
    use super::isolated::mark_isolated;
    #[pymodule_export]
    use super::rig::{Triangles, Triangulation};
    #[pymodule_export]
    use super::unwrap::{average_phasor, count_residues, unwrap_reliability};
    #[pymodule_export]
    use super::wavelet::wavelet_ridge_rows;
    #[pymodule_export]
    use super::windowed::invert_windowed;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(m: &Bound<'_, PyModule>) -> PyResult<()> {
        m.add("version", env!("CARGO_PKG_VERSION"))?;
        m.add("optimised", fringeworks::is_optimised())
    }
}
