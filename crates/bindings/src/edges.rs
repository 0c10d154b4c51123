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

/// Shift of every coordinate by blur of one px², and its squared slope.
#[pyfunction]
pub fn blur_shift(
    py: Python<'_>,
    coordinate: PyReadonlyArray2<'_, f32>,
    sigma: PyReadonlyArray2<'_, f32>,
    light: PyReadonlyArray2<'_, f32>,
    steps: Steps,
    mut shift: PyReadwriteArray2<'_, f32>,
    mut slope: PyReadwriteArray2<'_, f32>,
) -> PyResult<()> {
    let (coordinate, sigma) = (image_of(&coordinate)?, image_of(&sigma)?);
    let light = image_of(&light)?;
    let (shift, slope) = (image_of_mut(&mut shift)?, image_of_mut(&mut slope)?);
    detached(py, || {
        edges::blur_shift(coordinate, sigma, light, steps.into(), shift, slope)
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
