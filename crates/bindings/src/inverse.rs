//! Bindings of inverse function analysis.

use crate::filters::Values;
use crate::rows::{Map, array_of, image_of, rows_of};
use crate::threads::detached;
use fringeworks::inverse::{self, Field, Method, Options};
use fringeworks::moving_mean::Number;
use numpy::{Element, IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// How rows are inverted, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct OptionItems {
    method: String,
    degree: usize,
    n_resample: usize,
    period: f64,
    prominence: f64,
    floor: f64,
    noise: f64,
    max_displacement: f64,
    tolerance: f64,
    albedo_tolerance: f64,
}

impl OptionItems {
    fn options(&self) -> PyResult<Options> {
        Ok(Options {
            method: method_of(&self.method)?,
            degree: self.degree,
            n_resample: self.n_resample,
            period: self.period,
            prominence: self.prominence,
            floor: self.floor,
            noise: self.noise,
            max_displacement: self.max_displacement,
            tolerance: self.tolerance,
            albedo_tolerance: self.albedo_tolerance,
        })
    }
}

fn method_of(name: &str) -> PyResult<Method> {
    match name {
        "ifa" => Ok(Method::Ifa),
        "sifa" => Ok(Method::Sifa),
        "gsifa" => Ok(Method::Gsifa),
        "exact" => Ok(Method::Exact),
        other => Err(PyValueError::new_err(format!(
            "method: expected ifa, sifa, gsifa or exact, got {other:?}"
        ))),
    }
}

#[pyfunction]
#[pyo3(signature = (reference, object, mask, options, guide=None))]
pub fn invert_rows<'py>(
    py: Python<'py>,
    reference: Values<'py>,
    object: Values<'py>,
    mask: PyReadonlyArray2<'py, u8>,
    options: OptionItems,
    guide: Option<PyReadonlyArray2<'py, f32>>,
) -> PyResult<(Map<'py, f64>, Map<'py>, Map<'py>, Map<'py, u8>)> {
    let options = options.options()?;
    let field = match (&reference, &object) {
        (Values::Double(s), Values::Double(d)) => of_rows(py, s, d, &mask, &guide, &options)?,
        (Values::Single(s), Values::Single(d)) => of_rows(py, s, d, &mask, &guide, &options)?,
        _ => {
            let message = "reference, object: expected frames of the same precision";
            return Err(PyValueError::new_err(message));
        }
    };
    let shape = image_of(&mask)?.shape();
    let reason = field.reason.into_iter().map(u8::from).collect();
    Ok((
        array_of(py, shape, field.displacement),
        array_of(py, shape, field.sigma),
        array_of(py, shape, field.modulation_ratio),
        array_of(py, shape, reason),
    ))
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
    let (s, d, mask) = (image_of(reference)?, image_of(object)?, image_of(mask)?);
    let guide = guide.as_ref().map(image_of).transpose()?;
    detached(py, || inverse::invert_rows(s, d, mask, guide, options))
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
        inverse::row_extrema(values, period, prominence, floor)
    })?;
    let position: Vec<f64> = found.iter().map(|e| e.position).collect();
    let value: Vec<f64> = found.iter().map(|e| e.value).collect();
    let is_maximum: Vec<u8> = found.iter().map(|e| u8::from(e.is_maximum)).collect();
    Ok((
        position.into_pyarray(py),
        value.into_pyarray(py),
        is_maximum.into_pyarray(py),
    ))
}
