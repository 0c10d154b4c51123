//! Bindings of the tests that neighbouring pixels are judged by: isolated ones, scatter, residuals.

use crate::decode::{Frames, planes_of, with_planes};
use crate::rows::{image_of, image_of_mut, rows_of, rows_of_mut};
use crate::threads::detached;
use fringeworks::isolated::{self, Smooth};
use fringeworks::residual_chi::{self, Judged, Totals};
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

/// What the frames of a set show, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Shown<'py> {
    design: PyReadonlyArray2<'py, f32>,
    solver: PyReadonlyArray2<'py, f32>,
    harmonics: PyReadonlyArray2<'py, f32>,
    orders: Vec<u32>,
}

/// Variances of samples and limits on them, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Scatter {
    dark: f32,
    gain: f32,
    floor: f32,
    saturation: f32,
    most: f32,
}

/// Add the χ² of the residuals of a set to sums of it and of its degrees of freedom.
#[pyfunction]
pub fn add_residual_chi<'py>(
    py: Python<'py>,
    planes: Frames<'py>,
    shown: Shown<'py>,
    scatter: Scatter,
    lit: PyReadonlyArray2<'py, bool>,
    sums: (PyReadwriteArray2<'py, f32>, PyReadwriteArray2<'py, f32>),
) -> PyResult<()> {
    let (mut square, mut freedom) = sums;
    let judged = Judged {
        design: rows_of(&shown.design)?,
        solver: rows_of(&shown.solver)?,
        harmonics: rows_of(&shown.harmonics)?,
        orders: &shown.orders,
        dark: scatter.dark,
        gain: scatter.gain,
        floor: scatter.floor,
        saturation: scatter.saturation,
        most: scatter.most,
    };
    let totals = Totals {
        lit: rows_of(&lit)?,
        square: rows_of_mut(&mut square)?,
        freedom: rows_of_mut(&mut freedom)?,
    };
    with_planes!(&planes, planes => {
        detached(py, || residual_chi::add_residual_chi(&planes, judged, totals))
    })
}
