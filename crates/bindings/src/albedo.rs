//! Bindings of the joint albedo.

use crate::rows::{array_of, rows_of};
use crate::threads::detached;
use fringeworks::albedo::{Model, Options, solve};
use numpy::{PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

type Maps<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<f32>>);

#[pyfunction]
#[pyo3(signature = (value, slope, object, edge_weight, cliff, *, stiffness, huber, iterations))]
#[allow(clippy::too_many_arguments)]
pub fn joint_albedo<'py>(
    py: Python<'py>,
    value: PyReadonlyArray2<'py, f32>,
    slope: PyReadonlyArray2<'py, f32>,
    object: PyReadonlyArray2<'py, f32>,
    edge_weight: PyReadonlyArray2<'py, f32>,
    cliff: PyReadonlyArray2<'py, u8>,
    stiffness: f32,
    huber: f32,
    iterations: Vec<usize>,
) -> PyResult<Maps<'py>> {
    let shape = (object.shape()[0], object.shape()[1]);
    let model = Model {
        height: shape.0,
        width: shape.1,
        value: rows_of(&value)?,
        slope: rows_of(&slope)?,
        object: rows_of(&object)?,
        edge_weight: rows_of(&edge_weight)?,
        cliff: rows_of(&cliff)?,
    };
    let options = Options {
        stiffness,
        huber,
        iterations,
    };
    let (albedo, correction) = detached(py, || solve(&model, &options))?;
    Ok((array_of(py, shape, albedo), array_of(py, shape, correction)))
}
