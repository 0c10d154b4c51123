//! Bindings of windowed inversion and of the search for cliffs.

use crate::rows::{Map, array_of, image_of};
use crate::threads::detached;
use fringeworks::windowed::{self, Limits, Options, Search, Surfaces};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

type Floats<'py> = PyReadonlyArray2<'py, f32>;
type Bytes<'py> = PyReadonlyArray2<'py, u8>;

/// A pair of frames, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PairItems<'py> {
    spline: Floats<'py>,
    object: Floats<'py>,
    reference_ok: Bytes<'py>,
    object_ok: Bytes<'py>,
    albedo: Option<Floats<'py>>,
}

impl PairItems<'_> {
    fn pair(&self) -> PyResult<windowed::Pair<'_>> {
        Ok(windowed::Pair {
            spline: image_of(&self.spline)?,
            object: image_of(&self.object)?,
            reference_ok: image_of(&self.reference_ok)?,
            object_ok: image_of(&self.object_ok)?,
            albedo: self.albedo.as_ref().map(image_of).transpose()?,
        })
    }
}

/// How the displacement is refined, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct OptionItems {
    scales: Vec<f64>,
    iterations: usize,
    period: f64,
    confidence: f64,
    limits: LimitItems,
}

#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct LimitItems {
    object_noise: f64,
    reference_noise: f64,
    reference_left: f64,
    drift: f64,
    max_sigma: f64,
    min_explained: f64,
}

impl From<OptionItems> for Options {
    fn from(items: OptionItems) -> Self {
        Self {
            scales: items.scales,
            iterations: items.iterations,
            period: items.period,
            confidence: items.confidence,
            limits: Limits {
                object_noise: items.limits.object_noise,
                reference_noise: items.limits.reference_noise,
                reference_left: items.limits.reference_left,
                noise_correlation: 1.0,
                drift: items.limits.drift,
                max_sigma: items.limits.max_sigma,
                min_explained: items.limits.min_explained,
            },
        }
    }
}

/// Displacement, σ, modulation ratio, offset, misfit, difference from finer windows, scale, and
/// correlation of the noise.
type Field<'py> = (
    Map<'py>,
    Map<'py>,
    Map<'py>,
    Map<'py>,
    Map<'py>,
    Map<'py>,
    Map<'py, u8>,
    f64,
);

#[pyfunction]
#[pyo3(signature = (pair, start, options, walls=None))]
pub fn invert_windowed<'py>(
    py: Python<'py>,
    pair: PairItems<'py>,
    start: Floats<'py>,
    options: OptionItems,
    walls: Option<Bytes<'py>>,
) -> PyResult<Field<'py>> {
    let (pair, start, options) = (pair.pair()?, image_of(&start)?, options.into());
    let walls = walls.as_ref().map(image_of).transpose()?;
    let field = detached(py, || {
        windowed::invert_windowed(&pair, walls, start, &options)
    })?;
    let shape = pair.object.shape();
    let map = |values| array_of(py, shape, values);
    Ok((
        map(field.displacement),
        map(field.sigma),
        map(field.modulation_ratio),
        map(field.offset),
        map(field.misfit),
        map(field.unlike_finer),
        array_of(py, shape, field.scale),
        field.noise_correlation,
    ))
}

#[pyfunction]
pub fn warp_windowed<'py>(
    py: Python<'py>,
    pair: PairItems<'py>,
    displacement: Floats<'py>,
) -> PyResult<(Map<'py>, Map<'py>, Map<'py, u8>)> {
    let (pair, u) = (pair.pair()?, image_of(&displacement)?);
    let (value, slope, known) = detached(py, || windowed::warp_windowed(&pair, u))?;
    Ok((
        array_of(py, u.shape(), value),
        array_of(py, u.shape(), slope),
        array_of(py, u.shape(), known),
    ))
}

/// A model of the object frame, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct SurfaceItems<'py> {
    displacement: Floats<'py>,
    offset: Floats<'py>,
    gain: Floats<'py>,
}

impl SurfaceItems<'_> {
    fn surfaces(&self) -> PyResult<Surfaces<'_>> {
        Ok(Surfaces {
            displacement: image_of(&self.displacement)?,
            offset: image_of(&self.offset)?,
            gain: image_of(&self.gain)?,
        })
    }
}

/// Where surfaces are searched, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct SearchItems<'py> {
    clean: Bytes<'py>,
    present: Floats<'py>,
    reach: usize,
    margin: usize,
    base: usize,
    max_change: f32,
    same: f32,
}

#[pyfunction]
pub fn relocate_surfaces<'py>(
    py: Python<'py>,
    pair: PairItems<'py>,
    surfaces: SurfaceItems<'py>,
    search: SearchItems<'py>,
) -> PyResult<(Map<'py>, Map<'py>, Map<'py>)> {
    let (pair, surfaces) = (pair.pair()?, surfaces.surfaces()?);
    let search = Search {
        clean: image_of(&search.clean)?,
        present: image_of(&search.present)?,
        reach: search.reach,
        margin: search.margin,
        base: search.base,
        max_change: search.max_change,
        same: search.same,
    };
    let maps = detached(py, || {
        windowed::relocate_surfaces(&pair, &surfaces, &search)
    })?;
    let map = |values| array_of(py, pair.object.shape(), values);
    Ok((map(maps.0), map(maps.1), map(maps.2)))
}

#[pyfunction]
pub fn wall_sides<'py>(
    py: Python<'py>,
    pair: PairItems<'py>,
    surfaces: SurfaceItems<'py>,
    walls: Bytes<'py>,
) -> PyResult<Map<'py, i64>> {
    let (pair, surfaces) = (pair.pair()?, surfaces.surfaces()?);
    let walls = image_of(&walls)?;
    let found = detached(py, || windowed::wall_sides(&pair, &surfaces, walls))?;
    Ok(array_of(py, walls.shape(), found))
}

#[pyfunction]
pub fn smooth_within_walls<'py>(
    py: Python<'py>,
    values: Floats<'py>,
    walls: Bytes<'py>,
    sigma: f64,
) -> PyResult<Map<'py>> {
    let (values, walls) = (image_of(&values)?, image_of(&walls)?);
    let found = detached(py, || windowed::smooth_within_walls(values, walls, sigma))?;
    Ok(array_of(py, values.shape(), found))
}
