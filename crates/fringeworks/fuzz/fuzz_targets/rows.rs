//! Modes, extrema and wavelet ridges of any rows: a result or an error, never a panic.
#![no_main]

mod bytes;

use bytes::Bytes;
use fringeworks::{Image, emd, inverse, wavelet};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes(data);
    let (height, width) = bytes.shape();
    let options = wavelet::Options {
        frequencies: (0..bytes.byte() % 12)
            .map(|k| 0.05 * 1.1f64.powi(i32::from(k)))
            .collect(),
        omega: 6.0,
        smoothness: f64::from(bytes.byte() & 1),
    };
    let numbers = bytes.doubles(3);
    let rows = bytes.doubles(height * width);
    let _ = emd::row_envelopes(Image::new(&rows, height, width).unwrap());
    let _ = inverse::row_extrema(&rows, numbers[0], numbers[1], numbers[2]);
    let rows: Vec<f32> = rows.iter().map(|&value| value as f32).collect();
    let _ = wavelet::wavelet_ridge_rows(Image::new(&rows, height, width).unwrap(), &options);
});
