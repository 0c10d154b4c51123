//! Bindings of the votes of neighbours on fringe orders.

use crate::decode::DecodeSettings;
use crate::rows::{image_of, image_of_mut};
use crate::threads::detached;
use fringeworks::Image;
use fringeworks::vote::{self, Measured};
use numpy::{PyReadonlyArray2, PyReadwriteArray2};
use pyo3::prelude::*;

/// Maps that votes read and change.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Maps<'py> {
    coordinate: PyReadwriteArray2<'py, f32>,
    sigma: PyReadwriteArray2<'py, f32>,
    reason: PyReadwriteArray2<'py, u8>,
    phases: Vec<PyReadonlyArray2<'py, f32>>,
    variances: Vec<PyReadonlyArray2<'py, f32>>,
}

/// When a vote counts, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Rules {
    radius: usize,
    error_rate: f32,
    near_error_rate: f32,
    largest_misfit: f32,
    own_doubt: f32,
    usual_misfit: [f32; 2],
}

/// Maps that the cells of neighbours decide.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct CellMaps<'py> {
    coordinate: PyReadwriteArray2<'py, f32>,
    sigma: PyReadwriteArray2<'py, f32>,
    reason: PyReadwriteArray2<'py, u8>,
    phases: [PyReadonlyArray2<'py, f32>; 1],
    variances: [PyReadonlyArray2<'py, f32>; 1],
    cells: [PyReadonlyArray2<'py, f32>; 2],
}

/// When the cells of neighbours decide, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct CellRules {
    radius: usize,
    ahead: usize,
    others: f32,
    continued: f32,
}

/// Decide ambiguous fringe orders by the cells of neighbours; returns the number of changed pixels.
#[pyfunction]
pub fn vote_cells(
    py: Python<'_>,
    settings: &DecodeSettings,
    mut maps: CellMaps<'_>,
    rules: CellRules,
) -> PyResult<usize> {
    let [phase, variance] = [&maps.phases[0], &maps.variances[0]];
    let phase = (image_of(phase)?, image_of(variance)?);
    let cells = vote::Cells {
        middle: image_of(&maps.cells[0])?,
        half_width: image_of(&maps.cells[1])?,
    };
    let out = Measured {
        coordinate: image_of_mut(&mut maps.coordinate)?,
        sigma: image_of_mut(&mut maps.sigma)?,
        reason: image_of_mut(&mut maps.reason)?,
    };
    let rules = vote::CellRules {
        radius: rules.radius,
        ahead: rules.ahead,
        others: rules.others,
        continued: rules.continued,
    };
    let settings = &settings.inner;
    detached(py, || {
        vote::vote_cells(settings, phase, &cells, &rules, out)
    })
}

/// Let neighbours vote on the fringe orders of ambiguous pixels; returns the number of changed pixels.
#[pyfunction]
pub fn vote_orders(
    py: Python<'_>,
    settings: &DecodeSettings,
    mut maps: Maps<'_>,
    rules: Rules,
) -> PyResult<usize> {
    let phases: Vec<Image<f32>> = maps.phases.iter().map(image_of).collect::<PyResult<_>>()?;
    let variances: Vec<Image<f32>> = maps
        .variances
        .iter()
        .map(image_of)
        .collect::<PyResult<_>>()?;
    let out = Measured {
        coordinate: image_of_mut(&mut maps.coordinate)?,
        sigma: image_of_mut(&mut maps.sigma)?,
        reason: image_of_mut(&mut maps.reason)?,
    };
    let rules = vote::Rules {
        radius: rules.radius,
        error_rate: rules.error_rate,
        near_error_rate: rules.near_error_rate,
        largest_misfit: rules.largest_misfit,
        own_doubt: rules.own_doubt,
        usual_misfit: rules.usual_misfit,
    };
    let settings = &settings.inner;
    detached(py, || {
        vote::vote_orders(settings, &phases, &variances, &rules, out)
    })
}
