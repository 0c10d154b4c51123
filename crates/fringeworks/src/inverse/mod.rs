//! Inverse function analysis by rows: u(x) = x − s⁻¹(d(x)), theory §4.
//!
//! Per row: extrema of both rows, matched by fringe order; the intensities between two matched
//! extrema of the object are inverted through the matching monotone part of the reference.

mod extrema;
mod matching;
mod neighbours;
mod part;

use crate::spline::{uniform_pivots, uniform_slopes, RowSpline};
use crate::{check_length, check_value, reason, Error};
pub use extrema::Extremum;
use part::{spans, Inverse, Span};
use rayon::prelude::*;

/// How a monotone part is inverted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Polynomial x = P(I) (IFA).
    Polynomial,
    /// Cubic spline x = S(I) through the part's samples (SIFA).
    PartSpline,
    /// The row's global spline, re-sampled densely, inverted by a spline (GSIFA).
    GlobalSpline,
    /// Root of the row's global spline.
    Exact,
}

#[derive(Clone, Copy, Debug)]
pub struct Options {
    pub method: Method,
    /// Largest polynomial degree (`Polynomial`).
    pub degree: usize,
    /// Samples of the global spline per pixel (`GlobalSpline`).
    pub n_resample: usize,
    /// Fringe period of the reference, px.
    pub period: f64,
    /// Least swing of an extremum, as a share of the local range of the row.
    pub prominence: f64,
    /// Least swing of an extremum in the units of the frames (noise).
    pub floor: f64,
    /// Standard deviation of object and reference noise together, in the units of the frames.
    pub noise: f64,
    /// Largest displacement considered, px.
    pub max_displacement: f64,
    /// How far an intensity may exceed its part and still count as its end, as a share of the
    /// part's range.
    pub tolerance: f64,
    /// Map the extrema of an object part onto those of the reference part first (albedo) where
    /// they differ by more than this share of the part's range; infinite for never.
    pub albedo_tolerance: f64,
}

/// The result, one value per pixel; NaN with a reason where it could not be solved.
pub struct Field {
    pub displacement: Vec<f64>,
    /// Standard deviation of the displacement, px: the noise over the slope of the fringe. It ends
    /// at a quarter period: where the slope vanishes, the neighbouring parts bound the error.
    pub sigma: Vec<f32>,
    /// Range of the object's part over that of the reference's.
    pub gain: Vec<f32>,
    pub reason: Vec<u8>,
}

/// Invert `height × width` frames row by row. `mask` is 1 where the object pixel is wanted. `guide`
/// is the expected displacement, NaN where unknown: it decides orders, not values.
pub fn invert(
    reference: &[f64],
    object: &[f64],
    mask: &[u8],
    guide: Option<&[f32]>,
    width: usize,
    options: &Options,
) -> Result<Field, Error> {
    check_value("width", width >= 8, "at least 8 px", width)?;
    check_value(
        "reference",
        reference.len().is_multiple_of(width),
        "whole rows",
        reference.len(),
    )?;
    check_length("object", object.len(), reference.len())?;
    check_length("mask", mask.len(), reference.len())?;
    if let Some(guide) = guide {
        check_length("guide", guide.len(), reference.len())?;
    }
    check_value(
        "n_resample",
        options.n_resample >= 1,
        "at least 1",
        options.n_resample,
    )?;
    check_value(
        "period",
        options.period >= 2.0,
        "at least 2 px",
        options.period,
    )?;
    let n = object.len();
    let mut field = Field {
        displacement: vec![f64::NAN; n],
        sigma: vec![f32::NAN; n],
        gain: vec![f32::NAN; n],
        reason: vec![reason::ORDER_AMBIGUOUS; n],
    };
    field
        .displacement
        .par_chunks_mut(width)
        .zip(field.sigma.par_chunks_mut(width))
        .zip(field.gain.par_chunks_mut(width))
        .zip(field.reason.par_chunks_mut(width))
        .zip(reference.par_chunks(width))
        .zip(object.par_chunks(width))
        .zip(mask.par_chunks(width))
        .enumerate()
        .for_each_init(
            || Scratch::new(width),
            |scratch,
             (y, ((((((displacement, sigma), gain), reason), reference), object), mask))| {
                let guide = guide.map(|g| &g[y * width..(y + 1) * width]);
                let mut out = RowOut {
                    displacement,
                    sigma,
                    gain,
                    reason,
                };
                scratch.invert_row(reference, object, mask, guide, options, &mut out);
            },
        );
    neighbours::mark_slipped_orders(&mut field, width, options.period);
    Ok(field)
}

/// Extrema of a single row; see `Options` for the thresholds.
pub fn row_extrema(
    row: &[f64],
    period: f64,
    prominence: f64,
    floor: f64,
) -> Result<Vec<Extremum>, Error> {
    check_value("row", row.len() >= 8, "at least 8 samples", row.len())?;
    check_value("period", period >= 2.0, "at least 2 px", period)?;
    let mut slopes = vec![0.0; row.len()];
    uniform_slopes(row, &mut slopes, &uniform_pivots(row.len()));
    let spline = RowSpline {
        y: row,
        slopes: &slopes,
    };
    Ok(extrema::find(&spline, period, prominence, floor))
}

struct RowOut<'a> {
    displacement: &'a mut [f64],
    sigma: &'a mut [f32],
    gain: &'a mut [f32],
    reason: &'a mut [u8],
}

struct Scratch {
    reference_slopes: Vec<f64>,
    object_slopes: Vec<f64>,
    pivots: Vec<f64>,
}

/// A stretch of the object row that belongs to one part of the reference.
struct Stretch {
    from: f64,
    to: f64,
    part: usize,
    /// Object intensity = offset + gain × reference intensity.
    offset: f64,
    gain: f64,
}

impl Scratch {
    fn new(width: usize) -> Self {
        Self {
            reference_slopes: vec![0.0; width],
            object_slopes: vec![0.0; width],
            pivots: uniform_pivots(width),
        }
    }

    fn invert_row(
        &mut self,
        reference: &[f64],
        object: &[f64],
        mask: &[u8],
        guide: Option<&[f32]>,
        options: &Options,
        out: &mut RowOut,
    ) {
        uniform_slopes(reference, &mut self.reference_slopes, &self.pivots);
        uniform_slopes(object, &mut self.object_slopes, &self.pivots);
        let s = RowSpline {
            y: reference,
            slopes: &self.reference_slopes,
        };
        let d = RowSpline {
            y: object,
            slopes: &self.object_slopes,
        };
        let find =
            |row: &RowSpline| extrema::find(row, options.period, options.prominence, options.floor);
        let (s_extrema, d_extrema) = (find(&s), find(&d));
        let orders = matching::match_orders(
            &s_extrema,
            &d_extrema,
            options.period,
            options.max_displacement,
            guide,
        );
        let parts = spans(&s, &s_extrema);
        let mut inverses: Vec<Option<Option<Inverse>>> = (0..parts.len()).map(|_| None).collect();
        if s_extrema.is_empty() || d_extrema.is_empty() {
            out.reason.fill(reason::LOW_MODULATION);
        }
        for stretch in stretches(
            &d,
            &d_extrema,
            &s_extrema,
            &orders,
            options.albedo_tolerance,
        ) {
            let span = &parts[stretch.part];
            let inverse = inverses[stretch.part].get_or_insert_with(|| {
                Inverse::build(&s, span, options.method, options.degree, options.n_resample)
            });
            let first = stretch.from.ceil().max(0.0) as usize;
            let last = (stretch.to.floor() as usize).min(object.len() - 1);
            let end_part = stretch.part == 0 || stretch.part + 1 == parts.len();
            for x in first..=last {
                let Some(inverse) = inverse else {
                    out.reason[x] = reason::LOW_MODULATION;
                    continue;
                };
                let intensity = (object[x] - stretch.offset) / stretch.gain;
                match clamp_to(span, intensity, options.tolerance) {
                    Some(value) => {
                        let position = inverse.at(&s, value).clamp(0.0, (object.len() - 1) as f64);
                        out.displacement[x] = x as f64 - position;
                        let slope = (stretch.gain * s.cubic(position).slope(position)).abs();
                        out.sigma[x] = (options.noise / slope).min(0.25 * options.period) as f32;
                        out.gain[x] = stretch.gain as f32;
                        out.reason[x] = reason::OK;
                    }
                    None if end_part => out.reason[x] = reason::OUTSIDE,
                    None => out.reason[x] = reason::OUT_OF_RANGE,
                }
            }
        }
        for (x, wanted) in mask.iter().enumerate() {
            if *wanted == 0 {
                out.displacement[x] = f64::NAN;
                out.sigma[x] = f32::NAN;
                out.gain[x] = f32::NAN;
                out.reason[x] = reason::MASKED;
            }
        }
    }
}

/// The intensity, moved to the end of its part where it exceeds it by no more than the tolerance.
fn clamp_to(span: &Span, intensity: f64, tolerance: f64) -> Option<f64> {
    let (low, high) = (
        span.value_from.min(span.value_to),
        span.value_from.max(span.value_to),
    );
    let slack = tolerance * (high - low);
    (intensity >= low - slack && intensity <= high + slack).then(|| intensity.clamp(low, high))
}

/// Cut the object row at its matched extrema; stretches whose order is not certain are left out.
fn stretches(
    d: &RowSpline,
    d_extrema: &[Extremum],
    s_extrema: &[Extremum],
    orders: &[Option<usize>],
    albedo_tolerance: f64,
) -> Vec<Stretch> {
    let kept: Vec<(&Extremum, usize)> = d_extrema
        .iter()
        .zip(orders)
        .filter_map(|(e, order)| order.map(|i| (e, i)))
        .collect();
    let mut found: Vec<Stretch> = kept
        .windows(2)
        .filter(|w| w[1].1 == w[0].1 + 1)
        .map(|w| {
            let ((from, i), (to, k)) = (w[0], w[1]);
            let (s_from, s_to) = (s_extrema[i].value, s_extrema[k].value);
            let range = s_to - s_from;
            let differs = (from.value - s_from).abs().max((to.value - s_to).abs())
                > albedo_tolerance * range.abs();
            let (offset, gain) = if differs {
                let gain = (to.value - from.value) / range;
                (from.value - gain * s_from, gain)
            } else {
                (0.0, 1.0)
            };
            Stretch {
                from: from.position,
                to: to.position,
                part: i + 1,
                offset,
                gain,
            }
        })
        .collect();
    // Before the first and behind the last extremum the neighbouring stretch's gain is the best
    // guess; there is no second extremum to take it from.
    let end = (d.y.len() - 1) as f64;
    let mut ends = Vec::new();
    if let (Some((e, order)), Some(next)) = (kept.first(), found.first()) {
        ends.push(Stretch {
            from: 0.0,
            to: e.position,
            part: *order,
            ..*next
        });
    }
    if let (Some((e, order)), Some(before)) = (kept.last(), found.last()) {
        ends.push(Stretch {
            from: e.position,
            to: end,
            part: order + 1,
            ..*before
        });
    }
    found.extend(ends);
    found
}
