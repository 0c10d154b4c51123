//! The frames of one period, and the least-squares problem of their shifts.

use super::harmonics::{MOST_ORDERS, amplitudes_of};
use super::solver::{Solver, planned_row};
use super::table::Table;
use crate::{Error, check_value};
use std::ops::RangeInclusive;

/// Numbers of phase steps: three determine A, B and φ; 64 frames have a bit each in a `u64`.
const STEPS: RangeInclusive<usize> = 3..=64;

/// Errors of a cosine that are its rounding: far below that of an f32, which the sums are computed in.
const ROUNDING: f64 = 1e-12;

/// What the fit of A, c and s leaves of every frame of a set, in shares of its harmonics.
#[derive(Clone, Default)]
pub struct Harmonics {
    /// Orders k, rising from 2.
    pub orders: Vec<u32>,
    /// Shares of B cos kφ and B sin kφ, order after order, frame after frame; nothing where empty.
    pub shares: Vec<f64>,
}

impl Harmonics {
    fn check(&self, frames: usize) -> Result<(), Error> {
        let orders = &self.orders;
        let rising = orders.is_sorted_by(|a, b| a < b) && orders.iter().all(|&k| k > 1);
        check_value("orders", rising, "rising from 2", orders)?;
        let few = orders.len() <= MOST_ORDERS;
        check_value("orders", few, "at most 8", orders.len())?;
        let expected = 2 * frames * orders.len();
        crate::check_length("harmonics", self.shares.len(), expected)
    }
}

/// Frames I_n = A + B cos(φ − δ_n) of one period.
pub struct PhaseSet {
    /// Index of each frame.
    pub frames: Vec<usize>,
    /// 1 / period, turns per projector px.
    pub frequency: f32,
    /// Phase errors of the response, which are subtracted.
    pub table: Table,
    /// Variance of the phase error that does not shrink with the modulation, rad².
    pub floor: f32,
    /// Whether all samples are needed: a pattern that is no cosine has harmonics, which the fit leaves
    /// out only with all of them. A pixel with a sample at the limit then has no phase.
    pub whole: bool,
    /// Harmonics that matter where samples at the limit are left out.
    pub harmonics: Harmonics,
    /// What the fit of (A, c, s) makes of the offsets of the frames, counts: it is subtracted.
    pub(super) offset: [f32; 3],
    cos: Vec<f32>,
    sin: Vec<f32>,
    /// Steps where cos δ is 1 and −1, then those where sin δ is: four steps of a quarter turn.
    pub(super) quarters: Option<[usize; 4]>,
    /// What every frame shows of (A, c, s).
    pub(super) design: Vec<[f64; 3]>,
    pub(super) solver: Solver,
}

impl PhaseSet {
    /// A set of steps δ_n in rad; the period in projector px. `design` is what every frame really
    /// shows of (A, c, s); empty for that of the shifts.
    ///
    /// ```
    /// use fringeworks::decode::PhaseSet;
    ///
    /// let quarters = [0.0, 0.25, 0.5, 0.75].map(|turns| turns * std::f64::consts::TAU);
    /// let set = PhaseSet::new(vec![0, 1, 2, 3], &quarters, vec![], 16.0)?;
    /// assert_eq!(set.frequency, 1.0 / 16.0);
    /// // Two steps do not determine three unknowns.
    /// assert!(PhaseSet::new(vec![0, 1], &quarters[..2], vec![], 16.0).is_err());
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn new(
        frames: Vec<usize>,
        shifts: &[f64],
        design: Vec<[f64; 3]>,
        period: f64,
    ) -> Result<Self, Error> {
        crate::check_length("shifts", shifts.len(), frames.len())?;
        let design = if design.is_empty() {
            shifts.iter().map(|&shift| planned_row(shift)).collect()
        } else {
            design
        };
        crate::check_length("design", design.len(), frames.len())?;
        let enough = STEPS.contains(&frames.len());
        check_value("steps", enough, "3 to 64", frames.len())?;
        check_value("period", period > 0.0 && period.is_finite(), "> 0", period)?;
        let solver = Solver::new(shifts, &design).ok_or(Error::Value {
            name: "shifts",
            expected: "three or more that differ",
            got: format!("{shifts:?}"),
        })?;
        Ok(Self {
            frames,
            frequency: (1.0 / period) as f32,
            table: Table::default(),
            floor: 0.0,
            whole: false,
            harmonics: Harmonics::default(),
            offset: [0.0; 3],
            quarters: quarters(shifts),
            cos: shifts.iter().map(|d| d.cos() as f32).collect(),
            sin: shifts.iter().map(|d| d.sin() as f32).collect(),
            design,
            solver,
        })
    }

    /// The set with frames that show other light besides, the same at every pixel, counts; nothing
    /// where empty.
    ///
    /// It must be a sum of what the frames show of A, c and s, so that any of the frames tell it.
    ///
    /// ```
    /// use fringeworks::decode::PhaseSet;
    ///
    /// let thirds = [0.0, 1.0, 2.0].map(|k| k * std::f64::consts::TAU / 3.0);
    /// let set = PhaseSet::new(vec![0, 1, 2], &thirds, vec![], 16.0)?;
    /// assert!(set.with_offsets(&[1.0, -0.5]).is_err());
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// For a number of offsets that is not that of the frames.
    pub fn with_offsets(mut self, offsets: &[f64]) -> Result<Self, Error> {
        if !offsets.is_empty() {
            crate::check_length("offsets", offsets.len(), self.steps())?;
            self.offset = amplitudes_of(&self, |n| offsets[n]).map(|v| v as f32);
            self.solver.balanced = false; // The short solution leaves no place for offsets.
        }
        Ok(self)
    }

    pub(in super::super) fn check(&self, frames: usize) -> Result<(), Error> {
        let inside = self.frames.iter().all(|&k| k < frames);
        check_value("frames of a set", inside, "frames that exist", &self.frames)?;
        check_value("floor", self.floor >= 0.0, ">= 0", self.floor)?;
        self.harmonics.check(self.steps())?;
        self.table.check()
    }

    /// Number of phase steps.
    ///
    /// ```
    /// use fringeworks::decode::PhaseSet;
    ///
    /// assert_eq!(PhaseSet::new(vec![3, 4, 5], &[0.0, 2.1, 4.2], vec![], 16.0)?.steps(), 3);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn steps(&self) -> usize {
        self.frames.len()
    }

    /// Cosine and sine of the shift of step `n`.
    #[inline(always)]
    pub(in super::super) fn phasor(&self, n: usize) -> (f32, f32) {
        (self.cos[n], self.sin[n])
    }
}

/// See [`PhaseSet::quarters`].
fn quarters(shifts: &[f64]) -> Option<[usize; 4]> {
    let at = |cos: f64, sin: f64| {
        let here = |d: &f64| (d.cos() - cos).abs() + (d.sin() - sin).abs() < ROUNDING;
        shifts.iter().position(here)
    };
    let found = [at(1.0, 0.0)?, at(-1.0, 0.0)?, at(0.0, 1.0)?, at(0.0, -1.0)?];
    (shifts.len() == 4).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn three_equal_shifts_are_refused() {
        assert!(PhaseSet::new(vec![0, 1, 2], &[0.0, TAU, 2.0 * TAU], vec![], 10.0).is_err());
        assert!(PhaseSet::new(vec![0, 1], &[0.0, 1.0], vec![], 10.0).is_err());
    }
}
