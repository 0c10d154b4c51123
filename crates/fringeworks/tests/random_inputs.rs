//! Kernels on random slices: a result or an [`fringeworks::Error`], never a panic.
//!
//! `cargo test` builds them with checks of overflow. The kernels that need settings of a whole decoding
//! are driven from Python, tests/test_hostile_kernels.py.

use fringeworks::{Image, emd, inverse, sample, unwrap, wavelet};

const ROUNDS: usize = 300;

/// Random numbers by Marsaglia's xorshift, Journal of Statistical Software 8(14), 2003.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// Usual values, with some at the edges of what numbers are.
    fn value(&mut self, hostile: bool) -> f64 {
        const EDGES: [f64; 9] = [
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            0.0,
            -0.0,
            1e30,
            -1e30,
            1e-40,
            f64::MAX,
        ];
        if hostile && self.below(8) == 0 {
            EDGES[self.below(EDGES.len())]
        } else {
            self.below(20_001) as f64 / 100.0 - 100.0
        }
    }

    fn doubles(&mut self, n: usize, hostile: bool) -> Vec<f64> {
        (0..n).map(|_| self.value(hostile)).collect()
    }

    fn singles(&mut self, n: usize, hostile: bool) -> Vec<f32> {
        (0..n).map(|_| self.value(hostile) as f32).collect()
    }

    fn bytes(&mut self, n: usize, most: usize) -> Vec<u8> {
        (0..n).map(|_| self.below(most) as u8).collect()
    }
}

/// Call a kernel for many random sizes, with usual and with hostile values.
fn rounds(call: impl Fn(&mut Random, usize, usize, bool)) {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    for round in 0..ROUNDS {
        let (height, width) = (random.below(20) + 1, random.below(40) + 1);
        call(&mut random, height, width, round % 2 == 1);
    }
}

#[test]
fn unwrapping() {
    rounds(|random, height, width, hostile| {
        let n = height * width;
        let phase = random.singles(n, hostile);
        let mask = random.bytes(n, 2);
        let rough = random.singles(n, hostile);
        let [phase, rough] = [&phase, &rough].map(|map| Image::new(map, height, width).unwrap());
        // A row is missing now and then.
        let rows = height - random.below(10) / 9;
        let mask = Image::new(&mask[..rows * width], rows, width).unwrap();
        let _ = unwrap::count_residues(phase, mask);
        let _ = unwrap::unwrap_reliability(phase, mask, None);
        let _ = unwrap::unwrap_reliability(phase, mask, Some(rough));
        let reach = random.below(30);
        let sigma = random.value(hostile) as f32;
        let _ = unwrap::average_phasor(phase, rough, sigma, reach);
    });
}

#[test]
fn modes_of_rows() {
    rounds(|random, height, width, hostile| {
        let rows = random.doubles(height * width, hostile);
        let _ = emd::row_envelopes(Image::new(&rows, height, width).unwrap());
    });
}

#[test]
fn extrema_of_rows() {
    rounds(|random, _, width, hostile| {
        let row = random.doubles(width, hostile);
        let period = random.value(hostile);
        let _ = inverse::row_extrema(&row, period, random.value(hostile), random.value(hostile));
    });
}

#[test]
fn statistics() {
    rounds(|random, height, width, hostile| {
        let values = random.doubles(height * width, hostile);
        let map = Image::new(&values, height, width).unwrap();
        let shares = random.doubles(3, hostile);
        let _ = sample::quantiles(&values, &shares);
        let _ = sample::quantiles(&values, &[0.0, 0.25, 0.25, 1.0]);
        let _ = sample::gram(map);
        let _ = sample::second_magnitudes(map);
        let singles = random.singles(height * width, hostile);
        let sigma = random.singles(height * width, hostile);
        let [singles, sigma] =
            [&singles, &sigma].map(|map| Image::new(map, height, width).unwrap());
        let _ = sample::third_chi_squares(singles, sigma, 10.0);
    });
}

#[test]
fn ridges_of_wavelets() {
    rounds(|random, height, width, hostile| {
        let rows = random.singles(height * width, hostile);
        let count = random.below(12);
        let frequencies = (0..count).map(|k| 0.05 * 1.1f64.powi(k as i32)).collect();
        let options = wavelet::Options {
            frequencies,
            omega: 6.0,
            smoothness: random.below(2) as f64,
        };
        let _ = wavelet::wavelet_ridge_rows(Image::new(&rows, height, width).unwrap(), &options);
    });
}
