//! Phase, modulation and background of one set of steps, by least squares at every pixel.

pub mod angle;
mod frames;
mod harmonics;
mod saturation;
mod set;
mod solver;
mod sums;
mod table;

use super::{DecodeSettings, Line, Sample};

pub use frames::Frames;
use saturation::{clear, leave_out, refit};
pub use set::{Harmonics, PhaseSet};
use solver::solve;
pub use sums::Sums;
pub use table::{TABLE_BINS, Table};

/// Precision of a phase that the unsaturated samples do not determine; true ones are not negative.
pub const NO_PRECISION: f32 = -1.0;

/// Fit of one set at the pixels of a block.
pub struct Fitted {
    /// Wrapped phase, turns, −½ … ½; NaN where the samples do not determine it.
    pub turns: Line,
    /// Inverse variance of the phase, 1/rad², for noise of one count².
    pub precision: Line,
    /// Factor of the variance of the phase where a table corrects it; 1 without a table.
    pub stretch: Line,
    /// Brightness that shot noise is computed from, counts; not kept up where there is none.
    pub brightness: Line,
    /// A, counts.
    pub background: Line,
    /// B², counts².
    pub power: Line,
}

impl Fitted {
    /// That of a set without fringes.
    pub const fn new() -> Self {
        let zero = Line::of(0.0);
        Self {
            turns: zero,
            precision: Line::of(1.0),
            stretch: Line::of(1.0),
            brightness: zero,
            background: zero,
            power: zero,
        }
    }
}

/// Fit one set at a block of pixels from `at` on. Samples at the sensor's limit are left out.
///
/// The result of a pixel does not depend on the other pixels of the block. Returns whether samples
/// were left out that may leave a phase undetermined.
#[inline(always)]
pub fn fit<T: Sample>(
    frames: &Frames<'_, T>,
    plan: &DecodeSettings,
    index: usize,
    at: usize,
    sums: &mut Sums,
    out: &mut Fitted,
) -> bool {
    let (set, limit) = (&plan.sets[index], plan.limits.saturation);
    let shot = plan.noise.gain > 0.0;
    let reached = frames.reach(set, at, limit);
    if reached {
        let saturated = frames.sums_below(set, at, limit, sums);
        solve(set, sums, true, out);
        if set.whole {
            clear(&saturated, out);
        } else {
            let others = leave_out(set, &saturated, sums, out);
            refit(frames, set, (at, limit), &others, out);
        }
    } else if let Some(steps) = frames.quarters(set, at) {
        solve(set, &steps, shot, out);
    } else if let Some(steps) = frames.steps::<3>(set, at) {
        solve(set, &steps, shot, out);
    } else {
        frames.sums(set, at, sums);
        solve(set, sums, shot, out);
    }
    if !set.table.brightness.is_empty() {
        table::correct(&set.table, out);
    }
    reached
}
