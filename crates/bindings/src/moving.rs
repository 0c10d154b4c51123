//! Bindings of the fits of phase steps on surfaces that move.

use crate::rows::{Map, array_of, image_of, rows_of, rows_of_mut};
use crate::threads::detached;
use fringeworks::moving::{self, Fitted, Turned};
use fringeworks::warp;
use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// The angles of a set, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Angles<'py> {
    turned: Vec<PyReadonlyArray2<'py, f32>>,
    per_unit: f32,
    shifts: Vec<f32>,
}

impl Angles<'_> {
    fn maps(&self) -> PyResult<Vec<&[f32]>> {
        self.turned.iter().map(rows_of).collect()
    }
}

/// Background, cosine and sine of a set whose phase turns, and its squared residuals.
#[pyfunction]
pub fn fit_moving<'py>(
    py: Python<'py>,
    samples: Vec<PyReadonlyArray2<'py, f32>>,
    angles: Angles<'py>,
) -> PyResult<(Map<'py>, Map<'py>, Map<'py>, Map<'py>)> {
    let shape = samples.first().map_or((0, 0), |frame| {
        let shape = frame.shape();
        (shape[0], shape[1])
    });
    let (turned, planes) = (angles.maps()?, crate::decode::planes_of(&samples)?);
    let set = Turned {
        turned: &turned,
        per_unit: angles.per_unit,
        shifts: &angles.shifts,
    };
    let pixels = shape.0 * shape.1;
    let maps = detached(py, || {
        let mut maps = [(); 4].map(|()| vec![0.0f32; pixels]);
        let [background, cosine, sine, square] = &mut maps;
        let out = Fitted {
            background,
            cosine,
            sine,
            square,
        };
        moving::fit_moving(&planes, set, out)?;
        Ok(maps)
    })?;
    let [background, cosine, sine, square] = maps.map(|map| array_of(py, shape, map));
    Ok((background, cosine, sine, square))
}

/// Turn the samples of a set back, in place.
#[pyfunction]
pub fn turn_back<'py>(
    py: Python<'py>,
    mut samples: Vec<PyReadwriteArray2<'py, f32>>,
    angles: Angles<'py>,
    cosine: PyReadonlyArray2<'py, f32>,
    sine: PyReadonlyArray2<'py, f32>,
    kept: PyReadonlyArray2<'py, bool>,
) -> PyResult<()> {
    let turned = angles.maps()?;
    let (cosine, sine, kept) = (rows_of(&cosine)?, rows_of(&sine)?, rows_of(&kept)?);
    let mut planes: Vec<&mut [f32]> = (samples.iter_mut())
        .map(rows_of_mut)
        .collect::<PyResult<_>>()?;
    detached(py, || {
        let set = Turned {
            turned: &turned,
            per_unit: angles.per_unit,
            shifts: &angles.shifts,
        };
        moving::turn_back(&mut planes, set, cosine, sine, kept)
    })
}

/// A map as it would be `time` frames earlier, with what moves along the flow moved back.
#[pyfunction]
pub fn warp_by_flow<'py>(
    py: Python<'py>,
    values: PyReadonlyArray2<'py, f32>,
    flow: PyReadonlyArray3<'py, f32>,
    time: f32,
) -> PyResult<Map<'py>> {
    let (image, flow) = (image_of(&values)?, rows_of(&flow)?);
    let found = detached(py, || warp::warp_by_flow(image, flow, time))?;
    Ok(array_of(py, image.shape(), found))
}
