//! Grey PNG images, decoded by the crate `png` without the interpreter's lock.

use crate::threads::alone;
use numpy::PyArray1;
use png::{BitDepth, ColorType, DecodeOptions, Decoder, Limits};
use pyo3::prelude::*;
use std::io::Cursor;

/// Counts of a grey image, row after row, in the byte order of this machine.
enum Counts {
    Bytes(Vec<u8>),
    Words(Vec<u16>),
}

/// Decode a PNG with one channel of 8 or 16 bits: its counts row after row, uint8 or uint16.
///
/// `None` for other kinds of PNG, which the caller reads in another way. The caller has checked the
/// size that the header states.
#[pyfunction]
pub fn read_grey_png(py: Python<'_>, content: &[u8]) -> PyResult<Option<Py<PyAny>>> {
    let found = alone(py, || {
        decode(content).map_err(|error| fringeworks::Error::Value {
            name: "PNG",
            expected: "an image that can be decoded",
            got: error.to_string(),
        })
    })?;
    Ok(found.map(|counts| match counts {
        Counts::Bytes(values) => PyArray1::from_vec(py, values).into_any().unbind(),
        Counts::Words(values) => PyArray1::from_vec(py, values).into_any().unbind(),
    }))
}

fn decode(content: &[u8]) -> Result<Option<Counts>, png::DecodingError> {
    let mut options = DecodeOptions::default();
    // Texts and colour profiles are not read, so that nothing in them can be large or wrong.
    options.set_ignore_text_chunk(true);
    options.set_ignore_iccp_chunk(true);
    let mut decoder = Decoder::new_with_options(Cursor::new(content), options);
    decoder.set_limits(Limits { bytes: usize::MAX });
    let mut reader = decoder.read_info()?;
    let info = reader.info();
    let plain = info.color_type == ColorType::Grayscale
        && !info.interlaced
        && info.trns.is_none()
        && info.animation_control.is_none();
    let (depth, pixels) = (info.bit_depth, info.width as usize * info.height as usize);
    match depth {
        BitDepth::Eight if plain => {
            let mut values = vec![0u8; pixels];
            reader.next_frame(&mut values)?;
            reader.finish()?;
            Ok(Some(Counts::Bytes(values)))
        }
        BitDepth::Sixteen if plain => {
            let mut bytes = vec![0u8; 2 * pixels];
            reader.next_frame(&mut bytes)?;
            reader.finish()?;
            let pairs = bytes.chunks_exact(2);
            Ok(Some(Counts::Words(
                pairs
                    .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
                    .collect(),
            )))
        }
        _ => Ok(None),
    }
}
