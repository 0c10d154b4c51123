//! Bindings of phase unwrapping and of the wavelet ridge.

use crate::rows::{Map, array_of, image_of};
use crate::threads::detached;
use fringeworks::unwrap;
use fringeworks::wavelet::{self, Options};
use numpy::{Complex32, PyReadonlyArray2};
use pyo3::prelude::*;

fn complex(phasors: Vec<[f32; 2]>) -> Vec<Complex32> {
    let pairs = phasors.into_iter();
    pairs.map(|[re, im]| Complex32::new(re, im)).collect()
}

/// Unwrapped phase, and region of every pixel.
#[pyfunction]
#[pyo3(signature = (phase, mask, roughness=None))]
pub fn unwrap_reliability<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray2<'py, f32>,
    mask: PyReadonlyArray2<'py, u8>,
    roughness: Option<PyReadonlyArray2<'py, f32>>,
) -> PyResult<(Map<'py>, Map<'py, u32>)> {
    let (phase, mask) = (image_of(&phase)?, image_of(&mask)?);
    let roughness = roughness.as_ref().map(image_of).transpose()?;
    let out = detached(py, || unwrap::unwrap_reliability(phase, mask, roughness))?;
    Ok((
        array_of(py, phase.shape(), out.phase),
        array_of(py, phase.shape(), out.region),
    ))
}

#[pyfunction]
pub fn count_residues<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray2<'py, f32>,
    mask: PyReadonlyArray2<'py, u8>,
) -> PyResult<usize> {
    let (phase, mask) = (image_of(&phase)?, image_of(&mask)?);
    detached(py, || unwrap::count_residues(phase, mask))
}

#[pyfunction]
#[pyo3(signature = (phase, weight, *, sigma, reach))]
pub fn average_phasor<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray2<'py, f32>,
    weight: PyReadonlyArray2<'py, f32>,
    sigma: f32,
    reach: usize,
) -> PyResult<Map<'py, Complex32>> {
    let (phase, weight) = (image_of(&phase)?, image_of(&weight)?);
    let out = detached(py, || unwrap::average_phasor(phase, weight, sigma, reach))?;
    Ok(array_of(py, phase.shape(), complex(out)))
}

/// Phasor and local frequency.
#[pyfunction]
#[pyo3(signature = (rows, *, frequencies, omega, smoothness))]
pub fn wavelet_ridge_rows<'py>(
    py: Python<'py>,
    rows: PyReadonlyArray2<'py, f32>,
    frequencies: Vec<f64>,
    omega: f64,
    smoothness: f64,
) -> PyResult<(Map<'py, Complex32>, Map<'py>)> {
    let rows = image_of(&rows)?;
    let options = Options {
        frequencies,
        omega,
        smoothness,
    };
    let out = detached(py, || wavelet::wavelet_ridge_rows(rows, &options))?;
    Ok((
        array_of(py, rows.shape(), complex(out.phasor)),
        array_of(py, rows.shape(), out.frequency),
    ))
}
