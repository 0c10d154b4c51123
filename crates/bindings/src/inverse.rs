//! Bindings of inverse function analysis.

use crate::moving_mean::Values;
use crate::rows::rows_of;
use crate::threads::detached;
use fringeworks::inverse::{Field, Method, Options, invert};
use fringeworks::moving_mean::Number;
use numpy::PyArray1;
use numpy::ndarray::Array2;
use numpy::{
    Element, IntoPyArray, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
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
    let options = Options {
        method: method_of(method)?,
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
    let field = match (&reference, &object) {
        (Values::Double(s), Values::Double(d)) => of_rows(py, s, d, &mask, &guide, &options)?,
        (Values::Single(s), Values::Single(d)) => of_rows(py, s, d, &mask, &guide, &options)?,
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

fn method_of(name: &str) -> PyResult<Method> {
    match name {
        "ifa" => Ok(Method::Polynomial),
        "sifa" => Ok(Method::PartSpline),
        "gsifa" => Ok(Method::GlobalSpline),
        "exact" => Ok(Method::Exact),
        other => Err(PyValueError::new_err(format!(
            "method: expected ifa, sifa, gsifa or exact, got {other:?}"
        ))),
    }
}

/// Invert frames of either precision.
fn of_rows<T: Number + Element>(
    py: Python<'_>,
    reference: &PyReadonlyArray2<'_, T>,
    object: &PyReadonlyArray2<'_, T>,
    mask: &PyReadonlyArray2<'_, u8>,
    guide: &Option<PyReadonlyArray2<'_, f32>>,
    options: &Options,
) -> PyResult<Field> {
    let width = mask.shape()[1];
    let (s, d, m) = (rows_of(reference)?, rows_of(object)?, rows_of(mask)?);
    let g = guide.as_ref().map(rows_of).transpose()?;
    detached(py, || invert(s, d, m, g, width, options))
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
