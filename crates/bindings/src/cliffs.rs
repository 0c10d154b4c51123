//! Bindings of the search for cliffs.

use crate::rows::rows_of;
use crate::threads::detached;
use crate::windowed::pair_of;
use fringeworks::windowed::{
    Search, Surfaces, relocate_surfaces as relocate, sides, smooth_within,
};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

type Map<'py> = Bound<'py, PyArray2<f32>>;

fn surfaces_of<'a>(
    displacement: &'a PyReadonlyArray2<f32>,
    offset: &'a PyReadonlyArray2<f32>,
    gain: &'a PyReadonlyArray2<f32>,
) -> PyResult<Surfaces<'a>> {
    Ok(Surfaces {
        displacement: rows_of(displacement)?,
        offset: rows_of(offset)?,
        gain: rows_of(gain)?,
    })
}

#[pyfunction]
#[pyo3(signature = (spline, object, reference_ok, object_ok, displacement, offset, gain, *, clean, present, reach, margin, base, max_change, same))]
#[allow(clippy::too_many_arguments)]
pub fn relocate_surfaces<'py>(
    py: Python<'py>,
    spline: PyReadonlyArray2<'py, f32>,
    object: PyReadonlyArray2<'py, f32>,
    reference_ok: PyReadonlyArray2<'py, u8>,
    object_ok: PyReadonlyArray2<'py, u8>,
    displacement: PyReadonlyArray2<'py, f32>,
    offset: PyReadonlyArray2<'py, f32>,
    gain: PyReadonlyArray2<'py, f32>,
    clean: PyReadonlyArray2<'py, u8>,
    present: PyReadonlyArray2<'py, f32>,
    reach: usize,
    margin: usize,
    base: usize,
    max_change: f32,
    same: f32,
) -> PyResult<(Map<'py>, Map<'py>, Map<'py>)> {
    let shape = (object.shape()[0], object.shape()[1]);
    let samples = rows_of(&object)?;
    let pair = pair_of(shape, &spline, samples, &reference_ok, &object_ok)?;
    let surfaces = surfaces_of(&displacement, &offset, &gain)?;
    let search = Search {
        clean: rows_of(&clean)?,
        present: rows_of(&present)?,
        reach,
        margin,
        base,
        max_change,
        same,
    };
    let maps = detached(py, || relocate(&pair, &surfaces, &search))?;
    let map = |v: Vec<f32>| {
        Array2::from_shape_vec(shape, v)
            .expect("kernel keeps the shape")
            .into_pyarray(py)
    };
    Ok((map(maps.0), map(maps.1), map(maps.2)))
}

#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn wall_sides<'py>(
    py: Python<'py>,
    spline: PyReadonlyArray2<'py, f32>,
    object: PyReadonlyArray2<'py, f32>,
    reference_ok: PyReadonlyArray2<'py, u8>,
    object_ok: PyReadonlyArray2<'py, u8>,
    displacement: PyReadonlyArray2<'py, f32>,
    offset: PyReadonlyArray2<'py, f32>,
    gain: PyReadonlyArray2<'py, f32>,
    walls: PyReadonlyArray2<'py, u8>,
) -> PyResult<Bound<'py, PyArray2<i64>>> {
    let shape = (object.shape()[0], object.shape()[1]);
    let samples = rows_of(&object)?;
    let pair = pair_of(shape, &spline, samples, &reference_ok, &object_ok)?;
    let surfaces = surfaces_of(&displacement, &offset, &gain)?;
    let walls = rows_of(&walls)?;
    let found = detached(py, || sides(&pair, &surfaces, walls))?;
    Ok(Array2::from_shape_vec(shape, found)
        .expect("kernel keeps the shape")
        .into_pyarray(py))
}

#[pyfunction]
pub fn smooth_within_walls<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, f32>,
    walls: PyReadonlyArray2<'py, u8>,
    sigma: f64,
) -> PyResult<Map<'py>> {
    let shape = (values.shape()[0], values.shape()[1]);
    let (values, walls) = (rows_of(&values)?, rows_of(&walls)?);
    let found = detached(py, || smooth_within(values, walls, shape.1, sigma))?;
    Ok(Array2::from_shape_vec(shape, found)
        .expect("kernel keeps the shape")
        .into_pyarray(py))
}
