//! Binding of the joint albedo.

use crate::rows::{Map, array_of, image_of};
use crate::threads::detached;
use fringeworks::albedo::{self, Options};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

/// A model of the object frame, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Model<'py> {
    value: PyReadonlyArray2<'py, f32>,
    slope: PyReadonlyArray2<'py, f32>,
    object: PyReadonlyArray2<'py, f32>,
    edge_weight: PyReadonlyArray2<'py, f32>,
    cliff: PyReadonlyArray2<'py, u8>,
}

#[pyfunction]
#[pyo3(signature = (model, *, stiffness, huber, iterations))]
pub fn joint_albedo<'py>(
    py: Python<'py>,
    model: Model<'py>,
    stiffness: f32,
    huber: f32,
    iterations: Vec<usize>,
) -> PyResult<(Map<'py>, Map<'py>)> {
    let model = albedo::Model {
        value: image_of(&model.value)?,
        slope: image_of(&model.slope)?,
        object: image_of(&model.object)?,
        edge_weight: image_of(&model.edge_weight)?,
        cliff: image_of(&model.cliff)?,
    };
    let options = Options {
        stiffness,
        huber,
        iterations,
    };
    let (albedo, correction) = detached(py, || albedo::joint_albedo(&model, &options))?;
    let map = |values| array_of(py, model.object.shape(), values);
    Ok((map(albedo), map(correction)))
}
