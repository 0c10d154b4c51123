//! Bindings of inverse function analysis.

use crate::moving_mean::Values;
use crate::rows::rows_of;
use crate::threads::detached;
use fringeworks::inverse::{invert, Method, Options};
use numpy::ndarray::Array2;
use numpy::PyArray1;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Displacement, σ, modulation ratio and reason.
type Maps<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<u8>>,
);

#[pyfunction]
#[pyo3(signature = (reference, object, mask, *, guide=None, method, degree, n_resample, period, prominence, floor, noise, max_displacement, tolerance, albedo_tolerance))]
#[allow(clippy::too_many_arguments)]
pub fn invert_rows<'py>(
    py: Python<'py>,
    reference: Values<'py>,
    object: Values<'py>,
    mask: PyReadonlyArray2<'py, u8>,
    guide: Option<PyReadonlyArray2<'py, f32>>,
    method: &str,
    degree: usize,
    n_resample: usize,
    period: f64,
    prominence: f64,
    floor: f64,
    noise: f64,
    max_displacement: f64,
    tolerance: f64,
    albedo_tolerance: f64,
) -> PyResult<Maps<'py>> {
    let method = match method {
        "ifa" => Method::Polynomial,
        "sifa" => Method::PartSpline,
        "gsifa" => Method::GlobalSpline,
        "exact" => Method::Exact,
        other => {
            return Err(PyValueError::new_err(format!(
                "method: expected ifa, sifa, gsifa or exact, got {other:?}"
            )))
        }
    };
    let options = Options {
        method,
        degree,
        n_resample,
        period,
        prominence,
        floor,
        noise,
        max_displacement,
        tolerance,
        albedo_tolerance,
    };
    let shape = (mask.shape()[0], mask.shape()[1]);
    let m = rows_of(&mask)?;
    let g = guide.as_ref().map(rows_of).transpose()?;
    let field = match (&reference, &object) {
        (Values::Double(reference), Values::Double(object)) => {
            let (s, d) = (rows_of(reference)?, rows_of(object)?);
            detached(py, || invert(s, d, m, g, shape.1, &options))?
        }
        (Values::Single(reference), Values::Single(object)) => {
            let (s, d) = (rows_of(reference)?, rows_of(object)?);
            detached(py, || invert(s, d, m, g, shape.1, &options))?
        }
        _ => {
            let message = "reference, object: expected frames of the same precision";
            return Err(PyValueError::new_err(message));
        }
    };
    let map = |v: Vec<f32>| Array2::from_shape_vec(shape, v).expect("kernel keeps the shape");
    let displacement =
        Array2::from_shape_vec(shape, field.displacement).expect("kernel keeps the shape");
    let reason = Array2::from_shape_vec(shape, field.reason).expect("kernel keeps the shape");
    Ok((
        displacement.into_pyarray(py),
        map(field.sigma).into_pyarray(py),
        map(field.modulation_ratio).into_pyarray(py),
        reason.into_pyarray(py),
    ))
}

/// Position, value and kind (1 for a maximum) of every extremum.
type Points<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<u8>>,
);

#[pyfunction]
#[pyo3(signature = (row, *, period, prominence, floor))]
pub fn row_extrema<'py>(
    py: Python<'py>,
    row: PyReadonlyArray1<'py, f64>,
    period: f64,
    prominence: f64,
    floor: f64,
) -> PyResult<Points<'py>> {
    let values = rows_of(&row)?;
    let found = detached(py, || {
        fringeworks::inverse::row_extrema(values, period, prominence, floor)
    })?;
    let position: Vec<f64> = found.iter().map(|e| e.position).collect();
    let value: Vec<f64> = found.iter().map(|e| e.value).collect();
    let is_maximum: Vec<u8> = found.iter().map(|e| e.is_maximum as u8).collect();
    Ok((
        position.into_pyarray(py),
        value.into_pyarray(py),
        is_maximum.into_pyarray(py),
    ))
}
