//! Inverse function analysis by rows: u(x) = x − s⁻¹(d(x)) (theory §4).
//!
//! Extrema of the reference row and of the object row are matched by fringe order. Intensities
//! between two matched extrema of the object are inverted through the matching monotone part of the
//! reference.

mod band;
mod extrema;
mod matched;
mod matching;
mod neighbours;
mod part;
mod polynomial;
mod row;

use crate::moving_mean::Number;
use crate::spline::{RowSpline, uniform_pivots, uniform_slopes};
use crate::{Error, Image, MIN_WIDTH, Reason, check_period, check_shape, check_value};
pub use extrema::Extremum;
use extrema::Finder;
use rayon::prelude::*;
use row::{RowIn, RowOut, Scratch};

/// How a monotone part is inverted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Polynomial x = P(I) (IFA).
    Ifa,
    /// Cubic spline x = S(I) through the part's samples (SIFA).
    Sifa,
    /// The row's global spline, re-sampled densely and inverted by a spline (GSIFA).
    Gsifa,
    /// Root of the row's global spline.
    Exact,
}

/// How rows are inverted.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// How a monotone part is inverted.
    pub method: Method,
    /// Largest polynomial degree (`Ifa`).
    pub degree: usize,
    /// Samples of the global spline per pixel (`Gsifa`).
    pub n_resample: usize,
    /// Fringe period of the reference, px.
    pub period: f64,
    /// Least swing of an extremum, as a share of the local range of the smoothed row.
    pub prominence: f64,
    /// Least swing of an extremum, counts, in a row that is not smoothed; set from the noise. It is
    /// lowered as white noise is by the smoothing.
    pub floor: f64,
    /// Standard deviation of object and reference noise together, counts.
    pub noise: f64,
    /// Largest displacement considered, px.
    pub max_displacement: f64,
    /// How far an intensity may exceed its part and still count as the part's end, as a share of
    /// the part's range.
    pub tolerance: f64,
    /// Difference between the extrema of object and reference, as a share of the part's range, above
    /// which the object's part is first mapped onto the reference's (albedo); infinite for never.
    pub albedo_tolerance: f64,
}

/// Maps with one value per pixel; NaN with a reason where the displacement could not be computed.
pub struct Field {
    /// Displacement, px.
    pub displacement: Vec<f64>,
    /// Standard deviation of the displacement, px: the noise over the slope of the fringe. At most a
    /// quarter period: where the slope vanishes, the neighbouring parts bound the error.
    pub sigma: Vec<f32>,
    /// Range of the object's part over that of the reference's.
    pub modulation_ratio: Vec<f32>,
    /// Why a pixel has no value.
    pub reason: Vec<Reason>,
}

fn check<T>(
    reference: Image<T>,
    object: Image<T>,
    mask: Image<u8>,
    guide: Option<Image<f32>>,
    options: &Options,
) -> Result<(), Error> {
    let (shape, width) = (reference.shape(), reference.width());
    check_value("width", width >= MIN_WIDTH, "at least 8 px", width)?;
    check_shape("object", object.shape(), shape)?;
    check_shape("mask", mask.shape(), shape)?;
    if let Some(guide) = guide {
        check_shape("guide", guide.shape(), shape)?;
    }
    let (n_resample, period) = (options.n_resample, options.period);
    check_value("n_resample", n_resample >= 1, "at least 1", n_resample)?;
    check_period(period)
}

/// Invert frames row by row, in double precision.
///
/// `mask` is 1 where the object pixel is wanted. `guide` is the expected displacement, NaN where
/// unknown; it decides fringe orders, not values.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::inverse::{Method, Options, invert_rows};
///
/// let wave = |u: f64| -> Vec<f64> { (0..120).map(|x| 100.0 + 50.0 * (0.3 * (x as f64 - u)).cos()).collect() };
/// let (reference, object) = (wave(0.0), wave(2.5));
/// let options = Options {
///     method: Method::Sifa,
///     degree: 9,
///     n_resample: 10,
///     period: 20.94,
///     prominence: 0.3,
///     floor: 0.0,
///     noise: 0.1,
///     max_displacement: 60.0,
///     tolerance: 0.05,
///     albedo_tolerance: f64::INFINITY,
/// };
/// let [reference, object] = [&reference, &object].map(|row| Image::new(row, 1, 120).unwrap());
/// let found = invert_rows(reference, object, Image::new(&[1; 120], 1, 120)?, None, &options)?;
/// assert!((found.displacement[60] - 2.5).abs() < 0.05);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn invert_rows<T: Number>(
    reference: Image<T>,
    object: Image<T>,
    mask: Image<u8>,
    guide: Option<Image<f32>>,
    options: &Options,
) -> Result<Field, Error> {
    check(reference, object, mask, guide, options)?;
    let (n, width) = (object.len(), object.width());
    let mut field = Field {
        displacement: vec![f64::NAN; n],
        sigma: vec![f32::NAN; n],
        modulation_ratio: vec![f32::NAN; n],
        reason: vec![Reason::OrderAmbiguous; n],
    };
    field
        .displacement
        .par_chunks_mut(width)
        .zip(field.sigma.par_chunks_mut(width))
        .zip(field.modulation_ratio.par_chunks_mut(width))
        .zip(field.reason.par_chunks_mut(width))
        .enumerate()
        .for_each_init(
            || Scratch::new(width, options),
            |scratch, (y, (((displacement, sigma), modulation_ratio), reason))| {
                let frames = RowIn {
                    reference: reference.row(y),
                    object: object.row(y),
                    mask: mask.row(y),
                    guide: guide.map(|guide| guide.row(y)),
                };
                let mut out = RowOut {
                    displacement,
                    sigma,
                    modulation_ratio,
                    reason,
                };
                scratch.invert_row(&frames, options, &mut out);
            },
        );
    neighbours::mark_slipped_orders(&mut field, width, options.period);
    Ok(field)
}

/// Extrema of a single row; see [`Options`] for the thresholds.
///
/// ```
/// use fringeworks::inverse::row_extrema;
///
/// let row: Vec<f64> = (0..60).map(|x| (std::f64::consts::TAU * x as f64 / 20.0).cos()).collect();
/// let found = row_extrema(&row, 20.0, 0.3, 0.0)?;
/// let first = found.iter().find(|extremum| !extremum.is_maximum).unwrap();
/// assert!((first.position - 10.0).abs() < 0.01);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn row_extrema(
    row: &[f64],
    period: f64,
    prominence: f64,
    floor: f64,
) -> Result<Vec<Extremum>, Error> {
    check_value(
        "row",
        row.len() >= MIN_WIDTH,
        "at least 8 samples",
        row.len(),
    )?;
    check_period(period)?;
    let mut slopes = vec![0.0; row.len()];
    uniform_slopes([row], [&mut slopes], &uniform_pivots(row.len()));
    let spline = RowSpline {
        y: row,
        slopes: &slopes,
    };
    Ok(Finder::new(period, prominence, floor).find(&spline))
}
