//! Bindings of phase unwrapping.

use crate::rows::{array_of, rows_of};
use crate::threads::detached;
use numpy::{Complex32, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Unwrapped phase, and region of every pixel.
type Maps<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<u32>>);

#[pyfunction]
#[pyo3(signature = (phase, mask, roughness=None))]
pub fn unwrap_reliability<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray2<'py, f32>,
    mask: PyReadonlyArray2<'py, u8>,
    roughness: Option<PyReadonlyArray2<'py, f32>>,
) -> PyResult<Maps<'py>> {
    let shape = (phase.shape()[0], phase.shape()[1]);
    let (p, m) = (rows_of(&phase)?, rows_of(&mask)?);
    let r = roughness.as_ref().map(rows_of).transpose()?;
    let out = detached(py, || {
        fringeworks::unwrap::reliability(p, m, r, shape.0, shape.1)
    })?;
    Ok((
        array_of(py, shape, out.phase),
        array_of(py, shape, out.region),
    ))
}

#[pyfunction]
pub fn count_residues<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray2<'py, f32>,
    mask: PyReadonlyArray2<'py, u8>,
) -> PyResult<usize> {
    let shape = (phase.shape()[0], phase.shape()[1]);
    let (p, m) = (rows_of(&phase)?, rows_of(&mask)?);
    detached(py, || fringeworks::unwrap::residues(p, m, shape.0, shape.1))
}

#[pyfunction]
#[pyo3(signature = (phase, weight, *, sigma, reach))]
pub fn average_phasor<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray2<'py, f32>,
    weight: PyReadonlyArray2<'py, f32>,
    sigma: f32,
    reach: usize,
) -> PyResult<Bound<'py, PyArray2<Complex32>>> {
    let shape = (phase.shape()[0], phase.shape()[1]);
    let (p, w) = (rows_of(&phase)?, rows_of(&weight)?);
    let out = detached(py, || {
        fringeworks::unwrap::average(p, w, shape.0, shape.1, sigma, reach)
    })?;
    let phasors = out.into_iter().map(|[re, im]| Complex32::new(re, im));
    Ok(array_of(py, shape, phasors.collect()))
}
