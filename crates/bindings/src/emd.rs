//! Bindings of empirical mode decomposition.

use crate::rows::{array_of, rows_of};
use crate::threads::detached;
use fringeworks::emd::{Options, decompose, envelopes};
use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Modes, residues, number of modes per row, and number of rows whose sifting did not converge.
type Modes<'py> = (
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<u32>>,
    usize,
);

#[pyfunction]
#[pyo3(signature = (rows, *, max_imfs, max_sifts, flat, patience))]
pub fn decompose_rows<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
    max_imfs: usize,
    max_sifts: usize,
    flat: f64,
    patience: usize,
) -> PyResult<Modes<'py>> {
    let (h, w) = (rows.shape()[0], rows.shape()[1]);
    let values = rows_of(&rows)?;
    let options = Options {
        max_imfs,
        max_sifts,
        flat,
        patience,
    };
    let out = detached(py, || decompose(values, w, &options))?;
    let imfs = Array3::from_shape_vec((h, out.count, w), out.imfs).expect("kernel keeps the shape");
    Ok((
        imfs.into_pyarray(py),
        array_of(py, (h, w), out.residue),
        out.counts.into_pyarray(py),
        out.unfinished,
    ))
}

/// Upper and lower envelopes.
type Lines<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

#[pyfunction]
pub fn row_envelopes<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f64>,
) -> PyResult<Lines<'py>> {
    let shape = (rows.shape()[0], rows.shape()[1]);
    let values = rows_of(&rows)?;
    let (upper, lower) = detached(py, || envelopes(values, shape.1))?;
    Ok((array_of(py, shape, upper), array_of(py, shape, lower)))
}
