//! Bindings of the decoder, for whole stacks and for streams.

use crate::rows::{refuse, rows_of, rows_of_mut};
use crate::threads::{alone, detached};
use fringeworks::Error;
use fringeworks::decode::{
    Against, Chain, GrayCode, Limits, Noise, Outputs, PhaseSet, Plan, Table, decode, decodes_alone,
};
use numpy::{Element, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2};
use pyo3::prelude::*;

/// Settings of the decoder along one axis. Indices refer to the frames that are passed to a call.
#[pyclass(frozen, module = "fringeworks._core")]
pub struct DecodeSettings {
    pub plan: Plan,
}

/// Indices of the frames, shifts (rad), what every frame really shows of (A, c, s) or nothing, period
/// (px), floor of the phase's variance (rad²), and the response: phase errors (turns) and
/// brightnesses (counts), or nothing.
type SetItems = (
    Vec<usize>,
    Vec<f64>,
    Vec<[f64; 3]>,
    f64,
    f32,
    Vec<f32>,
    Vec<f32>,
);

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
    alien_share: f32,
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
        .map(
            |(frames, shifts, design, period, floor, turns, brightness)| {
                let mut set = PhaseSet::new(frames, &shifts, design, period)?;
                set.floor = floor;
                set.table = Table { turns, brightness };
                Ok(set)
            },
        )
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
        alien_share: items.alien_share,
        slack: items.slack,
        guard: items.guard,
        confidence: items.confidence,
    }
}

#[pymethods]
impl DecodeSettings {
    #[new]
    #[pyo3(signature = (*, sets, code, combinations, frequencies, amplification, room,
        remainder, alternative, order_variance, middle, half,
        repeats, circular, read_variance, gain, saturation, min_snr,
        min_modulation, max_disagreement, usual_inflation, confidence, order_confidence))]
    #[allow(clippy::too_many_arguments)] // All are keywords in Python.
    fn new(
        sets: Vec<SetItems>,
        code: Option<CodeItems>,
        combinations: PyReadonlyArray2<'_, f32>,
        frequencies: PyReadonlyArray1<'_, f32>,
        amplification: PyReadonlyArray2<'_, f32>,
        room: PyReadonlyArray1<'_, f32>,
        remainder: Vec<usize>,
        alternative: PyReadonlyArray1<'_, f32>,
        order_variance: [f32; 2],
        middle: f32,
        half: f32,
        repeats: f32,
        circular: bool,
        read_variance: f32,
        gain: f32,
        saturation: f32,
        min_snr: f32,
        min_modulation: f32,
        max_disagreement: f32,
        usual_inflation: f32,
        confidence: f32,
        order_confidence: f32,
    ) -> PyResult<Self> {
        let sets = phase_sets(sets)?;
        let gray_code = code.map(gray_code);
        let chain = Chain {
            combinations: rows_of(&combinations)?.to_vec(),
            frequencies: rows_of(&frequencies)?.to_vec(),
            amplification: rows_of(&amplification)?.to_vec(),
            margin: rows_of(&room)?.to_vec(),
            remainder,
            alternative: rows_of(&alternative)?.to_vec(),
            order_variance,
            middle,
            half,
            repeats,
            circular,
        };
        let noise = Noise {
            read_variance,
            gain,
        };
        let limits = Limits {
            saturation,
            min_snr,
            min_modulation,
            max_disagreement,
            usual_inflation,
            confidence,
            order_confidence,
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
    #[pyo3(item)]
    inflation: Option<PyReadonlyArray2<'py, f32>>,
}

impl Maps<'_> {
    fn outputs(&mut self) -> PyResult<Outputs<'_>> {
        Ok(Outputs {
            coordinate: rows_of_mut(&mut self.coordinate)?,
            sigma: rows_of_mut(&mut self.sigma)?,
            modulation: rows_of_mut(&mut self.modulation)?,
            background: rows_of_mut(&mut self.background)?,
            reason: rows_of_mut(&mut self.reason)?,
            phases: self
                .phases
                .iter_mut()
                .map(rows_of_mut)
                .collect::<PyResult<_>>()?,
            modulations: self
                .modulations
                .iter_mut()
                .map(rows_of_mut)
                .collect::<PyResult<_>>()?,
            disagreement: match &mut self.disagreement {
                Some(map) => rows_of_mut(map)?,
                None => &mut [],
            },
            inflation: match &self.inflation {
                Some(map) => rows_of(map)?,
                None => &[],
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

pub(crate) use with_planes;

pub fn planes_of<'a, T: Element>(list: &'a [PyReadonlyArray2<'_, T>]) -> PyResult<Vec<&'a [T]>> {
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
    let small = decodes_alone(out.coordinate.len());
    with_planes!(&frames, planes => {
        let run = || decode(&planes, plan, out);
        if small { alone(py, run) } else { detached(py, run) }
    })
}
