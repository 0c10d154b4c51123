//! Binding of the kernel from frames to points.

use crate::decode::{DecodeSettings, Frames, planes_of};
use crate::rig::{LimitItems, PointMaps, Triangulation};
use crate::threads::detached;
use fringeworks::decode::Sample;
use fringeworks::isolated::Smooth;
use fringeworks::measure::{self, Stack};
use fringeworks::triangulate::Limits;
use numpy::{Element, PyReadonlyArray2};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

/// Frames along one axis, and their settings.
type StackItems<'py> = (Frames<'py>, Py<DecodeSettings>);

/// A type of counts, and how to take frames of it.
trait Counts: Sample + Element {
    fn list<'a, 'py>(frames: &'a Frames<'py>) -> Option<&'a [PyReadonlyArray2<'py, Self>]>;
}

macro_rules! counts {
    ($type:ident, $kind:ident) => {
        impl Counts for $type {
            fn list<'a, 'py>(frames: &'a Frames<'py>) -> Option<&'a [PyReadonlyArray2<'py, Self>]> {
                match frames {
                    Frames::$kind(list) => Some(list),
                    _ => None,
                }
            }
        }
    };
}
counts!(u8, Bytes);
counts!(u16, Words);
counts!(f32, Floats);

/// Planes of the frames of an axis, if there is one.
fn planes<'a, T: Counts>(stack: Option<&'a StackItems<'_>>) -> PyResult<Option<Vec<&'a [T]>>> {
    let Some((frames, _)) = stack else {
        return Ok(None);
    };
    let list = T::list(frames)
        .ok_or_else(|| PyTypeError::new_err("frames: expected one type along both axes"))?;
    planes_of(list).map(Some)
}

/// The stack of an axis, if there is one.
fn stack<'a, T>(
    planes: Option<&'a [&'a [T]]>,
    items: Option<&'a StackItems<'_>>,
) -> Option<Stack<'a, T>> {
    let (frames, (_, settings)) = planes.zip(items)?;
    let settings = &settings.get().inner;
    Some(Stack { frames, settings })
}

/// Points from the frames of one axis or both, into the maps.
///
/// `typical` is the typical difference of neighbouring coordinates along x and along y, px, by which
/// isolated pixels are found; `None` keeps them.
#[pyfunction]
#[pyo3(signature = (x, y, rig, maps, *, typical, limits))]
pub fn measure_points(
    py: Python<'_>,
    x: Option<StackItems<'_>>,
    y: Option<StackItems<'_>>,
    rig: &Triangulation,
    mut maps: PointMaps<'_>,
    typical: Option<(f32, f32)>,
    limits: LimitItems,
) -> PyResult<()> {
    let smooth = typical.map(|(x, y)| [x, y].map(|step| Smooth::new(step, f32::INFINITY)));
    let call = Call {
        rig,
        limits: limits.into(),
        smooth,
    };
    let axes = [x.as_ref(), y.as_ref()];
    match axes[0].or(axes[1]).map(|(frames, _)| frames) {
        Some(Frames::Bytes(_)) => call.run::<u8>(py, axes, &mut maps),
        Some(Frames::Words(_)) => call.run::<u16>(py, axes, &mut maps),
        _ => call.run::<f32>(py, axes, &mut maps),
    }
}

struct Call<'a> {
    rig: &'a Triangulation,
    limits: Limits,
    smooth: Option<[Smooth; 2]>,
}

impl Call<'_> {
    fn run<T: Counts>(
        &self,
        py: Python<'_>,
        [x, y]: [Option<&StackItems<'_>>; 2],
        maps: &mut PointMaps<'_>,
    ) -> PyResult<()> {
        let (planes_x, planes_y) = (planes::<T>(x)?, planes::<T>(y)?);
        let (x, y) = (stack(planes_x.as_deref(), x), stack(planes_y.as_deref(), y));
        let out = maps.points(self.rig.inner.shape())?;
        let rig = &self.rig.inner;
        detached(py, || {
            measure::measure_points(rig, x, y, self.smooth.as_ref(), &self.limits, out)
        })
    }
}
