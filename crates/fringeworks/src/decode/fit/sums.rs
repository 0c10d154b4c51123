//! Sums over the samples of a block of pixels.

use crate::decode::Line;

/// Σ I, Σ I cos δ and Σ I sin δ of a block.
pub struct Sums {
    pub plain: Line,
    pub cos: Line,
    pub sin: Line,
}

impl Sums {
    pub const fn zero() -> Self {
        let zero = Line::of(0.0);
        Self {
            plain: zero,
            cos: zero,
            sin: zero,
        }
    }
}

/// Samples of a block at the sensor's limit: their number, and Σ cos δ and Σ sin δ over them.
pub struct Saturated {
    pub count: Line,
    pub cos: Line,
    pub sin: Line,
}

impl Saturated {
    pub const fn none() -> Self {
        let zero = Line::of(0.0);
        Self {
            count: zero,
            cos: zero,
            sin: zero,
        }
    }
}
