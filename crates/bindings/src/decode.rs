//! Bindings of the decoder, for whole stacks and for streams.

use crate::rows::{refuse, rows_of, rows_of_mut};
use crate::threads::{alone, detached};
use fringeworks::Error;
use fringeworks::decode::{
    self, Against, Chain, GrayCode, Harmonics, Limits, Noise, Outputs, PhaseSet, Table,
    decodes_alone,
};
use numpy::{Element, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2};
use pyo3::prelude::*;

/// Settings of the decoder along one axis. Indices refer to the frames that are passed to a call.
#[pyclass(frozen, module = "fringeworks._core")]
pub struct DecodeSettings {
    pub inner: decode::DecodeSettings,
}

/// A set of phase steps, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct SetItems {
    frames: Vec<usize>,
    shifts: Vec<f64>,
    design: Vec<[f64; 3]>,
    period: f64,
    offsets: Vec<f64>,
    floor: f32,
    whole: bool,
    harmonics: HarmonicItems,
    /// Response: phase errors (turns) and brightnesses (counts), or nothing.
    table: TableItems,
}

/// What the fit leaves of every frame, row after row, in shares of the harmonics of these orders.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct HarmonicItems {
    orders: Vec<u32>,
    shares: Vec<f64>,
}

#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct TableItems {
    turns: Vec<f32>,
    brightness: Vec<f32>,
}

impl SetItems {
    fn set(self) -> Result<PhaseSet, Error> {
        let set = PhaseSet::new(self.frames, &self.shifts, self.design, self.period)?;
        let mut set = set.with_offsets(&self.offsets)?;
        set.floor = self.floor;
        set.whole = self.whole;
        set.harmonics = Harmonics {
            orders: self.harmonics.orders,
            shares: self.harmonics.shares,
        };
        set.table = Table {
            turns: self.table.turns,
            brightness: self.table.brightness,
        };
        Ok(set)
    }
}

/// A Gray code: indices of its frames, its cells (px), and how its start is judged; see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct CodeItems {
    bits: Vec<usize>,
    inverse: Vec<usize>,
    white_black: Option<(usize, usize)>,
    levels: u32,
    inverted: u32,
    step: f32,
    offset: f32,
    cells: u32,
    doubt_share: f32,
    alien_share: f32,
    widest: f32,
    blurred: f32,
    slack: f32,
    guard: f32,
    confidence: f32,
}

impl From<CodeItems> for GrayCode {
    /// Without inverse, white and black frames, the threshold is the mean.
    fn from(items: CodeItems) -> Self {
        Self {
            bits: items.bits,
            against: match items.white_black {
                Some((white, black)) => Against::WhiteBlack { white, black },
                None if items.inverse.is_empty() => Against::Mean,
                None => Against::Inverse(items.inverse),
            },
            levels: items.levels,
            inverted: items.inverted,
            step: items.step,
            offset: items.offset,
            cells: items.cells,
            doubt_share: items.doubt_share,
            alien_share: items.alien_share,
            widest: items.widest,
            blurred: items.blurred,
            slack: items.slack,
            guard: items.guard,
            confidence: items.confidence,
        }
    }
}

/// The chain of roundings, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct ChainItems<'py> {
    combinations: PyReadonlyArray2<'py, f32>,
    frequencies: PyReadonlyArray1<'py, f32>,
    amplification: PyReadonlyArray2<'py, f32>,
    margin: PyReadonlyArray1<'py, f32>,
    remainder: Vec<usize>,
    alternative: PyReadonlyArray1<'py, f32>,
    order_variance: [f32; 2],
    middle: f32,
    half: f32,
    repeats: f32,
    circular: bool,
}

impl ChainItems<'_> {
    fn chain(self) -> PyResult<Chain> {
        Ok(Chain {
            combinations: rows_of(&self.combinations)?.to_vec(),
            frequencies: rows_of(&self.frequencies)?.to_vec(),
            amplification: rows_of(&self.amplification)?.to_vec(),
            margin: rows_of(&self.margin)?.to_vec(),
            remainder: self.remainder,
            alternative: rows_of(&self.alternative)?.to_vec(),
            order_variance: self.order_variance,
            middle: self.middle,
            half: self.half,
            repeats: self.repeats,
            circular: self.circular,
        })
    }
}

/// Noise of the camera, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct NoiseItems {
    read_variance: f32,
    gain: f32,
}

/// Limits that a pixel must keep, see the kernel.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct LimitItems {
    saturation: f32,
    min_snr: f32,
    min_modulation: f32,
    max_disagreement: f32,
    usual_inflation: f32,
    confidence: f32,
    order_confidence: f32,
}

#[pymethods]
impl DecodeSettings {
    #[new]
    #[pyo3(signature = (*, sets, gray_code, chain, noise, limits))]
    fn new(
        sets: Vec<SetItems>,
        gray_code: Option<CodeItems>,
        chain: ChainItems<'_>,
        noise: NoiseItems,
        limits: LimitItems,
    ) -> PyResult<Self> {
        let sets: Result<_, Error> = sets.into_iter().map(SetItems::set).collect();
        let inner = decode::DecodeSettings {
            sets: sets.map_err(refuse)?,
            gray_code: gray_code.map(GrayCode::from),
            chain: chain.chain()?,
            noise: Noise {
                read_variance: noise.read_variance,
                gain: noise.gain,
            },
            limits: Limits {
                saturation: limits.saturation,
                min_snr: limits.min_snr,
                min_modulation: limits.min_modulation,
                max_disagreement: limits.max_disagreement,
                usual_inflation: limits.usual_inflation,
                confidence: limits.confidence,
                order_confidence: limits.order_confidence,
            },
        };
        Ok(Self { inner })
    }
}

/// Arrays that the results are written to.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Maps<'py> {
    coordinate: PyReadwriteArray2<'py, f32>,
    sigma: PyReadwriteArray2<'py, f32>,
    modulation: PyReadwriteArray2<'py, f32>,
    background: PyReadwriteArray2<'py, f32>,
    reason: PyReadwriteArray2<'py, u8>,
    phases: Vec<PyReadwriteArray2<'py, f32>>,
    modulations: Vec<PyReadwriteArray2<'py, f32>>,
    variances: Vec<PyReadwriteArray2<'py, f32>>,
    cells: Vec<PyReadwriteArray2<'py, f32>>,
    disagreement: Option<PyReadwriteArray2<'py, f32>>,
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
            variances: self
                .variances
                .iter_mut()
                .map(rows_of_mut)
                .collect::<PyResult<_>>()?,
            cells: self
                .cells
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
    settings: &DecodeSettings,
    mut maps: Maps<'_>,
) -> PyResult<()> {
    let out = maps.outputs()?;
    let settings = &settings.inner;
    let small = decodes_alone(out.coordinate.len());
    with_planes!(&frames, planes => {
        let run = || decode::decode_frames(&planes, settings, out);
        if small { alone(py, run) } else { detached(py, run) }
    })
}
