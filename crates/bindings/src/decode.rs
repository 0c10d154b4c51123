//! Bindings of the decoder, for whole stacks and for streams.

use crate::{refuse, rows_of};
use fringeworks::decode::stream::{self, SetSums};
use fringeworks::decode::{
    decode, Against, Chain, GrayCode, Limits, Noise, Outputs, PhaseSet, Plan, Sample, Table,
};
use fringeworks::Error;
use numpy::{
    Element, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

/// Settings of the decoder along one axis. Indices refer to the frames that are passed to a call.
#[pyclass(frozen, module = "fringeworks._core")]
pub struct DecodeSettings {
    plan: Plan,
}

/// Indices of the frames, shifts (rad), period (px), and the response: phase errors (turns) and
/// brightnesses (counts), or empty.
type SetItems = (Vec<usize>, Vec<f64>, f64, Vec<f32>, Vec<f32>);

/// A Gray code: indices of its frames, its cells (px), and how its start is judged; see the kernel.
#[derive(FromPyObject)]
struct CodeItems {
    #[pyo3(item)]
    bits: Vec<usize>,
    #[pyo3(item)]
    inverse: Vec<usize>,
    #[pyo3(item)]
    white_black: Option<(usize, usize)>,
    #[pyo3(item)]
    levels: u32,
    #[pyo3(item)]
    step: f32,
    #[pyo3(item)]
    offset: f32,
    #[pyo3(item)]
    cells: u32,
    #[pyo3(item)]
    doubt_share: f32,
    #[pyo3(item)]
    slack: f32,
    #[pyo3(item)]
    guard: f32,
    #[pyo3(item)]
    confidence: f32,
}

/// Phase sets of the kernel.
fn phase_sets(items: Vec<SetItems>) -> PyResult<Vec<PhaseSet>> {
    items
        .into_iter()
        .map(|(frames, shifts, period, turns, brightness)| {
            let mut set = PhaseSet::new(frames, &shifts, period)?;
            set.table = Table { turns, brightness };
            Ok(set)
        })
        .collect::<Result<_, Error>>()
        .map_err(refuse)
}

/// Gray code of the kernel. Without inverse, white and black frames, the threshold is the mean.
fn gray_code(items: CodeItems) -> GrayCode {
    GrayCode {
        bits: items.bits,
        against: match items.white_black {
            Some((white, black)) => Against::WhiteBlack { white, black },
            None if items.inverse.is_empty() => Against::Mean,
            None => Against::Inverse(items.inverse),
        },
        levels: items.levels,
        step: items.step,
        offset: items.offset,
        cells: items.cells,
        doubt_share: items.doubt_share,
        slack: items.slack,
        guard: items.guard,
        confidence: items.confidence,
    }
}

#[pymethods]
impl DecodeSettings {
    #[new]
    #[pyo3(signature = (*, sets, code, combinations, frequencies, amplification, room, middle, half,
        repeats, circular, read_variance, gain, scale, saturation, min_snr,
        min_modulation, max_disagreement, confidence))]
    #[allow(clippy::too_many_arguments)] // All are keywords in Python.
    fn new(
        sets: Vec<SetItems>,
        code: Option<CodeItems>,
        combinations: PyReadonlyArray2<'_, f32>,
        frequencies: PyReadonlyArray1<'_, f32>,
        amplification: PyReadonlyArray2<'_, f32>,
        room: PyReadonlyArray1<'_, f32>,
        middle: f32,
        half: f32,
        repeats: f32,
        circular: bool,
        read_variance: f32,
        gain: f32,
        scale: f32,
        saturation: f32,
        min_snr: f32,
        min_modulation: f32,
        max_disagreement: f32,
        confidence: f32,
    ) -> PyResult<Self> {
        let sets = phase_sets(sets)?;
        let gray_code = code.map(gray_code);
        let chain = Chain {
            combinations: rows_of(&combinations)?.to_vec(),
            frequencies: rows_of(&frequencies)?.to_vec(),
            amplification: rows_of(&amplification)?.to_vec(),
            margin: rows_of(&room)?.to_vec(),
            middle,
            half,
            repeats,
            circular,
        };
        let noise = Noise {
            read_variance,
            gain,
            scale,
        };
        let limits = Limits {
            saturation,
            min_snr,
            min_modulation,
            max_disagreement,
            confidence,
        };
        let plan = Plan {
            sets,
            gray_code,
            chain,
            noise,
            limits,
        };
        Ok(Self { plan })
    }
}

/// Arrays that the results are written to.
#[derive(FromPyObject)]
pub struct Maps<'py> {
    #[pyo3(item)]
    coordinate: PyReadwriteArray2<'py, f32>,
    #[pyo3(item)]
    sigma: PyReadwriteArray2<'py, f32>,
    #[pyo3(item)]
    modulation: PyReadwriteArray2<'py, f32>,
    #[pyo3(item)]
    background: PyReadwriteArray2<'py, f32>,
    #[pyo3(item)]
    reason: PyReadwriteArray2<'py, u8>,
    #[pyo3(item)]
    phases: Vec<PyReadwriteArray2<'py, f32>>,
    #[pyo3(item)]
    modulations: Vec<PyReadwriteArray2<'py, f32>>,
    #[pyo3(item)]
    disagreement: Option<PyReadwriteArray2<'py, f32>>,
}

impl Maps<'_> {
    fn outputs(&mut self) -> PyResult<Outputs<'_>> {
        fn rows<'a, T: Element>(map: &'a mut PyReadwriteArray2<'_, T>) -> PyResult<&'a mut [T]> {
            if !map.is_c_contiguous() {
                return Err(PyValueError::new_err("expected maps contiguous by rows"));
            }
            Ok(map.as_slice_mut()?)
        }
        Ok(Outputs {
            coordinate: rows(&mut self.coordinate)?,
            sigma: rows(&mut self.sigma)?,
            modulation: rows(&mut self.modulation)?,
            background: rows(&mut self.background)?,
            reason: rows(&mut self.reason)?,
            phases: self.phases.iter_mut().map(rows).collect::<PyResult<_>>()?,
            modulations: self
                .modulations
                .iter_mut()
                .map(rows)
                .collect::<PyResult<_>>()?,
            disagreement: match &mut self.disagreement {
                Some(map) => rows(map)?,
                None => &mut [],
            },
        })
    }
}

/// Frames of one of the types that the kernels are compiled for.
#[derive(FromPyObject)]
pub enum Frames<'py> {
    Bytes(Vec<PyReadonlyArray2<'py, u8>>),
    Words(Vec<PyReadonlyArray2<'py, u16>>),
    Floats(Vec<PyReadonlyArray2<'py, f32>>),
}

/// Evaluate an expression with the planes of frames of any type.
macro_rules! with_planes {
    ($frames:expr, $planes:ident => $call:expr) => {
        match $frames {
            Frames::Bytes(list) => {
                let $planes = planes_of(list)?;
                $call
            }
            Frames::Words(list) => {
                let $planes = planes_of(list)?;
                $call
            }
            Frames::Floats(list) => {
                let $planes = planes_of(list)?;
                $call
            }
        }
    };
}

fn planes_of<'a, T: Element>(list: &'a [PyReadonlyArray2<'_, T>]) -> PyResult<Vec<&'a [T]>> {
    list.iter().map(rows_of).collect()
}

/// Decode a stack of frames into `maps`.
#[pyfunction]
pub fn decode_frames(
    py: Python<'_>,
    frames: Frames<'_>,
    plan: &DecodeSettings,
    mut maps: Maps<'_>,
) -> PyResult<()> {
    let out = maps.outputs()?;
    let plan = &plan.plan;
    with_planes!(&frames, planes => py.detach(|| decode(&planes, plan, out)).map_err(refuse))
}

/// Largest index of a step: the sums have one bit per step in a `u64`.
const MAX_STEP: usize = 63;

/// Sums over the frames of each set, which arrive one by one.
#[pyclass(module = "fringeworks._core")]
pub struct StreamSums {
    sets: Vec<SetSums>,
    saturation: f32,
}

#[pymethods]
impl StreamSums {
    #[new]
    #[pyo3(signature = (*, sets, pixels, saturation))]
    fn new(sets: usize, pixels: usize, saturation: f32) -> Self {
        Self {
            sets: (0..sets).map(|_| SetSums::new(pixels)).collect(),
            saturation,
        }
    }

    /// Add a frame to a set: the index of its step, and its shift in rad.
    fn add(
        &mut self,
        py: Python<'_>,
        frame: Frames<'_>,
        set: usize,
        step: usize,
        shift: f64,
    ) -> PyResult<()> {
        if step > MAX_STEP {
            return Err(PyValueError::new_err(format!(
                "step: expected 0 to {MAX_STEP}, got {step}"
            )));
        }
        let saturation = self.saturation;
        let n = self.sets.len();
        let sums = self
            .sets
            .get_mut(set)
            .ok_or_else(|| PyValueError::new_err(format!("set: expected one of {n}, got {set}")))?;
        fn one<'a, T>(planes: &[&'a [T]]) -> PyResult<&'a [T]> {
            match planes {
                [frame] => Ok(frame),
                _ => Err(PyTypeError::new_err(format!(
                    "frame: expected a list of one frame, got {}",
                    planes.len()
                ))),
            }
        }
        with_planes!(&frame, planes => {
            let frame = one(&planes)?;
            py.detach(|| sums.add(frame, step, shift, saturation)).map_err(refuse)
        })
    }

    /// Decode the sums; `frames` are those of the Gray code.
    fn decode(
        &self,
        py: Python<'_>,
        frames: Frames<'_>,
        plan: &DecodeSettings,
        mut maps: Maps<'_>,
    ) -> PyResult<()> {
        fn run<T: Sample>(
            sets: &[SetSums],
            planes: &[&[T]],
            plan: &Plan,
            out: Outputs<'_>,
        ) -> Result<(), Error> {
            stream::decode(sets, planes, plan, out)
        }
        let out = maps.outputs()?;
        let (sets, plan) = (&self.sets, &plan.plan);
        with_planes!(&frames, planes => py.detach(|| run(sets, &planes, plan, out)).map_err(refuse))
    }
}
