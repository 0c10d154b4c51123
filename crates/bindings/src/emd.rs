//! Bindings of empirical mode decomposition.

use crate::rows::{Map, array_of, image_of};
use crate::threads::detached;
use fringeworks::emd::{self, Options};
use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray1, PyArray3, PyReadonlyArray2};
use pyo3::prelude::*;

/// Modes, residues, number of modes per row, and number of rows whose sifting did not converge.
type Modes<'py> = (
    Bound<'py, PyArray3<f64>>,
    Map<'py, f64>,
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
    let rows = image_of(&rows)?;
    let options = Options {
        max_imfs,
        max_sifts,
        flat,
        patience,
    };
    let out = detached(py, || emd::decompose_rows(rows, &options))?;
    let shape = (rows.height(), out.count, rows.width());
    let imfs = Array3::from_shape_vec(shape, out.imfs).expect("kernel keeps the shape");
    Ok((
        imfs.into_pyarray(py),
        array_of(py, rows.shape(), out.residue),
        out.counts.into_pyarray(py),
        out.unfinished,
    ))
}
