//! Kernels of fringe projection profilometry, on plain slices.
//!
//! The crate has no Python, files or screens. Callers validate their input. Kernels document what they
//! assume and return an [`Error`] where an assumption can be checked at no cost.
//!
//! * [`albedo`]: albedo of an object with sharp edges, from two frames.
//! * [`decode`]: shifted fringes and Gray code to projector coordinates, in one pass.
//! * [`emd`]: empirical mode decomposition of rows, and their envelopes.
//! * [`filters`]: filters of images, and what lies beyond their borders.
//! * [`inverse`]: inverse function analysis by rows (IFA, SIFA, GSIFA, exact).
//! * [`isolated`]: pixels whose decoded coordinate no neighbour shares.
//! * [`measure`]: frames to points in one pass.
//! * [`mesh`]: intersection of rays with triangles, and triangles that are nearest to points.
//! * [`moving_mean`]: moving means along both axes, which replace Gaussian kernels.
//! * [`reason`]: why a pixel has no value.
//! * [`sample`]: statistics of a sample of pixels, by which a stack is judged.
//! * [`scatter`]: by how much neighbouring coordinates scatter.
//! * [`triangulate`]: projector coordinates and a calibrated rig to points.
//! * [`unwrap`]: phase unwrapping by sorting by reliability, and the average that guides it.
//! * [`wavelet`]: ridge of the continuous wavelet transform by rows.
//! * [`windowed`]: windowed inversion, local least squares over several window sizes.

pub mod albedo;
pub mod decode;
pub mod emd;
pub mod filters;
pub mod inverse;
pub mod isolated;
pub mod measure;
pub mod mesh;
pub mod moving_mean;
mod nearest;
pub mod reason;
pub mod sample;
pub mod scatter;
mod spline;
pub mod triangulate;
pub mod unwrap;
pub mod wavelet;
pub mod windowed;

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

/// Input that a kernel refuses. The bindings map it to `ValueError`.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum Error {
    #[error("{name}: expected {expected} values, got {got}")]
    Length {
        name: &'static str,
        expected: usize,
        got: usize,
    },
    #[error("{name}: expected {expected}, got {got}")]
    Value {
        name: &'static str,
        expected: &'static str,
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
pub fn is_optimised() -> bool {
    // Only the release profile turns `debug_assertions` off. The dev profile is optimised too
    // (Cargo.toml), but keeps its checks.
    !cfg!(debug_assertions)
}
