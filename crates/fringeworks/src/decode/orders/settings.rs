//! What a plan knows before any pixel: the chain of roundings, the noise, and the limits.

use crate::{Error, check_length, check_value};

/// The chain of roundings that gives the fringe orders of all sets (temporal unwrapping, theory §5).
///
/// The caller has proved it: each rounding keeps a margin against the noise. A pixel must also show that
/// its noise cannot have led to another coordinate in the range.
pub struct Chain {
    /// Integer coefficients of the phases, one row per combination with one value per set.
    pub combinations: Vec<f32>,
    /// Frequency of every combination, turns per px.
    pub frequencies: Vec<f32>,
    /// Squared amplification of the phase errors by every rounding, rows as above.
    pub amplification: Vec<f32>,
    /// Squared margin of every rounding divided by the squared confidence, turns²; infinite where
    /// only the remainder decides.
    pub margin: Vec<f32>,
    /// Index of the remainder of every rounding: those of the combinations, then those of the sets.
    pub remainder: Vec<usize>,
    /// Distance from a remainder of zero to the nearest one of another coordinate in the range,
    /// one per rounding, turns; at least ½.
    pub alternative: Vec<f32>,
    /// Coefficients of u² and u³ in the phase variance that roundings are judged by, over that of u,
    /// the variance with the measured modulation in place of the true one, rad².
    pub order_variance: [f32; 2],
    /// Middle of the range of coordinates, px.
    pub middle: f32,
    /// Half the range of coordinates, px.
    pub half: f32,
    /// Distance after which all phases repeat, px; infinite where they do not.
    pub repeats: f32,
    /// Whether both ends of the range are the same place: a coordinate modulo `repeats`.
    pub circular: bool,
}

impl Chain {
    pub(in super::super) fn check(&self, sets: usize) -> Result<(), Error> {
        let n = self.frequencies.len();
        check_value("chain", sets == 0 || n > 0, "a combination", n)?;
        check_length("combinations", self.combinations.len(), n * sets)?;
        check_length(
            "amplification",
            self.amplification.len(),
            self.margin.len() * sets,
        )?;
        check_length("remainder", self.remainder.len(), self.margin.len())?;
        check_length("alternative", self.alternative.len(), self.margin.len())?;
        let known = self.remainder.iter().all(|&k| k < n + sets);
        check_value("remainder", known, "a rounding", &self.remainder)?;
        let positive = self.frequencies.iter().all(|&g| g > 0.0);
        check_value("frequencies", positive, "> 0", &self.frequencies)?;
        check_value("range", self.half > 0.0, "> 0", self.half)?;
        check_value("repeats", self.repeats > 0.0, "> 0", self.repeats)
    }
}

/// Noise of the camera: read noise and shot noise.
pub struct Noise {
    /// Counts².
    pub read_variance: f32,
    /// Variance per count of brightness, counts.
    pub gain: f32,
}

impl Noise {
    /// Variance of a count at some brightness, counts².
    #[inline(always)]
    pub fn variance(&self, brightness: f32) -> f32 {
        self.read_variance + self.gain * brightness.max(0.0)
    }
}

/// Limits that a pixel must keep.
pub struct Limits {
    /// Counts from which on a sample is not used; NaN for none.
    pub saturation: f32,
    /// Least modulation over its standard deviation; below, there is no fringe.
    pub min_snr: f32,
    /// Least modulation, counts.
    pub min_modulation: f32,
    /// Largest χ² of the sets' disagreement.
    pub max_disagreement: f32,
    /// Factor on the variances that is usual in the scene, see `Outputs::inflation`; ≥ 1.
    pub usual_inflation: f32,
    /// Standard deviations that decisions must be safe by.
    pub confidence: f32,
    /// Standard deviations that the noise must stay away from another coordinate in the range.
    pub order_confidence: f32,
}
