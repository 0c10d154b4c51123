//! Unwrapping of any phase: a result or an error, never a panic.
#![no_main]

mod bytes;

use bytes::Bytes;
use fringeworks::{Image, unwrap};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes(data);
    let (height, width) = bytes.shape();
    let n = height * width;
    let (reach, sigma) = (usize::from(bytes.byte()) % 32, bytes.single());
    let mask: Vec<u8> = (0..n).map(|_| bytes.byte() & 1).collect();
    let (phase, rough) = (bytes.singles(n), bytes.singles(n));
    let mask = Image::new(&mask, height, width).unwrap();
    let [phase, rough] = [&phase, &rough].map(|map| Image::new(map, height, width).unwrap());
    let _ = unwrap::count_residues(phase, mask);
    let _ = unwrap::unwrap_reliability(phase, mask, None);
    let _ = unwrap::unwrap_reliability(phase, mask, Some(rough));
    let _ = unwrap::average_phasor(phase, rough, sigma, reach);
});
