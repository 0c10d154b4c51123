//! From stacks of shifted fringes and Gray code to projector coordinates, in one pass (theory §5).
//!
//! Pixels are computed in blocks that stay in the first cache: sums of the frames with cosine and
//! sine of their shifts and the phase of every period (`fit`), the Gray code (`gray_code`), then
//! the fringe orders of all periods, the weighted mean of the coordinate and its variance
//! (`orders`).
//!
//! Multiplications and additions are not fused, so that all instruction sets give the same numbers.

pub(crate) mod fit;
mod gray_code;
mod orders;
mod outputs;

use crate::{Error, Reason, check_length, check_value};
use rayon::prelude::*;
use std::ops::{Deref, DerefMut};

use fit::Frames;
pub use fit::{Harmonics, PhaseSet, TABLE_BINS, Table};
pub use gray_code::{Against, GrayCode};
pub use orders::{Chain, Limits, Noise};
pub use outputs::Outputs;

/// Pixels of a block, which every pass of the decoder runs over.
///
/// A block's arrays for three periods take about 30 kB in single precision, less than the first
/// cache. Passes over fewer pixels would spend more of their time on starting and ending.
pub(crate) const BLOCK_PIXELS: usize = 480;

/// Pixels that one task decodes.
///
/// Long enough to hide the cost of a task, short enough to share a small frame between threads.
const TASK_PIXELS: usize = 32 * BLOCK_PIXELS;

/// One value per pixel of a block.
///
/// It starts at a line of the cache: a vector of 512 bit that lies across two lines takes twice the
/// time.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Line<T = f32>([T; BLOCK_PIXELS]);

impl<T: Copy> Line<T> {
    pub const fn of(value: T) -> Self {
        Self([value; BLOCK_PIXELS])
    }
}

impl<T> Deref for Line<T> {
    type Target = [T; BLOCK_PIXELS];

    #[inline(always)]
    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl<T> DerefMut for Line<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.0
    }
}

/// Largest number of pixels that one thread decodes faster than it hands them to others.
const ALONE_PIXELS: usize = 2 * TASK_PIXELS;

/// Whether frames of this size are decoded on the thread that calls [`decode_frames`], without others.
///
/// ```
/// use fringeworks::decode::decodes_alone;
///
/// assert!(decodes_alone(100 * 100));
/// assert!(!decodes_alone(2000 * 1000));
/// ```
pub fn decodes_alone(pixels: usize) -> bool {
    pixels <= ALONE_PIXELS
}

/// A type of camera counts, and the kernels compiled for it.
pub trait Sample: Copy + Default + Send + Sync + 'static {
    /// Whether the type has NaN and infinity.
    const MAY_BE_INFINITE: bool;
    /// Largest value of the type.
    const LARGEST: f32;
    /// The count as a float.
    fn value(self) -> f32;
    /// The larger of two counts.
    fn larger(self, other: Self) -> Self;
    #[doc(hidden)]
    fn run(task: Task<'_, Self>);
}

/// A run of pixels to decode.
#[doc(hidden)]
pub struct Task<'a, T> {
    frames: &'a Frames<'a, T>,
    plan: &'a DecodeSettings,
    start: usize,
    out: Outputs<'a>,
    scratch: &'a mut orders::Scratch,
}

macro_rules! sample {
    ($type:ident, $run:ident, $infinite:expr, $largest:expr) => {
        #[multiversion::multiversion(targets(
            "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
            "x86_64+avx2+fma"
        ))]
        fn $run(task: Task<'_, $type>) {
            decode_task(task);
        }

        impl Sample for $type {
            const MAY_BE_INFINITE: bool = $infinite;
            const LARGEST: f32 = $largest;
            #[inline(always)]
            fn value(self) -> f32 {
                f32::from(self)
            }
            #[inline(always)]
            fn larger(self, other: Self) -> Self {
                self.max(other)
            }
            fn run(task: Task<'_, Self>) {
                $run(task);
            }
        }
    };
}
sample!(u8, run_u8, false, 255.0);
sample!(u16, run_u16, false, 65_535.0);
sample!(f32, run_f32, true, f32::INFINITY);

/// What is decoded along one axis of the projector.
pub struct DecodeSettings {
    /// Sets of phase steps, one per period.
    pub sets: Vec<PhaseSet>,
    /// Gray code; without sets it gives the coordinate alone.
    pub gray_code: Option<GrayCode>,
    /// How fringe orders are found; at least one combination where there are sets.
    pub chain: Chain,
    /// Noise of the camera.
    pub noise: Noise,
    /// Limits that a pixel must keep.
    pub limits: Limits,
}

impl DecodeSettings {
    pub(crate) fn check(&self, frames: usize) -> Result<(), Error> {
        for set in &self.sets {
            set.check(frames)?;
        }
        if let Some(code) = &self.gray_code {
            code.check(frames)?;
        }
        check_value(
            "plan",
            !self.sets.is_empty() || self.gray_code.is_some(),
            "phases or a code",
            "neither",
        )?;
        self.chain.check(self.sets.len())?;
        orders::check(self)
    }

    /// Index of the set with the shortest period, which determines the precision.
    pub(crate) fn finest(&self) -> usize {
        let f = |k: &usize| self.sets[*k].frequency;
        (0..self.sets.len())
            .max_by(|a, b| f(a).total_cmp(&f(b)))
            .unwrap_or(0)
    }
}

/// Decode frames.
///
/// `frames` are the planes of one axis; `settings` refer to them by index. All planes have the length
/// of the outputs.
///
/// ```
/// use fringeworks::decode::{Chain, DecodeSettings, Limits, Noise, Outputs, PhaseSet, decode_frames};
/// use std::f64::consts::TAU;
///
/// let shifts = [0.0, TAU / 4.0, TAU / 2.0, 3.0 * TAU / 4.0];
/// let settings = DecodeSettings {
///     sets: vec![PhaseSet::new(vec![0, 1, 2, 3], &shifts, vec![], 64.0)?],
///     gray_code: None,
///     chain: Chain::hierarchy(&[64.0])?,
///     noise: Noise { read_variance: 1.0, gain: 0.0 },
///     limits: Limits::default(),
/// };
/// // One pixel, whose phase is an eighth of a turn.
/// let (mut coordinate, mut sigma, mut modulation) = ([0.0], [0.0], [0.0]);
/// let (mut background, mut reason) = ([0.0], [0]);
/// let out = Outputs {
///     coordinate: &mut coordinate,
///     sigma: &mut sigma,
///     modulation: &mut modulation,
///     background: &mut background,
///     reason: &mut reason,
///     ..Outputs::none()
/// };
/// decode_frames(&[&[150_u8], &[150], &[50], &[50]], &settings, out)?;
/// assert!((coordinate[0] - 8.0).abs() < 1e-3);
/// assert_eq!(background[0], 100.0);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn decode_frames<T: Sample>(
    frames: &[&[T]],
    settings: &DecodeSettings,
    out: Outputs,
) -> Result<(), Error> {
    let pixels = out.coordinate.len();
    for frame in frames {
        check_length("frame", frame.len(), pixels)?;
    }
    settings.check(frames.len())?;
    out.check(pixels, settings.sets.len())?;
    let factors = !out.inflation.is_empty();
    let frames = &Frames { planes: frames };
    let mut tasks = Vec::with_capacity(pixels / TASK_PIXELS + 1);
    let (mut rest, mut start) = (out, 0);
    while start < pixels {
        let n = TASK_PIXELS.min(pixels - start);
        let (first, after) = rest.split(n);
        tasks.push((start, first));
        rest = after;
        start += n;
    }
    let scratch = || orders::Scratch::new(settings, factors);
    let run = |scratch: &mut orders::Scratch, (start, out)| {
        T::run(Task {
            frames,
            plan: settings,
            start,
            out,
            scratch,
        });
    };
    if decodes_alone(pixels) {
        let mut scratch = scratch();
        tasks.into_iter().for_each(|task| run(&mut scratch, task));
    } else {
        tasks.into_par_iter().for_each_init(scratch, run);
    }
    Ok(())
}

/// Maps of a decoded stack, one value per pixel.
pub struct Decoded {
    /// Projector coordinate, px; NaN where not measured.
    pub coordinate: Vec<f32>,
    /// Standard deviation of the coordinate, px.
    pub sigma: Vec<f32>,
    /// Modulation of the set with the shortest period, counts.
    pub modulation: Vec<f32>,
    /// Mean of the phase frames, counts.
    pub background: Vec<f32>,
    /// Why a pixel has no value.
    pub reason: Vec<Reason>,
}

/// Decode frames into new maps; see [`decode_frames`].
///
/// ```
/// use fringeworks::Reason;
/// use fringeworks::decode::{Chain, DecodeSettings, Limits, Noise, PhaseSet, decode};
/// use std::f64::consts::TAU;
///
/// // Three steps of one fringe over 100 columns; the last pixel is dark.
/// let shifts = [0.0, TAU / 3.0, 2.0 * TAU / 3.0];
/// let settings = DecodeSettings {
///     sets: vec![PhaseSet::new(vec![0, 1, 2], &shifts, vec![], 100.0)?],
///     gray_code: None,
///     chain: Chain::hierarchy(&[100.0])?,
///     noise: Noise { read_variance: 1.0, gain: 0.0 },
///     limits: Limits::default(),
/// };
/// let frame = |shift: &f64| -> [f32; 2] { [100.0 + 50.0 * (TAU * 0.3 - shift).cos() as f32, 5.0] };
/// let frames = shifts.each_ref().map(frame);
/// let found = decode(&frames.each_ref().map(|frame| &frame[..]), &settings)?;
/// assert!((found.coordinate[0] - 30.0).abs() < 1e-3);
/// assert_eq!(found.reason, [Reason::Ok, Reason::Shadow]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn decode<T: Sample>(frames: &[&[T]], settings: &DecodeSettings) -> Result<Decoded, Error> {
    let pixels = frames.first().map_or(0, |frame| frame.len());
    let [mut coordinate, mut sigma, mut modulation, mut background] =
        std::array::from_fn(|_| vec![0.0; pixels]);
    let mut codes = vec![0; pixels];
    let out = Outputs {
        coordinate: &mut coordinate,
        sigma: &mut sigma,
        modulation: &mut modulation,
        background: &mut background,
        reason: &mut codes,
        ..Outputs::none()
    };
    decode_frames(frames, settings, out)?;
    let reason: Result<_, Error> = codes.into_iter().map(Reason::try_from).collect();
    Ok(Decoded {
        coordinate,
        sigma,
        modulation,
        background,
        reason: reason?,
    })
}

/// Decodes runs of pixels on one thread, for kernels that go on with the coordinates.
pub(crate) struct BandDecoder<'a, T> {
    frames: Frames<'a, T>,
    plan: &'a DecodeSettings,
    scratch: orders::Scratch,
}

impl<'a, T: Sample> BandDecoder<'a, T> {
    /// For checked planes and a checked plan.
    pub fn new(planes: &'a [&'a [T]], plan: &'a DecodeSettings) -> Self {
        Self {
            frames: Frames { planes },
            plan,
            scratch: orders::Scratch::new(plan, false),
        }
    }

    /// Decode pixels from `start` on.
    pub fn decode(
        &mut self,
        start: usize,
        coordinate: &mut [f32],
        sigma: &mut [f32],
        reason: &mut [u8],
    ) {
        T::run(Task {
            frames: &self.frames,
            plan: self.plan,
            start,
            out: Outputs {
                coordinate,
                sigma,
                reason,
                ..Outputs::none()
            },
            scratch: &mut self.scratch,
        });
    }
}

/// Decode the blocks of one task.
#[inline(always)]
fn decode_task<T: Sample>(mut task: Task<'_, T>) {
    let n = task.out.coordinate.len();
    for done in (0..n).step_by(BLOCK_PIXELS) {
        let here = done..n.min(done + BLOCK_PIXELS);
        let (at, out, scratch) = (task.start + done, &mut task.out, &mut *task.scratch);
        if at + BLOCK_PIXELS <= task.frames.pixels() {
            orders::decode_block(task.frames, task.plan, at, scratch, out, here);
        } else {
            let padded = task.frames.padded(at);
            let planes: Vec<&[T]> = padded.iter().map(Vec::as_slice).collect();
            let frames = &Frames { planes: &planes };
            orders::decode_block(frames, task.plan, 0, scratch, out, here);
        }
    }
}
