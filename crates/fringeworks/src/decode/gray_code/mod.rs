//! Gray code: which cell of the projector a pixel sees.

mod weak;
mod words;

use super::{BLOCK_PIXELS, DecodeSettings, Frames, Line, Sample};
use crate::{Error, check_value};
use words::{read_bits, read_digits};

/// Distance of a bit's brightness from its threshold below which the bit is in doubt, in standard
/// deviations of the noise.
///
/// At 4, noise flips a bit that is not in doubt in 3 of 100 000 cases. A larger value rejects more
/// pixels of weak contrast.
const DOUBT_SIGMAS: f32 = 4.0;

/// Variance of half the difference of two frames, in units of the variance of one frame.
pub const HALF_DIFFERENCE: f32 = 0.5;

/// Variance of a frame minus the mean of two other frames, in units of the variance of one frame.
///
/// Also used where the threshold is the mean of the phase frames, which is less noisy.
const FRAME_MINUS_MEAN: f32 = 1.5;

/// Variance of a frame minus the border of two levels, in units of the variance of one frame.
///
/// The border comes from a white and a black frame. The value is that of the outermost borders; it
/// is 1.5 for a border in the middle.
const FRAME_MINUS_LEVEL: f32 = 2.0;

/// Largest distance of a pixel on a blurred border from that border, in cells.
///
/// A border that is blurred as far as this leaves hardly any modulation to fringes of one cell's
/// width. A larger value accepts pixels inside a cell whose bits are weak because of indirect light.
const BORDER_HALF_WIDTH: f32 = 0.25;

/// Part of the samples below the sensor's limit that are in doubt where it cuts off the light: nearly
/// all of them.
const CLIPPED_DOUBT: f32 = 0.99;

/// Largest number of bits: 2²⁴ cells, the whole numbers that an f32 holds exactly.
const MAX_BITS: usize = 24;

/// Number of words of a code that a `u32` holds with room for one more level.
const MAX_WORDS: f64 = 2_147_483_648.0;

/// Threshold that the bits are compared with.
pub enum Against {
    /// The frame with this bit inverted, one per bit.
    Inverse(Vec<usize>),
    /// The mean of a white and a black frame.
    WhiteBlack {
        /// Index of the white frame.
        white: usize,
        /// Index of the black frame.
        black: usize,
    },
    /// The mean of the phase frames.
    Mean,
}

/// Gray code along one axis, the most significant bit first.
///
/// With more than two levels of brightness its bits are digits: a reflected code of that base.
pub struct GrayCode {
    /// Index of the frame of each bit.
    pub bits: Vec<usize>,
    /// What they are compared with.
    pub against: Against,
    /// Number of levels of brightness; 2 for bits.
    pub levels: u32,
    /// Bits, or digits, that are shown light for dark: 1 at the place of each, the least significant
    /// bit at place 0.
    pub inverted: u32,
    /// Width of a cell, projector px.
    pub step: f32,
    /// Start of the first cell, projector px from the projector's edge.
    pub offset: f32,
    /// Number of cells; a code word beyond has no meaning.
    pub cells: u32,
    /// Share of a bit's contrast below which the bit is in doubt, besides the doubt by noise. Above
    /// 0, the blurred border of a cell is recognised even where there is hardly any noise.
    pub doubt_share: f32,
    /// Largest distance of a bit's brightness from its threshold, in contrasts, besides noise; beyond
    /// it, the light is not that of the projector alone.
    pub alien_share: f32,
    /// Largest half width of the range of cells of a pixel without phases, px. Its firm bits leave a
    /// wider range where the light of other surfaces reaches it rather than that of the projector.
    pub widest: f32,
    /// Distance from the border of two cells within which blur leaves its bit in doubt, px; without
    /// phases, the brightness of the bit tells the place within it. Infinite where unknown.
    pub blurred: f32,
    /// Distance beyond the half width around the start at which a coordinate is still accepted, px.
    pub slack: f32,
    /// Distance that a coordinate one period away must keep from that half width, px.
    pub guard: f32,
    /// Standard deviations by which a coordinate must differ from one that is a period away.
    pub confidence: f32,
}

impl GrayCode {
    pub(super) fn check(&self, frames: usize) -> Result<(), Error> {
        let n = self.bits.len();
        check_value(
            "bits of the code",
            (1..=MAX_BITS).contains(&n),
            "1 to 24",
            n,
        )?;
        check_value("step of the code", self.step > 0.0, "> 0", self.step)?;
        check_value("widest range", self.widest > 0.0, "> 0", self.widest)?;
        check_value("blurred border", self.blurred > 0.0, "> 0", self.blurred)?;
        check_value("levels of the code", self.levels >= 2, ">= 2", self.levels)?;
        let words = f64::from(self.levels).powi(n as i32);
        check_value("words of the code", words < MAX_WORDS, "< 2^31", words)?;
        let inverted = self.inverted >> n;
        check_value("inverted bits", inverted == 0, "bits of the code", inverted)?;
        let finite = self.offset.is_finite();
        check_value("offset of the code", finite, "a finite number", self.offset)?;
        let known = self.levels == 2 || matches!(self.against, Against::WhiteBlack { .. });
        check_value("frames", known, "white and black", "levels without them")?;
        let others: Vec<usize> = match &self.against {
            Against::Inverse(inverse) => {
                check_value("inverse bits", inverse.len() == n, "one per bit", inverse)?;
                inverse.clone()
            }
            Against::WhiteBlack { white, black } => vec![*white, *black],
            Against::Mean => Vec::new(),
        };
        let inside = self.bits.iter().chain(&others).all(|&k| k < frames);
        check_value(
            "frames of the code",
            inside,
            "frames that exist",
            &self.bits,
        )
    }

    /// Variance of the difference of a bit and its threshold, in units of that of one frame.
    fn variance_of_bits(&self) -> f32 {
        match self.against {
            _ if self.levels > 2 => FRAME_MINUS_LEVEL,
            Against::Inverse(_) => HALF_DIFFERENCE,
            Against::WhiteBlack { .. } | Against::Mean => FRAME_MINUS_MEAN,
        }
    }
}

/// Gray code of the pixels of a block.
pub struct GrayCells {
    /// Coordinate that the phases start from, projector px: the middle of the cell or, where a bit
    /// is in doubt, of the range around the border that this bit marks; NaN where the bits do not
    /// tell. Without phases
    /// always the middle of a cell. Infinite where a sample is not finite.
    pub coordinate: Line,
    /// Largest distance of the true coordinate from it, projector px.
    pub half_width: Line,
    /// Threshold: mean of white and black, or of a bit and its inverse, counts.
    pub threshold: Line,
    /// Half their difference, counts: the modulation of the Gray code.
    pub contrast: Line,
    /// Squared distance from its threshold below which a bit is in doubt, counts².
    doubt_below: Line,
    /// Squared distance from its threshold above which no bit of the pixel is used, counts².
    alien_above: Line,
    /// Variance of a bit's distance from its threshold, counts².
    variance: Line,
}

impl GrayCells {
    pub fn new() -> Self {
        let zero = Line::of(0.0);
        Self {
            coordinate: zero,
            half_width: zero,
            threshold: zero,
            contrast: zero,
            doubt_below: zero,
            alien_above: zero,
            variance: zero,
        }
    }
}

/// Read the Gray code of a block from `at` on. `mean` and `modulation` are of the phase frames.
#[inline(always)]
pub fn read_gray_code<T: Sample>(
    frames: &Frames<'_, T>,
    plan: &DecodeSettings,
    code: &GrayCode,
    at: usize,
    (mean, modulation): (&Line, &Line),
    out: &mut GrayCells,
) {
    let n = BLOCK_PIXELS;
    let line = |frame: usize| &frames.planes[frame][at..at + n];
    thresholds(code, line, n, (mean, modulation), out);
    limits_of_doubt(code, plan, n, out);
    let phases = !plan.sets.is_empty();
    if let Against::WhiteBlack { white, .. } = &code.against
        && code.levels == 2
        && !phases
    {
        doubt_of_clipped(line(*white), plan.limits.saturation, n, out);
    }
    if code.levels == 2 {
        read_bits(code, line, n, phases, out);
    } else {
        read_digits(code, line, n, phases, out);
    }
    if T::MAY_BE_INFINITE {
        mark_not_finite(code, line, n, out);
    }
}

/// Distance from the threshold below which a bit is in doubt, and how far from the border between
/// two cells a pixel with such a bit may lie.
#[inline(always)]
fn limits_of_doubt(code: &GrayCode, plan: &DecodeSettings, n: usize, out: &mut GrayCells) {
    let per_frame = code.variance_of_bits();
    let of_contrast = per_frame + HALF_DIFFERENCE;
    let per_level = 1.0 / (code.levels - 1) as f32;
    let (share, confidence) = (code.doubt_share * per_level, code.confidence);
    // A bit of full contrast is further from the limit of doubt than noise can bridge if its
    // contrast exceeds both terms, one for each part of that limit. If so, a bit in doubt means that
    // the pixel lies on a blurred border.
    let by_noise = DOUBT_SIGMAS * per_frame.sqrt() + confidence * of_contrast.sqrt();
    let by_share = confidence * of_contrast.sqrt() / (1.0 - code.doubt_share);
    let clear = (by_noise.max(by_share) / per_level).powi(2);
    let (border, any) = (BORDER_HALF_WIDTH * code.step, code.step);
    for i in 0..n {
        let variance = plan.noise.variance(out.threshold[i]);
        let contrast = out.contrast[i].max(0.0);
        let weak = share * contrast;
        let noise = DOUBT_SIGMAS * DOUBT_SIGMAS * per_frame * variance;
        out.doubt_below[i] = noise.max(weak * weak);
        // The noise is far below the share where it matters, so the sum of squares will do.
        let alien = code.alien_share * contrast;
        out.alien_above[i] = alien * alien + noise;
        out.variance[i] = per_frame * variance;
        out.half_width[i] = if contrast * contrast >= clear * variance {
            border
        } else {
            any
        };
    }
}

/// Adapt the limits of pixels whose white frame is at the saturation, to which its light is cut off.
///
/// Half of that light is at least half of the limit: samples below are dark. Lit ones reach the
/// limit as well, and those between may be either.
#[inline(always)]
fn doubt_of_clipped<T: Sample>(white: &[T], saturation: f32, n: usize, out: &mut GrayCells) {
    for i in 0..n {
        let light = white[i].value();
        if light >= saturation {
            let dark = out.threshold[i] - out.doubt_below[i].sqrt();
            // Samples equal to the limit are not in doubt, in spite of rounding.
            let reach = 0.5 * CLIPPED_DOUBT * (light - dark);
            out.threshold[i] = 0.5 * (light + dark);
            out.doubt_below[i] = reach * reach;
        }
    }
}

/// Make the coordinate infinite where a sample of the code is not finite.
#[inline(always)]
fn mark_not_finite<'a, T: Sample>(
    code: &GrayCode,
    line: impl Fn(usize) -> &'a [T],
    n: usize,
    out: &mut GrayCells,
) {
    let pair;
    let others: &[usize] = match &code.against {
        Against::Inverse(inverse) => inverse,
        Against::WhiteBlack { white, black } => {
            pair = [*white, *black];
            &pair
        }
        Against::Mean => &[],
    };
    // NaN and infinity stay in a sum.
    let mut sum = Line::of(0.0);
    for &frame in code.bits.iter().chain(others) {
        let samples = line(frame);
        for i in 0..n {
            sum[i] += samples[i].value();
        }
    }
    for i in 0..n {
        if !sum[i].is_finite() {
            out.coordinate[i] = f32::INFINITY;
        }
    }
}

/// Threshold and contrast of `n` pixels.
#[inline(always)]
fn thresholds<'a, T: Sample>(
    code: &GrayCode,
    line: impl Fn(usize) -> &'a [T],
    n: usize,
    (mean, modulation): (&Line, &Line),
    out: &mut GrayCells,
) {
    match &code.against {
        Against::Mean => {
            out.threshold = *mean;
            out.contrast = *modulation;
        }
        Against::WhiteBlack { white, black } => {
            mean_and_contrast(line(*white), line(*black), n, out);
        }
        Against::Inverse(inverse) => {
            mean_and_contrast(line(code.bits[0]), line(inverse[0]), n, out);
            // No pixel lies on borders of both of the first bits: one of them and its inverse show
            // full white and full black.
            let second = 1.min(code.bits.len() - 1);
            let (bits, other) = (line(code.bits[second]), line(inverse[second]));
            for i in 0..n {
                let contrast = 0.5 * (bits[i].value() - other[i].value());
                out.contrast[i] = out.contrast[i].abs().max(contrast.abs());
            }
        }
    }
}

#[inline(always)]
fn mean_and_contrast<T: Sample>(bright: &[T], dark: &[T], n: usize, out: &mut GrayCells) {
    for i in 0..n {
        out.threshold[i] = 0.5 * (bright[i].value() + dark[i].value());
        out.contrast[i] = 0.5 * (bright[i].value() - dark[i].value());
    }
}

#[cfg(test)]
mod tests_of_words {
    use super::*;

    /// A code of cells of 1 px from coordinate 0 on.
    pub fn code(bits: usize) -> GrayCode {
        GrayCode {
            bits: (0..bits).collect(),
            against: Against::Mean,
            levels: 2,
            inverted: 0,
            step: 1.0,
            offset: 0.5,
            cells: 1 << bits,
            doubt_share: 0.0,
            alien_share: 2.0,
            widest: f32::INFINITY,
            blurred: f32::INFINITY,
            slack: 0.0,
            guard: 0.0,
            confidence: 5.0,
        }
    }
}
