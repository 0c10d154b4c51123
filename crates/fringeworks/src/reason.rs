//! Why a pixel has no value.

/// Why a pixel has no value.
///
/// Maps of reasons that a caller lends to a kernel hold their codes, one byte per pixel: `u8::from`
/// gives the code of a reason, and `Reason::try_from` the reason of a code. The Python package
/// (`fringeworks.types.Reason`) has the same codes.
///
/// ```
/// use fringeworks::Reason;
///
/// assert_eq!(u8::from(Reason::Saturated), 4);
/// assert_eq!(Reason::try_from(4), Ok(Reason::Saturated));
/// assert!(Reason::try_from(200).is_err());
/// assert_eq!(Reason::Saturated.to_string(), "too many samples are at the sensor's limit");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Reason {
    /// The pixel has a value.
    Ok = 0,
    /// The caller excluded the pixel, or its input is not finite.
    Masked = 1,
    /// The matching point lies outside the reference frame.
    Outside = 2,
    /// The fringe is too weak against the noise.
    LowModulation = 3,
    /// Too many samples are at the sensor's limit.
    Saturated = 4,
    /// The fringe order is ambiguous.
    OrderAmbiguous = 5,
    /// The intensity lies outside the range of the matching part of the reference.
    OutOfRange = 6,
    /// No window determines the displacement.
    Undetermined = 7,
    /// The rays of camera and projector do not meet in front of both devices.
    BeyondGeometry = 8,
    /// The projector's light does not reach the pixel.
    Shadow = 9,
    /// The decoded point is too far from the epipolar line: the rays of camera and projector pass each
    /// other.
    RaysApart = 10,
    /// No surface through the pixel's neighbours has its coordinate, as where it sees two depths at an
    /// edge.
    Isolated = 11,
    /// No depth in the given range has the pixel's coordinate.
    OutsideDepth = 12,
}

impl Reason {
    /// All reasons, in the order of their codes.
    pub const ALL: [Self; 13] = [
        Self::Ok,
        Self::Masked,
        Self::Outside,
        Self::LowModulation,
        Self::Saturated,
        Self::OrderAmbiguous,
        Self::OutOfRange,
        Self::Undetermined,
        Self::BeyondGeometry,
        Self::Shadow,
        Self::RaysApart,
        Self::Isolated,
        Self::OutsideDepth,
    ];

    /// The code as wide as the f32 lanes, so that choices between reasons stay vector operations.
    #[inline(always)]
    pub(crate) const fn lane(self) -> u32 {
        self as u32
    }
}

impl From<Reason> for u8 {
    fn from(reason: Reason) -> Self {
        reason as Self
    }
}

impl TryFrom<u8> for Reason {
    type Error = crate::Error;

    fn try_from(code: u8) -> Result<Self, Self::Error> {
        let known = Self::ALL.get(usize::from(code)).copied();
        known.ok_or_else(|| crate::Error::Value {
            name: "reason",
            expected: "a code of 0 to 12",
            got: code.to_string(),
        })
    }
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Ok => "the pixel has a value",
            Self::Masked => "the pixel is excluded, or its input is not finite",
            Self::Outside => "the matching point lies outside the reference frame",
            Self::LowModulation => "the fringe is too weak against the noise",
            Self::Saturated => "too many samples are at the sensor's limit",
            Self::OrderAmbiguous => "the fringe order is ambiguous",
            Self::OutOfRange => "the intensity lies outside the range of the reference",
            Self::Undetermined => "no window determines the displacement",
            Self::BeyondGeometry => "the rays do not meet in front of both devices",
            Self::Shadow => "the projector's light does not reach the pixel",
            Self::RaysApart => "the rays of camera and projector pass each other",
            Self::Isolated => "no surface through the neighbours has the pixel's coordinate",
            Self::OutsideDepth => "no depth in the given range has the pixel's coordinate",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_places() {
        for (code, reason) in (0..).zip(Reason::ALL) {
            assert_eq!(u8::from(reason), code);
            assert_eq!(Reason::try_from(code), Ok(reason));
        }
    }
}
