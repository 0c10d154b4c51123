//! Bindings of windowed inversion.

use crate::rows::rows_of;
use crate::threads::detached;
use fringeworks::windowed::{Limits, Options, Pair, invert, warped};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Displacement, σ, modulation ratio, offset, misfit, scale, and correlation of the noise.
type Maps<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<u8>>,
    f64,
);

type Floats<'py> = PyReadonlyArray2<'py, f32>;
type Bytes<'py> = PyReadonlyArray2<'py, u8>;

/// A pair of frames whose object frame has the given shape and samples, without an albedo.
pub fn pair_of<'a>(
    (height, width): (usize, usize),
    spline: &'a Floats,
    object: &'a [f32],
    reference_ok: &'a Bytes,
    object_ok: &'a Bytes,
) -> PyResult<Pair<'a>> {
    Ok(Pair {
        height,
        width,
        spline: rows_of(spline)?,
        object,
        reference_ok: rows_of(reference_ok)?,
        object_ok: rows_of(object_ok)?,
        albedo: None,
    })
}

#[pyfunction]
#[pyo3(signature = (spline, object, reference_ok, object_ok, start, albedo=None, walls=None, *, scales, iterations, period, confidence, object_noise, reference_noise, drift, max_sigma, min_explained))]
#[allow(clippy::too_many_arguments)]
pub fn invert_windowed<'py>(
    py: Python<'py>,
    spline: PyReadonlyArray2<'py, f32>,
    object: PyReadonlyArray2<'py, f32>,
    reference_ok: PyReadonlyArray2<'py, u8>,
    object_ok: PyReadonlyArray2<'py, u8>,
    start: PyReadonlyArray2<'py, f32>,
    albedo: Option<PyReadonlyArray2<'py, f32>>,
    walls: Option<PyReadonlyArray2<'py, u8>>,
    scales: Vec<f64>,
    iterations: usize,
    period: f64,
    confidence: f64,
    object_noise: f64,
    reference_noise: f64,
    drift: f64,
    max_sigma: f64,
    min_explained: f64,
) -> PyResult<Maps<'py>> {
    let shape = (object.shape()[0], object.shape()[1]);
    let samples = rows_of(&object)?;
    let pair = Pair {
        albedo: albedo.as_ref().map(rows_of).transpose()?,
        ..pair_of(shape, &spline, samples, &reference_ok, &object_ok)?
    };
    let start = rows_of(&start)?;
    let walls = walls.as_ref().map(rows_of).transpose()?;
    let options = Options {
        scales,
        iterations,
        period,
        confidence,
        limits: Limits {
            object_noise,
            reference_noise,
            noise_correlation: 1.0,
            drift,
            max_sigma,
            min_explained,
        },
    };
    let field = detached(py, || invert(&pair, walls, start, &options))?;
    let map = |v: Vec<f32>| Array2::from_shape_vec(shape, v).expect("kernel keeps the shape");
    let scale = Array2::from_shape_vec(shape, field.scale).expect("kernel keeps the shape");
    Ok((
        map(field.displacement).into_pyarray(py),
        map(field.sigma).into_pyarray(py),
        map(field.modulation_ratio).into_pyarray(py),
        map(field.offset).into_pyarray(py),
        map(field.misfit).into_pyarray(py),
        scale.into_pyarray(py),
        field.noise_correlation,
    ))
}

/// Value and slope of the reference at x − u, 0 without data, and 1 where there is data.
type Warped<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<u8>>,
);

#[pyfunction]
pub fn warp_windowed<'py>(
    py: Python<'py>,
    spline: PyReadonlyArray2<'py, f32>,
    reference_ok: PyReadonlyArray2<'py, u8>,
    object_ok: PyReadonlyArray2<'py, u8>,
    displacement: PyReadonlyArray2<'py, f32>,
) -> PyResult<Warped<'py>> {
    let shape = (displacement.shape()[0], displacement.shape()[1]);
    let pair = pair_of(shape, &spline, &[], &reference_ok, &object_ok)?;
    let u = rows_of(&displacement)?;
    let (value, slope, known) = detached(py, || warped(&pair, u))?;
    let map = |v: Vec<f32>| Array2::from_shape_vec(shape, v).expect("kernel keeps the shape");
    let known = Array2::from_shape_vec(shape, known).expect("kernel keeps the shape");
    Ok((
        map(value).into_pyarray(py),
        map(slope).into_pyarray(py),
        known.into_pyarray(py),
    ))
}
