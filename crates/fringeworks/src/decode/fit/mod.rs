//! Phase, modulation and background of one set of steps, by least squares at every pixel.

mod angle;
mod frames;
mod saturation;
mod set;
mod solver;
mod sums;
mod table;

use super::{Lanes, Line, Plan, Sample, BLOCK_PIXELS, LANES};
use std::ops::Range;

use angle::angle;
pub use frames::Frames;
use saturation::{fit_unsaturated, refit};
pub use set::PhaseSet;
use solver::{precision, solve};
use sums::Sums;
pub use table::{Table, TABLE_BINS};

/// Precision of a phase that the unsaturated samples do not determine; true ones are not negative.
pub const NO_PRECISION: f32 = -1.0;

/// Fit of one set at the pixels of a block.
pub struct Fitted {
    /// Wrapped phase, turns, −½ … ½; NaN where the samples do not determine it.
    pub turns: Line,
    /// Inverse variance of the phase, 1/rad², for noise of one count².
    pub precision: Line,
    /// Brightness that shot noise is computed from, counts. The decoder replaces it by the variance
    /// of the phase, turns²: one array instead of two keeps the block in the first cache.
    pub brightness_or_variance: Line,
    /// A, counts.
    pub background: Line,
    /// B², counts².
    pub power: Line,
}

impl Fitted {
    pub fn new() -> Self {
        let zero = [0.0; BLOCK_PIXELS];
        Self {
            turns: zero,
            precision: zero,
            brightness_or_variance: zero,
            background: zero,
            power: zero,
        }
    }
}

/// Fit one set at the pixels `at`. Samples at the sensor's limit are left out.
#[inline(always)]
pub fn fit<T: Sample>(
    frames: &Frames<'_, T>,
    plan: &Plan,
    index: usize,
    at: Range<usize>,
    out: &mut Fitted,
) {
    let (set, limit) = (&plan.sets[index], plan.limits.saturation);
    // Saturation clusters: after a saturated group, try the saturated path first.
    let (mut needs_refit, mut expect_saturated) = (false, false);
    for (k, start) in at.clone().step_by(LANES).enumerate() {
        let sums = if expect_saturated {
            None
        } else {
            Some(frames.sums(set, start, limit))
        };
        if let Some((sums, false)) = sums {
            let amplitudes = solve(set, &sums);
            let precision = precision(set, &amplitudes);
            store(set, &amplitudes, &precision, k * LANES, out);
        } else {
            let (sums, saturated) = frames.sums_below(set, start, limit);
            let saturation = fit_unsaturated(set, sums, &saturated, k * LANES, out);
            expect_saturated = saturation.any;
            needs_refit = needs_refit || saturation.needs_refit;
        }
    }
    if needs_refit {
        refit(frames, plan, index, at, out);
    }
    if !set.table.brightness.is_empty() {
        table::correct(&set.table, out);
    }
}

/// Store phase, modulation, background and brightness of a group in the arrays of the block.
#[inline(always)]
fn store(set: &PhaseSet, fitted: &Sums, precision: &Lanes, start: usize, out: &mut Fitted) {
    let (cos, sin) = (&fitted.cos, &fitted.sin);
    let (mut power, mut turns, mut brightness) = ([0.0; LANES], [0.0; LANES], fitted.plain);
    for i in 0..LANES {
        power[i] = cos[i] * cos[i] + sin[i] * sin[i];
        turns[i] = angle(sin[i], cos[i]);
    }
    if let Some(skew) = &set.solver.skew {
        for i in 0..LANES {
            let (c, s) = (cos[i], sin[i]);
            let cubic = c * c * (skew[0] * c + skew[1] * s) + s * s * (skew[2] * c + skew[3] * s);
            brightness[i] += cubic / power[i];
        }
    }
    let place = start..start + LANES;
    out.turns[place.clone()].copy_from_slice(&turns);
    out.precision[place.clone()].copy_from_slice(precision);
    out.power[place.clone()].copy_from_slice(&power);
    out.background[place.clone()].copy_from_slice(&fitted.plain);
    out.brightness_or_variance[place].copy_from_slice(&brightness);
}
