//! From stacks of shifted fringes and Gray code to projector coordinates, in one pass.
//!
//! Pixels go in blocks that stay in the first cache: sums of the frames with cosine and sine of
//! their shifts ([`fit`]), the phase of every period, Gray code ([`code`]), then the orders of all
//! periods by the chain that the plan proved, the weighted mean of the coordinate and its variance
//! ([`orders`]). Sums may also come from a [`stream`] that took the frames one by one; the
//! operations on a pixel are the same in the same order, and so is the result.
//!
//! Multiplications and additions are kept apart (no fused ones), so that all instruction sets give
//! the same numbers.

mod code;
mod fit;
mod orders;
pub mod stream;

use crate::{check_length, check_value, Error};
use rayon::prelude::*;

pub use code::{Against, Code};
pub use fit::{PhaseSet, Table, TABLE};
pub use orders::{Chain, Limits, Noise};

/// Pixels that are worked on together; the arrays of a block stay in the first cache.
pub(crate) const BLOCK: usize = 1024;
/// Pixels per task of a thread.
const BAND: usize = 8 * BLOCK;
pub(crate) type Line = [f32; BLOCK];
/// Pixels whose values stay in registers; a divisor of a block.
pub(crate) const LANES: usize = 64;
pub(crate) type Lanes = [f32; LANES];

/// A kind of camera count, and the kernels compiled for it.
pub trait Sample: Copy + Default + Send + Sync + PartialOrd + 'static {
    fn value(self) -> f32;
    fn larger(self, other: Self) -> Self;
    #[doc(hidden)]
    fn frames(task: Task<'_, fit::Frames<'_, Self>>);
    #[doc(hidden)]
    fn streamed(task: Task<'_, stream::Sums<'_, Self>>);
}

/// A band of pixels to decode.
#[doc(hidden)]
pub struct Task<'a, S> {
    source: &'a S,
    plan: &'a Plan,
    start: usize,
    out: Outputs<'a>,
    scratch: &'a mut orders::Scratch,
}

macro_rules! sample {
    ($type:ident, $frames:ident, $streamed:ident) => {
        #[multiversion::multiversion(targets(
            "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
            "x86_64+avx2+fma"
        ))]
        fn $frames(task: Task<'_, fit::Frames<'_, $type>>) {
            band(task);
        }

        #[multiversion::multiversion(targets(
            "x86_64+avx512f+avx512bw+avx512dq+avx512vl",
            "x86_64+avx2+fma"
        ))]
        fn $streamed(task: Task<'_, stream::Sums<'_, $type>>) {
            band(task);
        }

        impl Sample for $type {
            #[inline(always)]
            fn value(self) -> f32 {
                f32::from(self)
            }
            #[inline(always)]
            fn larger(self, other: Self) -> Self {
                self.max(other)
            }
            fn frames(task: Task<'_, fit::Frames<'_, Self>>) {
                $frames(task);
            }
            fn streamed(task: Task<'_, stream::Sums<'_, Self>>) {
                $streamed(task);
            }
        }
    };
}
sample!(u8, frames_u8, streamed_u8);
sample!(u16, frames_u16, streamed_u16);
sample!(f32, frames_f32, streamed_f32);

/// What is decoded along one axis of the projector.
pub struct Plan {
    /// Sets of steps, one per period.
    pub sets: Vec<PhaseSet>,
    /// Gray code beside them; the coordinate comes from it alone where there are no sets.
    pub code: Option<Code>,
    /// How orders are found; one combination at least where there are sets.
    pub chain: Chain,
    pub noise: Noise,
    pub limits: Limits,
}

impl Plan {
    fn check(&self, frames: usize) -> Result<(), Error> {
        for set in &self.sets {
            set.check(frames)?;
        }
        if let Some(code) = &self.code {
            code.check(frames)?;
        }
        check_value(
            "plan",
            !self.sets.is_empty() || self.code.is_some(),
            "phases or a code",
            "neither",
        )?;
        self.chain.check(self.sets.len(), self.code.is_some())
    }

    /// The set with the shortest period: it carries the coordinate.
    fn finest(&self) -> usize {
        let f = |k: &usize| self.sets[*k].frequency;
        (0..self.sets.len())
            .max_by(|a, b| f(a).total_cmp(&f(b)))
            .unwrap_or(0)
    }
}

/// Where results go: maps of as many pixels as the frames have.
pub struct Outputs<'a> {
    /// Projector coordinate, px; NaN where not measured.
    pub coordinate: &'a mut [f32],
    /// Its standard deviation, px.
    pub sigma: &'a mut [f32],
    /// Modulation of the set with the shortest period, counts.
    pub modulation: &'a mut [f32],
    /// Mean of the phase frames, counts.
    pub background: &'a mut [f32],
    /// See [`crate::reason`].
    pub reason: &'a mut [u8],
    /// Wrapped phases, rad, and modulations, counts: a map per set after another; or empty.
    pub phases: Vec<&'a mut [f32]>,
    pub modulations: Vec<&'a mut [f32]>,
    /// Disagreement of the sets, χ²; or empty.
    pub disagreement: &'a mut [f32],
}

impl<'a> Outputs<'a> {
    fn check(&self, pixels: usize, sets: usize) -> Result<(), Error> {
        check_length("coordinate", self.coordinate.len(), pixels)?;
        check_length("sigma", self.sigma.len(), pixels)?;
        check_length("modulation", self.modulation.len(), pixels)?;
        check_length("background", self.background.len(), pixels)?;
        check_length("reason", self.reason.len(), pixels)?;
        for maps in [&self.phases, &self.modulations] {
            if !maps.is_empty() {
                check_length("phases", maps.len(), sets)?;
            }
            for map in maps {
                check_length("phases", map.len(), pixels)?;
            }
        }
        if !self.disagreement.is_empty() {
            check_length("disagreement", self.disagreement.len(), pixels)?;
        }
        Ok(())
    }

    /// The first `n` pixels, and the rest.
    fn split(self, n: usize) -> (Self, Self) {
        let (coordinate, coordinate_rest) = self.coordinate.split_at_mut(n);
        let (sigma, sigma_rest) = self.sigma.split_at_mut(n);
        let (modulation, modulation_rest) = self.modulation.split_at_mut(n);
        let (background, background_rest) = self.background.split_at_mut(n);
        let (reason, reason_rest) = self.reason.split_at_mut(n);
        let halves = |maps: Vec<&'a mut [f32]>| -> (Vec<&'a mut [f32]>, Vec<&'a mut [f32]>) {
            maps.into_iter().map(|map| map.split_at_mut(n)).unzip()
        };
        let (phases, phases_rest) = halves(self.phases);
        let (modulations, modulations_rest) = halves(self.modulations);
        let at = n.min(self.disagreement.len());
        let (disagreement, disagreement_rest) = self.disagreement.split_at_mut(at);
        (
            Self {
                coordinate,
                sigma,
                modulation,
                background,
                reason,
                phases,
                modulations,
                disagreement,
            },
            Self {
                coordinate: coordinate_rest,
                sigma: sigma_rest,
                modulation: modulation_rest,
                background: background_rest,
                reason: reason_rest,
                phases: phases_rest,
                modulations: modulations_rest,
                disagreement: disagreement_rest,
            },
        )
    }
}

/// Where the sums of a set come from: the frames themselves, or a stream that has seen them.
pub(crate) trait Source: Sync + Sized {
    type Sample: Sample;
    /// Decode a band, compiled for this source.
    fn run(task: Task<'_, Self>);
    /// Σ I, Σ I cos δ and Σ I sin δ of a set at a few pixels; true where some sample is at the limit.
    fn sums(&self, index: usize, set: &PhaseSet, at: usize, limit: f32) -> (fit::Sums, bool);
    /// The same without samples at the limit, and what they were.
    fn sums_below(
        &self,
        index: usize,
        set: &PhaseSet,
        at: usize,
        limit: f32,
    ) -> (fit::Sums, fit::LeftOut);
    /// Which frames of the set count at a pixel (a bit each), and their sums.
    fn kept(&self, index: usize, set: &PhaseSet, pixel: usize, limit: f32) -> (u64, [f32; 3]);
    /// A frame of the code.
    fn plane(&self, frame: usize) -> &[Self::Sample];
}

/// Decode frames.
///
/// `frames` are the planes of one axis; `plan` refers to them by their index. All have the length
/// of the outputs.
pub fn decode<T: Sample>(frames: &[&[T]], plan: &Plan, out: Outputs) -> Result<(), Error> {
    let pixels = out.coordinate.len();
    for frame in frames {
        check_length("frame", frame.len(), pixels)?;
    }
    plan.check(frames.len())?;
    run(&fit::Frames { planes: frames }, plan, out)
}

pub(crate) fn run<S: Source>(source: &S, plan: &Plan, out: Outputs) -> Result<(), Error> {
    let pixels = out.coordinate.len();
    out.check(pixels, plan.sets.len())?;
    let mut bands = Vec::with_capacity(pixels / BAND + 1);
    let (mut rest, mut start) = (out, 0);
    while start < pixels {
        let n = BAND.min(pixels - start);
        let (band, after) = rest.split(n);
        bands.push((start, band));
        rest = after;
        start += n;
    }
    bands.into_par_iter().for_each_init(
        || orders::Scratch::new(plan.sets.len()),
        |scratch, (start, out)| {
            S::run(Task {
                source,
                plan,
                start,
                out,
                scratch,
            });
        },
    );
    Ok(())
}

/// One task: block after block.
#[inline(always)]
fn band<S: Source>(task: Task<'_, S>) {
    let n = task.out.coordinate.len();
    let (mut rest, mut done) = (task.out, 0);
    while done < n {
        let (block, after) = rest.split(BLOCK.min(n - done));
        orders::block(
            task.source,
            task.plan,
            task.start + done,
            block,
            task.scratch,
        );
        rest = after;
        done += BLOCK;
    }
}
