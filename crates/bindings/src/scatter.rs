//! Binding of the scatter of coordinates about smooth surfaces.

use crate::rows::{rows_of, rows_of_mut};
use crate::threads::detached;
use fringeworks::scatter::{self, Limits, Scale};
use numpy::{PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

#[pyfunction]
#[pyo3(signature = (coordinate, sigma, factors, *, step, side, most, excess, shared))]
#[allow(clippy::too_many_arguments)] // Most are keywords in Python.
pub fn raise_factors(
    py: Python<'_>,
    coordinate: PyReadonlyArray2<'_, f32>,
    sigma: PyReadonlyArray2<'_, f32>,
    mut factors: PyReadwriteArray2<'_, f32>,
    step: usize,
    side: usize,
    most: f32,
    excess: f32,
    shared: f32,
) -> PyResult<()> {
    let width = coordinate.shape()[1];
    let (c, s) = (rows_of(&coordinate)?, rows_of(&sigma)?);
    let out = rows_of_mut(&mut factors)?;
    let scale = Scale { step, side };
    let limits = Limits {
        most,
        excess,
        shared,
    };
    detached(py, || {
        scatter::raise_factors(c, s, width, scale, limits, out)
    })
}
