//! Bits of weak light: each one is a likelihood rather than a sign.

use super::{GrayCells, GrayCode};

/// Logarithm of the odds from which on a bit is not in doubt: one of 100 000 such bits is wrong.
const LOG_ODDS: f32 = 11.5;

/// Misfit of all bits beyond its mean for noise, over its root, from which on the bits are not those of
/// one surface in the light of the projector: four times that, noise exceeds it in a pixel of 1000.
const MOST_MISFIT: f32 = 4.0;

/// The bits of a pixel, and which of them are in doubt, given its contrast; `None` where they do not
/// look like bits of this contrast. `off` is the distance of the bit of a place from its threshold.
///
/// A bit of contrast A lies at +A or -A. With noise of variance v, the odds of the two are
/// exp(2 A off / v): a bit that is nearer to its threshold than noise usually leaves it may still be
/// certain. That holds for bits of A only. Where another surface, or light of one, mixes in, several
/// are weaker than A by more than noise explains: the sum of their squared deficits tells.
///
/// One function for all kinds of samples, and never inlined: few pixels come here.
#[cold]
#[inline(never)]
pub fn settled(
    code: &GrayCode,
    off: &dyn Fn(u32) -> f32,
    i: usize,
    out: &GrayCells,
) -> Option<(u32, u32)> {
    let (contrast, variance) = (out.contrast[i], out.variance[i]);
    let by_noise = 0.5 * LOG_ODDS * variance / contrast;
    let limit = by_noise.max(code.doubt_share * contrast);
    // Noise and contrast that are not finite compare as false.
    if !(contrast > 0.0 && limit < contrast) {
        return None;
    }
    let count = code.bits.len() as u32;
    let (mut gray, mut doubt, mut square) = (0u32, 0u32, 0.0);
    for place in 0..count {
        let off = off(place);
        gray |= u32::from(off > 0.0) << place;
        if off.abs() < limit {
            doubt |= 1 << place;
        } else {
            square += (contrast - off.abs()).max(0.0).powi(2);
        }
    }
    let usual = count as f32;
    (square <= (usual + MOST_MISFIT * usual.sqrt()) * variance).then_some((gray, doubt))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::gray_code::tests_of_words::code;

    /// The bits of one pixel of contrast 45 with a noise of 10 counts.
    fn found(offs: &[f32]) -> Option<(u32, u32)> {
        let mut out = GrayCells::new();
        (out.contrast[0], out.variance[0]) = (45.0, 100.0);
        settled(&code(offs.len()), &|place| offs[place as usize], 0, &out)
    }

    #[test]
    fn bits_count_by_their_odds() {
        // Odds of 100 000 to 1 at 0.5 ln(100 000) 100 / 45 = 12.8 counts.
        assert_eq!(found(&[40.0, -50.0, 20.0, 45.0]), Some((0b1101, 0)));
        assert_eq!(found(&[40.0, -50.0, 10.0, 45.0]), Some((0b1101, 0b100)));
        // All bits at half of the contrast are those of other light.
        assert_eq!(found(&[22.0, -22.0, 22.0, -22.0]), None);
    }
}
