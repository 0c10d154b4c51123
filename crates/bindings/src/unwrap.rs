use crate::refuse;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

type Maps<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray2<u32>>);

#[pyfunction]
pub fn unwrap_reliability<'py>(
    py: Python<'py>,
    phase: PyReadonlyArray2<'py, f32>,
    mask: PyReadonlyArray2<'py, u8>,
) -> PyResult<Maps<'py>> {
    let shape = (phase.shape()[0], phase.shape()[1]);
    let (p, m) = (phase.as_slice()?, mask.as_slice()?);
    let out = py
        .detach(|| fringeworks::unwrap::reliability(p, m, shape.0, shape.1))
        .map_err(refuse)?;
    let phase = Array2::from_shape_vec(shape, out.phase).expect("kernel keeps the shape");
    let region = Array2::from_shape_vec(shape, out.region).expect("kernel keeps the shape");
    Ok((phase.into_pyarray(py), region.into_pyarray(py)))
}
