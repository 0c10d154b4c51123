//! Bindings of the tests that neighbouring coordinates are judged by: isolated pixels, and scatter.

use crate::rows::{image_of, image_of_mut};
use crate::threads::detached;
use fringeworks::isolated::{self, Smooth};
use fringeworks::scatter;
use numpy::{PyReadonlyArray2, PyReadwriteArray2};
use pyo3::prelude::*;

/// Typical difference of neighbouring coordinates, px.
#[pyfunction]
#[pyo3(signature = (coordinate, *, repeats))]
pub fn typical_step(
    py: Python<'_>,
    coordinate: PyReadonlyArray2<'_, f32>,
    repeats: f32,
) -> PyResult<f32> {
    let coordinate = image_of(&coordinate)?;
    detached(py, || Ok(isolated::typical_step(coordinate, repeats)))
}

/// Mark isolated pixels, by the typical difference of neighbours.
#[pyfunction]
#[pyo3(signature = (coordinate, sigma, reason, *, typical, repeats))]
pub fn mark_isolated<'py>(
    py: Python<'py>,
    mut coordinate: PyReadwriteArray2<'py, f32>,
    mut sigma: PyReadwriteArray2<'py, f32>,
    mut reason: PyReadwriteArray2<'py, u8>,
    typical: f32,
    repeats: f32,
) -> PyResult<usize> {
    let coordinate = image_of_mut(&mut coordinate)?;
    let (sigma, reason) = (image_of_mut(&mut sigma)?, image_of_mut(&mut reason)?);
    let smooth = Smooth::new(typical, repeats);
    detached(py, || {
        isolated::mark_isolated(coordinate, sigma, reason, &smooth)
    })
}

/// What differences are taken and averaged over, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Scale {
    step: usize,
    side: usize,
}

/// When a difference counts, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Limits {
    most: f32,
    excess: f32,
    shared: f32,
}

#[pyfunction]
pub fn raise_factors(
    py: Python<'_>,
    coordinate: PyReadonlyArray2<'_, f32>,
    sigma: PyReadonlyArray2<'_, f32>,
    mut factors: PyReadwriteArray2<'_, f32>,
    scale: Scale,
    limits: Limits,
) -> PyResult<()> {
    let (coordinate, sigma) = (image_of(&coordinate)?, image_of(&sigma)?);
    let factors = image_of_mut(&mut factors)?;
    let scale = scatter::Scale {
        step: scale.step,
        side: scale.side,
    };
    let limits = scatter::Limits {
        most: limits.most,
        excess: limits.excess,
        shared: limits.shared,
    };
    detached(py, || {
        scatter::raise_factors(coordinate, sigma, scale, limits, factors)
    })
}
