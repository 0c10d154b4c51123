#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod albedo;
pub mod decode;
pub mod edges;
pub mod emd;
pub mod filters;
pub mod form;
mod image;
pub mod inverse;
pub mod isolated;
pub mod measure;
pub mod mesh;
pub mod moving;
pub mod moving_mean;
pub mod propagate;
mod reason;
pub mod residual_chi;
pub mod sample;
pub mod scatter;
mod spline;
pub mod triangulate;
pub mod unwrap;
pub mod vertices;
pub mod vote;
pub mod warp;
pub mod wavelet;
pub mod windowed;

pub use image::{Image, ImageMut};
pub(crate) use image::{check_columns, check_shape};
pub use reason::Reason;

/// Least width of a row or frame to invert, px: splines need four samples, and the reference is not used
/// within two of its ends.
pub(crate) const MIN_WIDTH: usize = 8;

/// Least fringe period, px: two samples per period, the sampling theorem's limit.
pub(crate) const MIN_PERIOD: f64 = 2.0;

/// Largest fringe period, px: far more than a frame has. Windows have a size in proportion to it.
pub(crate) const MAX_PERIOD: f64 = 1e6;

/// Refuse a period that no frame has.
pub(crate) fn check_period(period: f64) -> Result<(), Error> {
    let ok = (MIN_PERIOD..=MAX_PERIOD).contains(&period);
    check_value("period", ok, "at least 2 px, at most 10^6", period)
}

/// Input that a kernel refuses. `name` is that of the argument or field.
///
/// ```
/// use fringeworks::Image;
///
/// let error = Image::new(&[0.0; 5], 2, 3).unwrap_err();
/// assert_eq!(error.to_string(), "image: expected 6 values, got 5");
/// ```
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum Error {
    /// A number of values that does not fit.
    #[error("{name}: expected {expected} values, got {got}")]
    Length {
        /// Argument or field.
        name: &'static str,
        /// What it must be.
        expected: usize,
        /// What it is.
        got: usize,
    },
    /// A picture of another size than the others, in rows and columns.
    #[error("{name}: expected shape {expected:?}, got {got:?}")]
    Shape {
        /// Argument or field.
        name: &'static str,
        /// What it must be.
        expected: (usize, usize),
        /// What it is.
        got: (usize, usize),
    },
    /// A value that makes no sense.
    #[error("{name}: expected {expected}, got {got}")]
    Value {
        /// Argument or field.
        name: &'static str,
        /// What it must be.
        expected: &'static str,
        /// What it is.
        got: String,
    },
}

/// Refuse a slice that does not have the expected number of values.
pub(crate) fn check_length(name: &'static str, got: usize, expected: usize) -> Result<(), Error> {
    if got == expected {
        Ok(())
    } else {
        Err(Error::Length {
            name,
            expected,
            got,
        })
    }
}

/// Refuse a value that is not `ok`; `expected` says in words what is.
pub(crate) fn check_value(
    name: &'static str,
    ok: bool,
    expected: &'static str,
    got: impl std::fmt::Debug,
) -> Result<(), Error> {
    if ok {
        Ok(())
    } else {
        Err(Error::Value {
            name,
            expected,
            got: format!("{got:?}"),
        })
    }
}

/// Whether this is an optimised build. A debug build of these loops is unusably slow.
///
/// ```
/// assert_eq!(fringeworks::is_optimised(), !cfg!(debug_assertions));
/// ```
pub fn is_optimised() -> bool {
    // Only the release profile turns `debug_assertions` off. The dev profile is optimised too
    // (Cargo.toml), but keeps its checks.
    !cfg!(debug_assertions)
}
