//! Points as files hold them: the fields of each vertex one after the other, without gaps.

use crate::{Error, Image, Reason, check_shape, check_value};

/// Largest value of a channel in 8 bits.
const WHITE: f64 = 255.0;

/// Bytes of x, y, z, σ and noise.
const PLAIN: usize = 20;

/// Bytes of a vertex with red, green and blue.
const SHADED: usize = 23;

/// The maps of a cloud of points.
#[derive(Clone, Copy, Debug)]
pub struct Cloud<'a> {
    /// Coordinates x, y, z of each pixel, three values in a row for each.
    pub xyz: Image<'a, f32>,
    /// Standard deviations.
    pub sigma: Image<'a, f32>,
    /// Parts of the standard deviations that are pixel noise.
    pub noise: Image<'a, f32>,
    /// Codes of the reasons why a pixel has no point.
    pub reason: Image<'a, u8>,
}

/// Brightness or colour of the points.
#[derive(Clone, Copy, Debug)]
pub struct Shade<'a> {
    /// Brightness, one value for each pixel, or red, green and blue, three values in a row.
    pub values: Image<'a, f32>,
    /// Factor to values of 8 bits.
    pub scale: f64,
}

/// A channel in 8 bits; 0 where it is not a number.
fn eight_bits(value: f32, scale: f64) -> u8 {
    // The cast takes NaN to 0.
    (f64::from(value) * scale)
        .round_ties_even()
        .clamp(0.0, WHITE) as u8
}

/// The measured points of a cloud as bytes, row after row.
///
/// A vertex has x, y, z, σ and noise as `f32` in little-endian order, then red, green and blue in 8 bits
/// where the points have a shade.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::vertices::{Cloud, pack_vertices};
///
/// let cloud = Cloud {
///     xyz: Image::new(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 1, 6)?,
///     sigma: Image::new(&[0.1, 0.2], 1, 2)?,
///     noise: Image::new(&[0.1, 0.1], 1, 2)?,
///     reason: Image::new(&[4, 0], 1, 2)?,
/// };
/// let bytes = pack_vertices(cloud, None)?;
/// assert_eq!(bytes.len(), 20);
/// assert_eq!(bytes[..4], 4.0_f32.to_le_bytes());
/// # Ok::<(), fringeworks::Error>(())
/// ```
///
/// # Errors
///
/// Maps of sizes that do not fit.
pub fn pack_vertices(cloud: Cloud<'_>, shade: Option<Shade<'_>>) -> Result<Vec<u8>, Error> {
    let (height, width) = cloud.reason.shape();
    let triple = (height, width.saturating_mul(3));
    check_shape("xyz", cloud.xyz.shape(), triple)?;
    check_shape("sigma", cloud.sigma.shape(), (height, width))?;
    check_shape("noise", cloud.noise.shape(), (height, width))?;
    let Some(Shade { values, scale }) = shade else {
        return Ok(packed::<PLAIN>(cloud, |_, _| {}));
    };
    check_value("scale", scale > 0.0, "> 0", scale)?;
    if values.shape() == (height, width) {
        return Ok(packed::<SHADED>(cloud, |k, channels| {
            channels.fill(eight_bits(values[k], scale));
        }));
    }
    check_shape("shade", values.shape(), triple)?;
    Ok(packed::<SHADED>(cloud, |k, channels| {
        for (channel, &value) in channels.iter_mut().zip(&values[3 * k..3 * k + 3]) {
            *channel = eight_bits(value, scale);
        }
    }))
}

/// The vertices of the measured points, of whose `SIZE` bytes `shaded` writes those behind the floats.
fn packed<const SIZE: usize>(cloud: Cloud<'_>, shaded: impl Fn(usize, &mut [u8])) -> Vec<u8> {
    let ok = u8::from(Reason::Ok);
    let count = cloud.reason.iter().filter(|&&code| code == ok).count();
    let mut bytes = vec![0u8; count * SIZE];
    let measured = (0..cloud.reason.len()).filter(|&k| cloud.reason[k] == ok);
    for (vertex, k) in bytes.chunks_exact_mut(SIZE).zip(measured) {
        let at = &cloud.xyz[3 * k..3 * k + 3];
        let fields = [at[0], at[1], at[2], cloud.sigma[k], cloud.noise[k]];
        for (place, value) in vertex.chunks_exact_mut(4).zip(fields) {
            place.copy_from_slice(&value.to_le_bytes());
        }
        shaded(k, &mut vertex[PLAIN..]);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_round_to_even_and_stop_at_the_ends() {
        let shown = |value: f32| eight_bits(value, 0.5);
        assert_eq!([shown(1.0), shown(3.0), shown(4.0)], [0, 2, 2]);
        assert_eq!([shown(-9.0), shown(1e9), shown(f32::NAN)], [0, 255, 0]);
        assert_eq!([shown(f32::INFINITY), shown(f32::NEG_INFINITY)], [255, 0]);
    }
}
