//! Bindings of the errors of coordinates beside edges.

use crate::rows::{image_of, image_of_mut};
use crate::threads::detached;
use fringeworks::edges;
use numpy::{PyReadonlyArray2, PyReadwriteArray2};
use pyo3::prelude::*;

/// What the coordinates of neighbours are judged by, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Steps {
    most: f32,
    repeats: f32,
}

impl From<Steps> for edges::Steps {
    fn from(steps: Steps) -> Self {
        Self {
            most: steps.most,
            repeats: steps.repeats,
        }
    }
}

/// Maps of a pair of lights, see the kernel: logarithms, and the shifts that come of them.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Lights<'py> {
    modulation: PyReadonlyArray2<'py, f32>,
    background: PyReadonlyArray2<'py, f32>,
    shift: PyReadwriteArray2<'py, f32>,
    told: PyReadwriteArray2<'py, f32>,
    faint: f32,
}

/// Shift of every coordinate by blur of one px², by modulation and by background, and its squared slope.
#[pyfunction]
pub fn blur_shift(
    py: Python<'_>,
    coordinate: PyReadonlyArray2<'_, f32>,
    sigma: PyReadonlyArray2<'_, f32>,
    mut lights: Lights<'_>,
    steps: Steps,
    mut slope: PyReadwriteArray2<'_, f32>,
) -> PyResult<()> {
    let (coordinate, sigma) = (image_of(&coordinate)?, image_of(&sigma)?);
    let by_modulation = edges::Light {
        light: image_of(&lights.modulation)?,
        shift: image_of_mut(&mut lights.shift)?,
    };
    let by_background = edges::Light {
        light: image_of(&lights.background)?,
        shift: image_of_mut(&mut lights.told)?,
    };
    let slope = image_of_mut(&mut slope)?;
    let limits = (steps.into(), lights.faint);
    detached(py, || {
        edges::blur_shift(
            coordinate,
            sigma,
            [by_modulation, by_background],
            limits,
            slope,
        )
    })
}

/// Distances from depth steps, and the number, sum and squares of the errors at every distance.
#[pyfunction]
pub fn edge_rings(
    py: Python<'_>,
    coordinate: PyReadonlyArray2<'_, f32>,
    sigma: PyReadonlyArray2<'_, f32>,
    steps: Steps,
    mut rings: PyReadwriteArray2<'_, u8>,
) -> PyResult<Vec<(f64, f64, f64)>> {
    let (coordinate, sigma) = (image_of(&coordinate)?, image_of(&sigma)?);
    let rings = image_of_mut(&mut rings)?;
    let found = detached(py, || {
        edges::edge_rings(coordinate, sigma, steps.into(), rings)
    })?;
    Ok(found.map(|r| (r.count, r.sum, r.squares)).into())
}
