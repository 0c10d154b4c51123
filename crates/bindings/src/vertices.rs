//! Binding of the kernel that packs points as files hold them.

use crate::rows::image_of;
use crate::threads::alone;
use fringeworks::vertices::{self, Cloud, Shade};
use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

/// The measured points as bytes, see the kernel.
#[pyfunction]
#[pyo3(signature = (xyz, sigma, noise, reason, shade=None, *, scale=1.0))]
pub fn pack_vertices<'py>(
    py: Python<'py>,
    xyz: PyReadonlyArray2<'py, f32>,
    sigma: PyReadonlyArray2<'py, f32>,
    noise: PyReadonlyArray2<'py, f32>,
    reason: PyReadonlyArray2<'py, u8>,
    shade: Option<PyReadonlyArray2<'py, f32>>,
    scale: f64,
) -> PyResult<Bound<'py, PyArray1<u8>>> {
    let cloud = Cloud {
        xyz: image_of(&xyz)?,
        sigma: image_of(&sigma)?,
        noise: image_of(&noise)?,
        reason: image_of(&reason)?,
    };
    let values = shade.as_ref().map(image_of).transpose()?;
    let shade = values.map(|values| Shade { values, scale });
    let bytes = alone(py, || vertices::pack_vertices(cloud, shade))?;
    Ok(PyArray1::from_vec(py, bytes))
}
