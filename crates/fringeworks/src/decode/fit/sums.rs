//! Sums over the samples of a group of pixels.

use crate::decode::{Lanes, LANES};

/// Σ I, Σ I cos δ and Σ I sin δ of a group; after solving, the amplitudes A, c and s.
#[derive(Clone, Copy)]
pub struct Sums {
    pub plain: Lanes,
    pub cos: Lanes,
    pub sin: Lanes,
}

impl Sums {
    #[inline(always)]
    pub fn zero() -> Self {
        Self {
            plain: [0.0; LANES],
            cos: [0.0; LANES],
            sin: [0.0; LANES],
        }
    }
}

/// Samples of a group at the sensor's limit: their number, and Σ cos δ and Σ sin δ over them.
#[derive(Clone, Copy)]
pub struct Saturated {
    pub count: Lanes,
    pub cos: Lanes,
    pub sin: Lanes,
}

impl Saturated {
    #[inline(always)]
    pub fn none() -> Self {
        Self {
            count: [0.0; LANES],
            cos: [0.0; LANES],
            sin: [0.0; LANES],
        }
    }
}

/// A group of pixels of a plane; zeros beyond its end.
#[inline(always)]
pub fn lanes<T: Copy + Default>(plane: &[T], at: usize) -> [T; LANES] {
    match plane[at..].first_chunk::<LANES>() {
        Some(whole) => *whole,
        None => {
            let mut out = [T::default(); LANES];
            out[..plane.len() - at].copy_from_slice(&plane[at..]);
            out
        }
    }
}
