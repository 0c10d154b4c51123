//! Bindings of empirical mode decomposition.

use crate::rows::rows_of;
use crate::threads::detached;
use fringeworks::emd::{decompose, envelopes, Options};
use numpy::ndarray::{Array2, Array3};
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
    let residue = Array2::from_shape_vec((h, w), out.residue).expect("kernel keeps the shape");
    Ok((
        imfs.into_pyarray(py),
        residue.into_pyarray(py),
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
    let map = |v: Vec<f64>| Array2::from_shape_vec(shape, v).expect("kernel keeps the shape");
    Ok((map(upper).into_pyarray(py), map(lower).into_pyarray(py)))
}
