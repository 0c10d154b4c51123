//! What a plan knows before any pixel: the chain of roundings, the noise, and the limits.

use crate::{Error, check_length, check_value};

/// The chain of roundings that gives the fringe orders of all sets (temporal unwrapping, theory §5).
///
/// The caller has proved it: each rounding keeps a margin against the noise. A pixel must also show that
/// its noise cannot have led to another coordinate in the range, which with a Gray code is enough.
pub struct Chain {
    /// Integer coefficients of the phases, one row per combination with one value per set.
    pub combinations: Vec<f32>,
    /// Frequency of every combination, turns per px.
    pub frequencies: Vec<f32>,
    /// Squared amplification of the phase errors by every rounding, rows as above.
    pub amplification: Vec<f32>,
    /// Largest variance of the error of every rounding, turns²: its squared margin divided by the squared
    /// confidence; infinite where only the remainder decides.
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

/// Standard deviations that decisions of a chain must be safe by, and half a turn over them, squared.
const SIGMAS: f32 = 5.0;
const HALF_TURN: f32 = (0.5 / SIGMAS) * (0.5 / SIGMAS);

/// Coefficients of σ⁴ and σ⁶ in the phase variance that roundings are judged by: the expected variance of
/// a phase whose modulation is as noisy as the one measured.
const ORDER_VARIANCE: [f32; 2] = [25.0 / 3.0, 111.0];

impl Chain {
    /// The chain of a hierarchy: sets of falling periods, the first of which covers the whole range.
    ///
    /// Coordinates run from −½ to half a pixel less than the first period. Every phase is unwrapped by
    /// the one before.
    ///
    /// ```
    /// use fringeworks::decode::Chain;
    ///
    /// let chain = Chain::hierarchy(&[1024.0, 128.0, 16.0])?;
    /// assert_eq!((chain.middle, chain.half), (511.5, 512.0));
    /// // An error of a phase counts eightfold where the next one is unwrapped.
    /// assert_eq!(chain.amplification[..3], [64.0, 1.0, 0.0]);
    /// assert!(Chain::hierarchy(&[16.0, 128.0]).is_err());
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn hierarchy(periods: &[f64]) -> Result<Self, Error> {
        let sets = periods.len();
        let falling = periods.windows(2).all(|pair| pair[0] > pair[1]);
        let positive = periods.iter().all(|p| *p > 0.0 && p.is_finite());
        let usable = sets > 0 && falling && positive;
        check_value("periods", usable, "one or more, falling", periods)?;
        // The last set needs no combination: nothing is unwrapped by it.
        let n = sets.max(2) - 1;
        let one = |k: usize, value: f32| (0..sets).map(move |i| if i == k { value } else { 0.0 });
        let judged = |k: usize| {
            let factor = (periods[k - 1] / periods[k]).powi(2) as f32;
            one(k - 1, factor).zip(one(k, 1.0)).map(|(a, b)| a + b)
        };
        Ok(Self {
            combinations: (0..n).flat_map(|k| one(k, 1.0)).collect(),
            frequencies: periods[..n].iter().map(|p| (1.0 / p) as f32).collect(),
            amplification: (1..sets).flat_map(judged).collect(),
            margin: vec![HALF_TURN; sets - 1],
            remainder: (1..sets).map(|k| if k < n { k } else { n + k }).collect(),
            alternative: vec![1.0; sets - 1],
            order_variance: ORDER_VARIANCE,
            middle: (0.5 * periods[0] - 0.5) as f32,
            half: (0.5 * periods[0]) as f32,
            repeats: periods[0] as f32,
            circular: false,
        })
    }

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
    ///
    /// ```
    /// use fringeworks::decode::Noise;
    ///
    /// let noise = Noise { read_variance: 2.0, gain: 0.1 };
    /// assert_eq!(noise.variance(100.0), 12.0);
    /// ```
    #[inline(always)]
    pub fn variance(&self, brightness: f32) -> f32 {
        self.read_variance + self.gain * brightness.max(0.0)
    }
}

/// Limits that a pixel must keep. The default ones refuse what is not safe, but no count and no
/// disagreement.
///
/// ```
/// use fringeworks::decode::Limits;
///
/// let limits = Limits {
///     saturation: 255.0,
///     ..Limits::default()
/// };
/// assert_eq!(limits.min_snr, 4.0);
/// ```
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

impl Default for Limits {
    fn default() -> Self {
        Self {
            saturation: f32::NAN,
            min_snr: 4.0,
            min_modulation: 0.0,
            max_disagreement: f32::INFINITY,
            usual_inflation: 1.0,
            confidence: 3.0,
            order_confidence: 6.0,
        }
    }
}
