//! Why a pixel has no value. The Python side (`fringeworks.types.Reason`) has the same numbers; a
//! test compares the two.

pub const OK: u8 = 0;
/// Excluded by the caller, or not finite in the input.
pub const MASKED: u8 = 1;
/// The matching point lies outside the reference frame.
pub const OUTSIDE: u8 = 2;
/// The fringe is too weak against the noise.
pub const LOW_MODULATION: u8 = 3;
/// The sensor was at its limit in too many samples.
pub const SATURATED: u8 = 4;
/// The fringe order cannot be decided.
pub const ORDER_AMBIGUOUS: u8 = 5;
/// The intensity lies outside the range of the matching part of the reference.
pub const OUT_OF_RANGE: u8 = 6;
/// No window determines the displacement.
pub const UNDETERMINED: u8 = 7;
/// No point in front of both devices is seen and lit along these rays.
pub const BEYOND_GEOMETRY: u8 = 8;
/// The projector's light does not reach the pixel.
pub const SHADOW: u8 = 9;
/// Columns and rows of the projector disagree: the two rays pass each other.
pub const RAYS_APART: u8 = 10;
