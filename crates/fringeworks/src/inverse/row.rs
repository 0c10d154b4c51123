//! Inversion of one row.

use super::Options;
use super::extrema::Finder;
use super::matched::{MatchedPart, matched_parts};
use super::matching::match_orders;
use super::part::{Inverse, Span, spans};
use crate::Reason;
use crate::moving_mean::Number;
use crate::spline::{Place, RowSpline, uniform_pivots, uniform_slopes};

/// Upper bound on σ, in periods: where the slope vanishes, the neighbouring parts bound the error.
const MAX_SIGMA_PERIODS: f64 = 0.25;

/// One row of the frames, in either precision.
pub struct RowIn<'a, T> {
    pub reference: &'a [T],
    pub object: &'a [T],
    pub mask: &'a [u8],
    pub guide: Option<&'a [f32]>,
}

/// One row of the result.
pub struct RowOut<'a> {
    pub displacement: &'a mut [f64],
    pub sigma: &'a mut [f32],
    pub modulation_ratio: &'a mut [f32],
    pub reason: &'a mut [Reason],
}

/// Arrays that are used again from row to row, and what all rows share.
pub struct Scratch {
    /// Reference and object in double precision.
    frames: [Vec<f64>; 2],
    slopes: Slopes,
    finder: Finder,
}

/// Slopes of the splines of both rows.
struct Slopes {
    reference: Vec<f64>,
    object: Vec<f64>,
    pivots: Vec<f64>,
}

impl Slopes {
    /// Splines of the reference row and of the object row.
    fn splines<'a>(&'a mut self, frames: &'a [Vec<f64>; 2]) -> (RowSpline<'a>, RowSpline<'a>) {
        let [reference, object] = frames;
        uniform_slopes(
            [reference, object],
            [&mut self.reference, &mut self.object],
            &self.pivots,
        );
        let reference = RowSpline {
            y: reference,
            slopes: &self.reference,
        };
        let object = RowSpline {
            y: object,
            slopes: &self.object,
        };
        (reference, object)
    }
}

impl Scratch {
    pub fn new(width: usize, options: &Options) -> Self {
        Self {
            frames: [vec![0.0; width], vec![0.0; width]],
            slopes: Slopes {
                reference: vec![0.0; width],
                object: vec![0.0; width],
                pivots: uniform_pivots(width),
            },
            finder: Finder::new(options.period, options.prominence, options.floor),
        }
    }

    /// Invert one row; `s` and `d` are the splines of reference and object, as in theory §2.
    pub fn invert_row<T: Number>(
        &mut self,
        frames: &RowIn<T>,
        options: &Options,
        out: &mut RowOut,
    ) {
        let [reference, object] = &mut self.frames;
        widen(frames.reference, reference);
        widen(frames.object, object);
        let (s, d) = self.slopes.splines(&self.frames);
        let (s_extrema, d_extrema) = (self.finder.find(&s), self.finder.find(&d));
        let orders = match_orders(
            &s_extrema,
            &d_extrema,
            options.period,
            options.max_displacement,
            frames.guide,
        );
        let parts = spans(&s, &s_extrema);
        if s_extrema.is_empty() || d_extrema.is_empty() {
            out.reason.fill(Reason::LowModulation);
        }
        let tolerance = options.albedo_tolerance;
        let all = matched_parts(&d, &d_extrema, &s_extrema, &orders, tolerance);
        let mut wanted = vec![false; parts.len()];
        all.iter().for_each(|matched| wanted[matched.part] = true);
        let inverses = Inverse::build_all(&s, &parts, &wanted, options);
        for matched in &all {
            match &inverses[matched.part] {
                Some(inverse) => {
                    let reference = Part {
                        row: &s,
                        span: &parts[matched.part],
                        inverse,
                        at_end: matched.part == 0 || matched.part + 1 == parts.len(),
                    };
                    invert_part(&reference, d.y, matched, options, out);
                }
                None => out.reason[matched.pixels(d.y.len())].fill(Reason::LowModulation),
            }
        }
        apply_mask(frames.mask, out);
    }
}

/// The values in double precision.
fn widen<T: Number>(values: &[T], out: &mut [f64]) {
    for (out, value) in out.iter_mut().zip(values) {
        *out = value.wide();
    }
}

/// A part of the reference row, ready to be inverted.
struct Part<'a> {
    row: &'a RowSpline<'a>,
    span: &'a Span,
    inverse: &'a Inverse,
    /// Whether it is the first or last part of the row, beyond which the frame ends.
    at_end: bool,
}

/// Invert the pixels of a matched part of the object row.
fn invert_part(
    reference: &Part,
    object: &[f64],
    matched: &MatchedPart,
    options: &Options,
    out: &mut RowOut,
) {
    let last_sample = (object.len() - 1) as f64;
    let max_sigma = MAX_SIGMA_PERIODS * options.period;
    let mut place = Place::default();
    for x in matched.pixels(object.len()) {
        let intensity = (object[x] - matched.offset) / matched.modulation_ratio;
        let Some(value) = clamp_to(reference.span, intensity, options.tolerance) else {
            out.reason[x] = if reference.at_end {
                Reason::Outside
            } else {
                Reason::OutOfRange
            };
            continue;
        };
        let position = reference
            .inverse
            .at(reference.row, value, &mut place)
            .clamp(0.0, last_sample);
        out.displacement[x] = x as f64 - position;
        let slope = reference.row.cubic(position).slope(position);
        let slope = (matched.modulation_ratio * slope).abs();
        out.sigma[x] = (options.noise / slope).min(max_sigma) as f32;
        out.modulation_ratio[x] = matched.modulation_ratio as f32;
        out.reason[x] = Reason::Ok;
    }
}

fn apply_mask(mask: &[u8], out: &mut RowOut) {
    for (x, wanted) in mask.iter().enumerate() {
        if *wanted == 0 {
            out.displacement[x] = f64::NAN;
            out.sigma[x] = f32::NAN;
            out.modulation_ratio[x] = f32::NAN;
            out.reason[x] = Reason::Masked;
        }
    }
}

/// The intensity, moved to the end of its part where it exceeds the part by no more than the
/// tolerance.
fn clamp_to(span: &Span, intensity: f64, tolerance: f64) -> Option<f64> {
    let (low, high) = (
        span.value_from.min(span.value_to),
        span.value_from.max(span.value_to),
    );
    let slack = tolerance * (high - low);
    (intensity >= low - slack && intensity <= high + slack).then(|| intensity.clamp(low, high))
}
