//! Bindings of the statistics of a sample of pixels.

use crate::decode::{Frames, planes_of, with_planes};
use crate::rows::rows_of;
use crate::threads::alone;
use fringeworks::sample::differences::Real;
use fringeworks::sample::fit::{Model, ROWS, fit, inside};
use fringeworks::sample::quantile::{self, Value};
use fringeworks::sample::residuals::{Maps, Noise, Set, of_set};
use fringeworks::sample::variance::{self, Usual};
use fringeworks::sample::windows::{Lines, Wanted, windows};
use fringeworks::sample::{differences, groups, harmonics, moments};
use numpy::ndarray::Array;
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1,
    PyReadonlyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

/// An array of floats of either precision. The usual one comes first: each type that does not fit
/// costs as much as a small kernel.
#[derive(FromPyObject)]
pub enum Values<'py> {
    Double(PyReadonlyArrayDyn<'py, f64>),
    Single(PyReadonlyArrayDyn<'py, f32>),
}

type Array1<'py, T = f64> = Bound<'py, PyArray1<T>>;
type Array2<'py, T = f64> = Bound<'py, PyArray2<T>>;

/// Values as an array of rows of `width`.
fn rows<T: Element>(py: Python<'_>, values: Vec<T>, width: usize) -> PyResult<Array2<'_, T>> {
    let height = values.len() / width.max(1);
    values.into_pyarray(py).reshape([height, width])
}

#[pyfunction]
pub fn quantiles(py: Python<'_>, values: Values<'_>, shares: Vec<f64>) -> PyResult<Vec<f64>> {
    fn of<T: Value>(py: Python<'_>, values: &[T], shares: &[f64]) -> PyResult<Vec<f64>> {
        alone(py, || quantile::quantiles(values, shares))
    }
    match &values {
        Values::Single(array) => of(py, rows_of(array)?, &shares),
        Values::Double(array) => of(py, rows_of(array)?, &shares),
    }
}

#[pyfunction]
#[pyo3(signature = (square, *, median, limit, mean, steps))]
pub fn trimmed_variance(
    py: Python<'_>,
    square: PyReadonlyArray1<'_, f64>,
    median: f64,
    limit: f64,
    mean: f64,
    steps: usize,
) -> PyResult<f64> {
    let square = rows_of(&square)?;
    let usual = Usual {
        median,
        limit,
        mean,
    };
    alone(py, || Ok(variance::trimmed_variance(square, usual, steps)))
}

#[pyfunction]
pub fn similar_groups<'py>(
    py: Python<'py>,
    key: PyReadonlyArray1<'py, f64>,
    values: PyReadonlyArray1<'py, f64>,
    groups: usize,
) -> PyResult<(Array1<'py>, Array1<'py>)> {
    let (key, values) = (rows_of(&key)?, rows_of(&values)?);
    let (key, values) = alone(py, || groups::by_key(key, values, groups))?;
    Ok((key.into_pyarray(py), values.into_pyarray(py)))
}

#[pyfunction]
pub fn fit_samples<'py>(
    py: Python<'py>,
    planes: Frames<'py>,
    design: PyReadonlyArray2<'py, f64>,
    solver: PyReadonlyArray2<'py, f64>,
) -> PyResult<Array2<'py>> {
    let model = Model {
        design: rows_of(&design)?,
        solver: rows_of(&solver)?,
    };
    let found = with_planes!(&planes, planes => alone(py, || fit(&planes, model)))?;
    let pixels = found.len() / ROWS;
    rows(py, found, pixels)
}

#[pyfunction]
#[pyo3(signature = (fitted, design, *, low, high))]
pub fn fitted_inside<'py>(
    py: Python<'py>,
    fitted: (
        PyReadonlyArray1<'py, f64>,
        PyReadonlyArray1<'py, f64>,
        PyReadonlyArray1<'py, f64>,
    ),
    design: PyReadonlyArray2<'py, f64>,
    low: f64,
    high: f64,
) -> PyResult<Array2<'py, bool>> {
    let fitted = [
        rows_of(&fitted.0)?,
        rows_of(&fitted.1)?,
        rows_of(&fitted.2)?,
    ];
    let design = rows_of(&design)?;
    let marks = alone(py, || inside(fitted, design, low, high))?;
    rows(py, marks, fitted[0].len())
}

#[pyfunction]
pub fn sample_moments<'py>(
    py: Python<'py>,
    planes: Frames<'py>,
    pixels: PyReadonlyArray1<'py, i64>,
) -> PyResult<Array2<'py>> {
    let pixels = rows_of(&pixels)?;
    let found = with_planes!(&planes, planes => alone(py, || {
        Ok((moments::moments(&moments::gather(&planes, pixels)?), planes.len()))
    }))?;
    rows(py, found.0, found.1)
}

#[pyfunction]
pub fn sample_squares<'py>(
    py: Python<'py>,
    planes: Frames<'py>,
    pixels: PyReadonlyArray1<'py, i64>,
    across: PyReadonlyArray2<'py, f64>,
) -> PyResult<Array1<'py>> {
    let (pixels, across) = (rows_of(&pixels)?, rows_of(&across)?);
    let found = with_planes!(&planes, planes => alone(py, || {
        moments::squares(&moments::gather(&planes, pixels)?, across)
    }))?;
    Ok(found.into_pyarray(py))
}

#[pyfunction]
pub fn second_magnitudes<'py>(py: Python<'py>, frame: Values<'py>) -> PyResult<Bound<'py, PyAny>> {
    fn of<'py, T: Element + Real>(
        py: Python<'py>,
        frame: &PyReadonlyArrayDyn<'py, T>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let width = frame.shape().last().copied().unwrap_or(0);
        let values = rows_of(frame)?;
        let found = alone(py, || Ok(differences::second_magnitudes(values, width)))?;
        Ok(rows(py, found, width.max(3) - 2)?.into_any())
    }
    match &frame {
        Values::Single(array) => of(py, array),
        Values::Double(array) => of(py, array),
    }
}

#[pyfunction]
#[pyo3(signature = (coordinate, sigma, *, most))]
pub fn third_chi_squares<'py>(
    py: Python<'py>,
    coordinate: PyReadonlyArray2<'py, f32>,
    sigma: PyReadonlyArray2<'py, f32>,
    most: f32,
) -> PyResult<Array1<'py, f32>> {
    let width = coordinate.shape()[1];
    let (x, sigma) = (rows_of(&coordinate)?, rows_of(&sigma)?);
    let found = alone(py, || differences::third_chi_squares(x, sigma, width, most))?;
    Ok(found.into_pyarray(py))
}

#[pyfunction]
#[pyo3(signature = (coordinate, background, used, phase, modulation, *,
    period, variance, read_variance, gain, least_modulation))]
#[allow(clippy::too_many_arguments)] // Most are keywords in Python.
pub fn phase_residuals<'py>(
    py: Python<'py>,
    coordinate: PyReadonlyArray2<'py, f32>,
    background: PyReadonlyArray2<'py, f32>,
    used: PyReadonlyArray2<'py, bool>,
    phase: PyReadonlyArray2<'py, f32>,
    modulation: PyReadonlyArray2<'py, f32>,
    period: f64,
    variance: f64,
    read_variance: f64,
    gain: f64,
    least_modulation: f64,
) -> PyResult<(Array1<'py>, Array1<'py>)> {
    let maps = Maps {
        coordinate: rows_of(&coordinate)?,
        background: rows_of(&background)?,
        used: rows_of(&used)?,
    };
    let set = Set {
        phase: rows_of(&phase)?,
        modulation: rows_of(&modulation)?,
        period,
        variance,
    };
    let noise = Noise {
        read_variance,
        gain,
        least: least_modulation,
    };
    let (off, variance) = alone(py, || of_set(maps, set, noise))?;
    Ok((off.into_pyarray(py), variance.into_pyarray(py)))
}

#[pyfunction]
#[pyo3(signature = (turns, usable, *, fringes, least, most, windows, jump))]
#[allow(clippy::too_many_arguments)] // Most are keywords in Python.
pub fn smooth_windows<'py>(
    py: Python<'py>,
    turns: PyReadonlyArray2<'py, f32>,
    usable: PyReadonlyArray2<'py, bool>,
    fringes: f64,
    least: usize,
    most: usize,
    windows: (usize, usize),
    jump: f32,
) -> PyResult<Option<(Array2<'py>, Array2<'py, i64>)>> {
    let lines = Lines {
        turns: rows_of(&turns)?,
        usable: rows_of(&usable)?,
        length: turns.shape()[1],
    };
    let wanted = Wanted {
        fringes,
        least,
        most,
        windows,
        jump,
    };
    let found = alone(py, || self::windows(lines, wanted))?;
    let Some(found) = found else {
        return Ok(None);
    };
    let n = found.length;
    Ok(Some((
        rows(py, found.phase, n)?,
        rows(py, found.pixels, n)?,
    )))
}

/// Sums of the products of functions, (fits, P, P), of functions and values, (fits, P), and of
/// squared values, (fits,).
type Sums<'py> = (Bound<'py, PyArray3<f64>>, Array2<'py>, Array1<'py>);

fn sums_of<'py>(py: Python<'py>, sums: harmonics::Sums) -> PyResult<Sums<'py>> {
    let fits = sums.power.len();
    let count = sums.projected.len() / fits.max(1);
    let normal = Array::from_shape_vec([fits, count, count], sums.normal)
        .map_err(|error| pyo3::exceptions::PyValueError::new_err(error.to_string()))?;
    Ok((
        normal.into_pyarray(py),
        rows(py, sums.projected, count)?,
        sums.power.into_pyarray(py),
    ))
}

#[pyfunction]
pub fn window_sums<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray2<'py, f64>,
    basis: PyReadonlyArray2<'py, f64>,
    orders: Vec<usize>,
) -> PyResult<Sums<'py>> {
    let length = phase.shape()[1];
    let (phase, basis) = (rows_of(&phase)?, rows_of(&basis)?);
    let sums = alone(py, || harmonics::of_windows(phase, length, basis, &orders))?;
    sums_of(py, sums)
}

#[pyfunction]
#[pyo3(signature = (phase, values, orders, *, coefficients, most))]
pub fn harmonic_sums<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray1<'py, f64>,
    values: PyReadonlyArray1<'py, f64>,
    orders: Vec<usize>,
    coefficients: Vec<f64>,
    most: f64,
) -> PyResult<Sums<'py>> {
    let (phase, values) = (rows_of(&phase)?, rows_of(&values)?);
    let sums = alone(py, || {
        harmonics::of_pixels(phase, values, &orders, &coefficients, most)
    })?;
    sums_of(py, sums)
}

#[pyfunction]
pub fn without_series<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray1<'py, f64>,
    values: PyReadonlyArray1<'py, f64>,
    orders: Vec<usize>,
    coefficients: Vec<f64>,
) -> PyResult<Array1<'py>> {
    let (phase, values) = (rows_of(&phase)?, rows_of(&values)?);
    let left = alone(py, || {
        harmonics::without_series(phase, values, &orders, &coefficients)
    })?;
    Ok(left.into_pyarray(py))
}
