//! Kernels of fringe projection profilometry, on plain slices.
//!
//! Nothing here knows of Python, files or screens. Callers validate; kernels state what they
//! assume and return [`Error`] where an assumption can be checked for free.
//!
//! * [`decode`]: shifted fringes and Gray code to projector coordinates, in one pass.
//! * [`emd`]: empirical mode decomposition of rows, and their envelopes.
//! * [`mesh`]: rays against triangles, for the virtual rig.
//! * [`inverse`]: inverse function analysis by rows (IFA, SIFA, GSIFA, exact).
//! * [`windowed`]: windowed inversion, local least squares over several window sizes.
//! * [`triangulate`]: projector coordinates and a calibrated pair to points.
//! * [`unwrap`]: phase unwrapping by sorting by reliability, and the average that guides it.
//! * [`wavelet`]: ridge of the continuous wavelet transform by rows.

pub mod decode;
pub mod emd;
pub mod inverse;
pub mod mesh;
pub mod reason;
mod spline;
pub mod triangulate;
pub mod unwrap;
pub mod wavelet;
pub mod windowed;

/// What a kernel refuses. The bindings map it to `ValueError`.
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

/// Whether this is an optimised build; a debug build of these loops is unusably slow.
pub fn is_optimised() -> bool {
    // `debug_assertions` is off in the release profile only; the dev profile is optimised too
    // (Cargo.toml), but keeps its checks.
    !cfg!(debug_assertions)
}
