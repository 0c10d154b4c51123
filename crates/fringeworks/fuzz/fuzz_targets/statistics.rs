//! Quantiles, differences and their tests of any values: a result or an error, never a panic.
#![no_main]

mod bytes;

use bytes::Bytes;
use fringeworks::{Image, sample};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes(data);
    let (height, width) = bytes.shape();
    let (limit, shares) = (bytes.single(), bytes.doubles(3));
    let n = height * width;
    let (values, sigma) = (bytes.singles(n), bytes.singles(n));
    let doubles: Vec<f64> = values.iter().map(|&value| f64::from(value)).collect();
    let map = Image::new(&doubles, height, width).unwrap();
    let _ = sample::quantiles(&doubles, &shares);
    let _ = sample::gram(map);
    let _ = sample::second_magnitudes(map);
    let [values, sigma] = [&values, &sigma].map(|map| Image::new(map, height, width).unwrap());
    let _ = sample::third_chi_squares(values, sigma, limit);
});
