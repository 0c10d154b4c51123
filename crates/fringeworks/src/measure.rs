//! From frames to points in one pass, without maps of coordinates between.
//!
//! A task decodes a few rows of the camera into memory that stays in the second cache, sets isolated
//! pixels aside and triangulates, then goes on with the next rows. The results are those of
//! [`crate::decode`], [`crate::isolated`] and [`crate::triangulate`] to the bit.

use crate::decode::{BandDecoder, DecodeSettings, Sample};
use crate::isolated::{REACH, Smooth};
use crate::triangulate::{self, Axis, Limits, Points, Triangulation};
use crate::{Error, Reason, check_length, check_value};
use rayon::prelude::*;
use std::ops::Range;

/// Rows that are decoded at a time: with those that the next ones need again, their coordinates fill
/// less than half of a second cache of 1 MB, for frames of 2000 columns.
const STEP_ROWS: usize = 16;

/// Most steps of a task. The four rows around a task are decoded twice.
const TASK_STEPS: usize = 10;

/// Tasks that each thread should have, so that all end at about the same time.
const TASKS_PER_THREAD: usize = 2;

/// Frames along one axis of the projector, and how they are decoded.
pub struct Stack<'a, T> {
    /// The planes that `settings` refers to by index.
    pub frames: &'a [&'a [T]],
    /// How they are decoded.
    pub settings: &'a DecodeSettings,
}

/// Decoded rows of one axis, the rows `first..end` of the camera.
struct Rows {
    width: usize,
    first: usize,
    end: usize,
    coordinate: Vec<f32>,
    sigma: Vec<f32>,
    reason: Vec<u8>,
}

impl Rows {
    fn new(width: usize) -> Self {
        let pixels = (STEP_ROWS + 2 * REACH) * width;
        Self {
            width,
            first: 0,
            end: 0,
            coordinate: vec![0.0; pixels],
            sigma: vec![0.0; pixels],
            reason: vec![0; pixels],
        }
    }

    /// Go on from a row of another part of the frame.
    fn restart(&mut self, first: usize) {
        (self.first, self.end) = (first, first);
    }

    /// Places of rows of the camera.
    fn at(&self, rows: Range<usize>) -> Range<usize> {
        (rows.start - self.first) * self.width..(rows.end - self.first) * self.width
    }

    /// Forget the rows before `first`.
    fn forget(&mut self, first: usize) {
        let kept = self.at(first..self.end);
        self.coordinate.copy_within(kept.clone(), 0);
        self.sigma.copy_within(kept.clone(), 0);
        self.reason.copy_within(kept, 0);
        self.first = first;
    }

    /// Decode the rows up to `end`.
    fn decode<T: Sample>(&mut self, decoder: &mut BandDecoder<'_, T>, end: usize) {
        let place = self.at(self.end..end);
        decoder.decode(
            self.end * self.width,
            &mut self.coordinate[place.clone()],
            &mut self.sigma[place.clone()],
            &mut self.reason[place],
        );
        self.end = end;
    }

    /// Mark isolated pixels of some rows by their reason alone, so that the next rows see them as they
    /// were.
    fn mark(&mut self, smooth: &Smooth, rows: Range<usize>) {
        let known = self.at(self.first..self.end);
        let found = smooth.isolated(
            &self.coordinate[known.clone()],
            &self.sigma[known],
            self.width,
            rows.start - self.first..rows.end - self.first,
        );
        for i in found {
            self.reason[i] = Reason::Isolated.into();
        }
    }

    fn row(&self, row: usize) -> Axis<'_> {
        let place = self.at(row..row + 1);
        Axis {
            coordinate: &self.coordinate[place.clone()],
            sigma: &self.sigma[place.clone()],
            reason: &self.reason[place],
        }
    }
}

/// Points of a surface from frames along one axis or both.
///
/// `smooth` is by what isolated pixels are found along x and along y; `None` keeps them.
///
/// ```
/// use fringeworks::decode::{Chain, DecodeSettings, Limits, Noise, PhaseSet};
/// use fringeworks::measure::{Stack, measure_points};
/// use fringeworks::triangulate::{self, Points};
/// use std::f64::consts::TAU;
///
/// // A rig whose projector sees a plane at 1 m under camera column − 100 px; see `Triangulation`.
/// # use fringeworks::triangulate::{Lens, Rig, Spread, Triangulation};
/// # let lens = Lens { focal: [1000.0; 2], principal: [15.5, 7.5], distortion: [0.0; 5] };
/// # let rig = Rig {
/// #     camera: lens,
/// #     projector: lens,
/// #     rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
/// #     translation: [-100.0, 0.0, 0.0],
/// # };
/// # let rig = Triangulation::new(&rig, &Spread::none(true, 1024.0), (16, 32), (1024, 768))?;
/// let shifts = [0.0, TAU / 3.0, 2.0 * TAU / 3.0];
/// let settings = DecodeSettings {
///     sets: vec![PhaseSet::new(vec![0, 1, 2], &shifts, vec![], 1024.0)?],
///     gray_code: None,
///     chain: Chain::hierarchy(&[1024.0])?,
///     noise: Noise { read_variance: 0.01, gain: 0.0 },
///     limits: Limits::default(),
/// };
/// let count = |i: usize, shift: f64| 100.0 + 50.0 * (TAU * ((i % 32) as f64 + 100.0) / 1024.0 - shift).cos();
/// let frames = shifts.map(|shift| (0..512).map(|i| count(i, shift) as f32).collect::<Vec<f32>>());
/// let planes = frames.each_ref().map(Vec::as_slice);
/// let (mut xyz, mut sigma, mut noise, mut reason) = ([0.0; 1536], [0.0; 512], [0.0; 512], [0; 512]);
/// let out = Points {
///     xyz: &mut xyz,
///     sigma: &mut sigma,
///     noise: &mut noise,
///     residual: &mut [],
///     reason: &mut reason,
/// };
/// let limits = triangulate::Limits { residual_sigmas: 5.0, residual_px: 0.1 };
/// let stack = Stack { frames: &planes, settings: &settings };
/// measure_points(&rig, Some(stack), None, None, &limits, out)?;
/// assert!(reason.iter().all(|&code| code == 0 || code == 8));
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn measure_points<T: Sample>(
    rig: &Triangulation,
    x: Option<Stack<'_, T>>,
    y: Option<Stack<'_, T>>,
    smooth: Option<&[Smooth; 2]>,
    limits: &Limits,
    out: Points<'_>,
) -> Result<(), Error> {
    let (height, width) = rig.shape();
    triangulate::check(rig, x.is_some(), y.is_some(), &out)?;
    for stack in [&x, &y].into_iter().flatten() {
        check_value("frames", !stack.frames.is_empty(), "one or more", 0)?;
        for frame in stack.frames {
            check_length("frame", frame.len(), height * width)?;
        }
        stack.settings.check(stack.frames.len())?;
    }
    let smooth = smooth.filter(|_| width >= 3 && height >= 3);
    let task = Task {
        rig,
        limits,
        smooth,
    };
    let tasks = TASKS_PER_THREAD * rayon::current_num_threads();
    let steps = height.div_ceil(STEP_ROWS).div_ceil(tasks).min(TASK_STEPS);
    let task_rows = steps.max(1) * STEP_ROWS;
    // Memory of a thread, which the system need not clear again for each task.
    let axes = || [&x, &y].map(|stack| Some(Along::new(stack.as_ref()?, width)));
    out.split_rows(width, task_rows)
        .into_par_iter()
        .for_each_init(axes, |axes, (first, out)| {
            task.run(axes, first..(first + task_rows).min(height), out);
        });
    Ok(())
}

/// One axis of a task.
struct Along<'a, T> {
    decoder: BandDecoder<'a, T>,
    known: Rows,
}

impl<'a, T: Sample> Along<'a, T> {
    fn new(stack: &'a Stack<'a, T>, width: usize) -> Self {
        Self {
            decoder: BandDecoder::new(stack.frames, stack.settings),
            known: Rows::new(width),
        }
    }
}

/// What the tasks of a frame have in common.
struct Task<'a> {
    rig: &'a Triangulation,
    limits: &'a Limits,
    smooth: Option<&'a [Smooth; 2]>,
}

impl Task<'_> {
    /// Measure some rows.
    fn run<T: Sample>(
        &self,
        axes: &mut [Option<Along<'_, T>>; 2],
        rows: Range<usize>,
        out: Points<'_>,
    ) {
        let (height, width) = self.rig.shape();
        for axis in axes.iter_mut().flatten() {
            axis.known.restart(rows.start.saturating_sub(REACH));
        }
        let mut outputs = out.split_rows(width, 1).into_iter();
        for start in rows.clone().step_by(STEP_ROWS) {
            let end = (start + STEP_ROWS).min(rows.end);
            for (k, axis) in axes.iter_mut().enumerate() {
                let Some(Along { decoder, known }) = axis else {
                    continue;
                };
                known.forget(start.saturating_sub(REACH));
                known.decode(decoder, (end + REACH).min(height));
                if let Some(smooth) = self.smooth {
                    known.mark(&smooth[k], start..end);
                }
            }
            for (row, (_, out)) in (start..end).zip(&mut outputs) {
                let [x, y] = [&axes[0], &axes[1]].map(|a| Some(a.as_ref()?.known.row(row)));
                triangulate::triangulate_row(self.rig, self.limits, row, x, y, out);
            }
        }
    }
}
