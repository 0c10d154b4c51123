//! Bindings of the statistics of a sample of pixels.

use crate::decode::{Frames, planes_of, with_planes};
use crate::filters;
use crate::rows::{Map, image_of, rows_of};
use crate::threads::alone;
use fringeworks::sample::{
    self, FIT_ROWS, Lines, Model, Real, Reweighting, Ripples, Usual, Value, Wanted,
};
use numpy::ndarray::Array;
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArrayDyn,
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
type Array2<'py, T = f64> = Map<'py, T>;

/// Values as an array of rows of `width`.
fn rows<T: Element>(py: Python<'_>, values: Vec<T>, width: usize) -> PyResult<Array2<'_, T>> {
    let height = values.len() / width.max(1);
    values.into_pyarray(py).reshape([height, width])
}

#[pyfunction]
pub fn quantiles(py: Python<'_>, values: Values<'_>, shares: Vec<f64>) -> PyResult<Vec<f64>> {
    fn of<T: Value>(py: Python<'_>, values: &[T], shares: &[f64]) -> PyResult<Vec<f64>> {
        alone(py, || sample::quantiles(values, shares))
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
    alone(py, || Ok(sample::trimmed_variance(square, usual, steps)))
}

#[pyfunction]
pub fn similar_groups<'py>(
    py: Python<'py>,
    key: PyReadonlyArray1<'py, f64>,
    values: PyReadonlyArray1<'py, f64>,
    groups: usize,
) -> PyResult<(Array1<'py>, Array1<'py>)> {
    let (key, values) = (rows_of(&key)?, rows_of(&values)?);
    let (key, values) = alone(py, || sample::similar_groups(key, values, groups))?;
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
    let found = with_planes!(&planes, planes => alone(py, || sample::fit_samples(&planes, model)))?;
    let pixels = found.len() / FIT_ROWS;
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
    let marks = alone(py, || sample::fitted_inside(fitted, design, low, high))?;
    rows(py, marks, fitted[0].len())
}

#[pyfunction]
pub fn gram<'py>(py: Python<'py>, values: PyReadonlyArray2<'py, f64>) -> PyResult<Array2<'py>> {
    let image = image_of(&values)?;
    let sums = alone(py, || Ok(sample::gram(image)))?;
    rows(py, sums, image.height())
}

#[pyfunction]
pub fn second_magnitudes<'py>(
    py: Python<'py>,
    frame: filters::Values<'py>,
) -> PyResult<Bound<'py, PyAny>> {
    fn of<'py, T: Element + Real>(
        py: Python<'py>,
        frame: &PyReadonlyArray2<'py, T>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let frame = image_of(frame)?;
        let found = alone(py, || Ok(sample::second_magnitudes(frame)))?;
        Ok(rows(py, found, frame.width().max(3) - 2)?.into_any())
    }
    match &frame {
        filters::Values::Single(array) => of(py, array),
        filters::Values::Double(array) => of(py, array),
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
    let (coordinate, sigma) = (image_of(&coordinate)?, image_of(&sigma)?);
    let found = alone(py, || sample::third_chi_squares(coordinate, sigma, most))?;
    Ok(found.into_pyarray(py))
}

/// Maps of a decoded sample, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct MapItems<'py> {
    coordinate: PyReadonlyArray2<'py, f32>,
    background: PyReadonlyArray2<'py, f32>,
    used: PyReadonlyArray2<'py, bool>,
}

/// A set of steps in the sample, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct SetItems<'py> {
    phase: PyReadonlyArray2<'py, f32>,
    modulation: PyReadonlyArray2<'py, f32>,
    period: f64,
    variance: f64,
}

/// Noise of the camera, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct NoiseItems {
    read_variance: f64,
    gain: f64,
    min_modulation: f64,
}

#[pyfunction]
pub fn phase_residuals<'py>(
    py: Python<'py>,
    maps: MapItems<'py>,
    set: SetItems<'py>,
    noise: NoiseItems,
) -> PyResult<(Array1<'py>, Array1<'py>)> {
    let maps = sample::Maps {
        coordinate: rows_of(&maps.coordinate)?,
        background: rows_of(&maps.background)?,
        used: rows_of(&maps.used)?,
    };
    let set = sample::Set {
        phase: rows_of(&set.phase)?,
        modulation: rows_of(&set.modulation)?,
        period: set.period,
        variance: set.variance,
    };
    let noise = sample::Noise {
        read_variance: noise.read_variance,
        gain: noise.gain,
        min_modulation: noise.min_modulation,
    };
    let (off, variance) = alone(py, || sample::phase_residuals(maps, set, noise))?;
    Ok((off.into_pyarray(py), variance.into_pyarray(py)))
}

/// What windows are looked for, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct WantedItems {
    fringes: f64,
    least: usize,
    most: usize,
    windows: (usize, usize),
    jump: f32,
}

#[pyfunction]
pub fn smooth_windows<'py>(
    py: Python<'py>,
    turns: PyReadonlyArray2<'py, f32>,
    usable: PyReadonlyArray2<'py, bool>,
    wanted: WantedItems,
) -> PyResult<Option<(Array2<'py>, Array2<'py, i64>)>> {
    let lines = Lines {
        turns: image_of(&turns)?,
        usable: image_of(&usable)?,
    };
    let wanted = Wanted {
        fringes: wanted.fringes,
        least: wanted.least,
        most: wanted.most,
        windows: wanted.windows,
        jump: wanted.jump,
    };
    let found = alone(py, || sample::smooth_windows(lines, wanted))?;
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

fn sums_of<'py>(py: Python<'py>, sums: sample::Sums) -> PyResult<Sums<'py>> {
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
    let (phase, basis) = (image_of(&phase)?, image_of(&basis)?);
    let sums = alone(py, || sample::window_sums(phase, basis, &orders))?;
    sums_of(py, sums)
}

/// How values are weighted, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Weighting {
    fits: usize,
    least: f64,
    most: f64,
}

/// Coefficients, scatter, normal matrices and last weights, see the kernel.
#[pyfunction]
pub fn robust_fit<'py>(
    py: Python<'py>,
    design: PyReadonlyArray2<'py, f64>,
    values: PyReadonlyArray1<'py, f64>,
    certainty: PyReadonlyArray1<'py, f64>,
    how: Weighting,
) -> PyResult<(Array1<'py>, f64, Array2<'py>, Array1<'py>)> {
    let design = image_of(&design)?;
    let (values, certainty) = (rows_of(&values)?, rows_of(&certainty)?);
    let how = Reweighting {
        fits: how.fits,
        least: how.least,
        most: how.most,
    };
    let found = alone(py, || sample::robust_fit(design, values, certainty, how))?;
    Ok((
        found.coefficients.into_pyarray(py),
        found.scatter,
        rows(py, found.normals, design.height() * design.height())?,
        found.weight.into_pyarray(py),
    ))
}

/// Phases of several sets, a row each, and the orders of their ripple.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct SetWaves<'py> {
    phase: PyReadonlyArray2<'py, f64>,
    orders: Vec<Vec<usize>>,
}

#[pyfunction]
pub fn ripple_sums<'py>(
    py: Python<'py>,
    waves: SetWaves<'py>,
    values: PyReadonlyArray2<'py, f64>,
) -> PyResult<Array2<'py>> {
    let (phase, values) = (image_of(&waves.phase)?, image_of(&values)?);
    let sums = alone(py, || {
        Ripples::new(phase, &waves.orders)?.ripple_sums(values)
    })?;
    let width = sums.len().isqrt();
    rows(py, sums, width)
}

#[pyfunction]
pub fn ripple_values<'py>(
    py: Python<'py>,
    waves: SetWaves<'py>,
    coefficients: PyReadonlyArray1<'py, f64>,
) -> PyResult<Array2<'py>> {
    let (phase, coefficients) = (image_of(&waves.phase)?, rows_of(&coefficients)?);
    let values = alone(py, || {
        Ripples::new(phase, &waves.orders)?.ripple_values(coefficients)
    })?;
    rows(py, values, phase.width())
}

#[pyfunction]
pub fn ripple_scores<'py>(
    py: Python<'py>,
    waves: SetWaves<'py>,
    factors: PyReadonlyArray2<'py, f64>,
    mean: PyReadonlyArray1<'py, f64>,
    group: PyReadonlyArray1<'py, i64>,
) -> PyResult<Array2<'py>> {
    let (phase, factors) = (image_of(&waves.phase)?, image_of(&factors)?);
    let (mean, group) = (rows_of(&mean)?, rows_of(&group)?);
    let products = alone(py, || {
        Ripples::new(phase, &waves.orders)?.ripple_scores(factors, mean, group)
    })?;
    rows(py, products, mean.len())
}

#[pyfunction]
pub fn column_harmonics<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray2<'py, f32>,
    used: PyReadonlyArray2<'py, bool>,
    orders: Vec<usize>,
) -> PyResult<(Array2<'py>, Array2<'py>)> {
    let (phase, used) = (image_of(&phase)?, image_of(&used)?);
    let (columns, lines) = alone(py, || sample::column_harmonics(phase, used, &orders))?;
    Ok((
        rows(py, columns, phase.width())?,
        rows(py, lines, phase.height())?,
    ))
}
