//! Why a pixel has no value. The Python side (`fringeworks.types.Reason`) has the same numbers; a test
//! compares the two.

/// The pixel has a value.
pub const OK: u8 = 0;
/// The caller excluded the pixel, or its input is not finite.
pub const MASKED: u8 = 1;
/// The matching point lies outside the reference frame.
pub const OUTSIDE: u8 = 2;
/// The fringe is too weak against the noise.
pub const LOW_MODULATION: u8 = 3;
/// Too many samples are at the sensor's limit.
pub const SATURATED: u8 = 4;
/// The fringe order is ambiguous.
pub const ORDER_AMBIGUOUS: u8 = 5;
/// The intensity lies outside the range of the matching part of the reference.
pub const OUT_OF_RANGE: u8 = 6;
/// No window determines the displacement.
pub const UNDETERMINED: u8 = 7;
/// The rays of camera and projector do not meet in front of both devices.
pub const BEYOND_GEOMETRY: u8 = 8;
/// The projector's light does not reach the pixel.
pub const SHADOW: u8 = 9;
/// The decoded point is too far from the epipolar line: the rays of camera and projector pass each
/// other.
pub const RAYS_APART: u8 = 10;
/// No surface through the pixel's neighbours has its coordinate, as where it sees two depths at an edge.
pub const ISOLATED: u8 = 11;
/// No depth in the given range has the pixel's coordinate.
pub const OUTSIDE_DEPTH: u8 = 12;
