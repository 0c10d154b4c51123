//! Python face of the kernels: borrow the arrays, detach from the interpreter, call, hand back.

mod inverse;
mod unwrap;
mod wavelet;
mod windowed;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

fn refuse(error: fringeworks::Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}

#[pymodule]
mod _core {
    #[pymodule_export]
    use super::inverse::{invert_rows, row_extrema};
    #[pymodule_export]
    use super::unwrap::{average_phasor, count_residues, unwrap_reliability};
    #[pymodule_export]
    use super::wavelet::wavelet_ridge_rows;
    #[pymodule_export]
    use super::windowed::invert_windowed;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(m: &Bound<'_, PyModule>) -> PyResult<()> {
        m.add("optimised", fringeworks::is_optimised())
    }
}
