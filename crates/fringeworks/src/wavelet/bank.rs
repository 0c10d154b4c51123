//! Wavelets in the frequency domain, and the nodes at which their coefficients are computed.

use super::Options;
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};
use std::f32::consts::TAU;
use std::sync::Arc;

/// Half the bandwidth of a wavelet, in units of 1/a: beyond, its spectrum is below 10⁻⁵.
const BANDWIDTH: f64 = 4.8;

/// Width of the border beyond each end of a row, in envelopes of the coarsest wavelet: at three
/// envelopes, a wavelet's weight is 0.01.
const BORDER_ENVELOPES: f64 = 3.0;

/// Wavelets in the frequency domain, for rows of one width.
pub struct Bank {
    /// Width of the rows, px.
    pub width: usize,
    /// Width of the border before and after a row, px.
    pub border: usize,
    /// Length of the row with its borders, px.
    pub length: usize,
    /// Number of nodes.
    pub nodes: usize,
    /// Distance of neighbouring nodes, px; the first lies on the first sample of the border.
    pub pitch: f32,
    /// First frequency bin of every scale, and the weights of as many bins as there are nodes.
    pub windows: Vec<(isize, Vec<f32>)>,
    /// Envelope of every scale, px.
    pub scales: Vec<f32>,
    /// ω₀.
    pub omega: f32,
    pub forward: Arc<dyn Fft<f32>>,
    pub inverse: Arc<dyn Fft<f32>>,
}

impl Bank {
    pub fn new(width: usize, options: &Options) -> Self {
        let scale = |f: f64| options.omega / (std::f64::consts::TAU * f);
        let border =
            ((BORDER_ENVELOPES * scale(options.frequencies[0])).ceil() as usize).min(width);
        let length = fast_length(width + 2 * border);
        let per_bin = std::f64::consts::TAU / length as f64;
        let finest = scale(options.frequencies[options.frequencies.len() - 1]);
        let band = (2.0 * BANDWIDTH / finest / per_bin).ceil() as usize + 1;
        let nodes = fast_length(band).min(length);
        let windows = options
            .frequencies
            .iter()
            .map(|f| spectrum(scale(*f), options.omega, length, nodes))
            .collect();
        let mut planner = FftPlanner::new();
        Self {
            width,
            border,
            length,
            nodes,
            pitch: (length as f64 / nodes as f64) as f32,
            windows,
            scales: options
                .frequencies
                .iter()
                .map(|f| scale(*f) as f32)
                .collect(),
            omega: options.omega as f32,
            forward: planner.plan_fft_forward(length),
            inverse: planner.plan_fft_inverse(nodes),
        }
    }

    /// Value at a node of the wave that a scale's coefficients were demodulated by.
    pub fn shift(&self, scale: usize, node: usize) -> Complex32 {
        let turns = (self.windows[scale].0 * node as isize).rem_euclid(self.nodes as isize);
        Complex32::from_polar(1.0, TAU * turns as f32 / self.nodes as f32)
    }
}

/// First bin of a wavelet of envelope `a` px, and the weights of `nodes` bins from there on, in the
/// spectrum of a row of `length` px.
fn spectrum(a: f64, omega: f64, length: usize, nodes: usize) -> (isize, Vec<f32>) {
    let per_bin = std::f64::consts::TAU / length as f64;
    let first = (omega / a / per_bin).round() as isize - (nodes / 2) as isize;
    let weight = |k: isize| {
        let t = a * k as f64 * per_bin - omega;
        // Negative frequencies mirror the positive ones in the spectrum of a real row.
        let height = if k > 0 { (-0.5 * t * t).exp() } else { 0.0 };
        (height * 2.0 / length as f64) as f32
    };
    let weights = (0..nodes as isize).map(|k| weight(first + k)).collect();
    (first, weights)
}

/// The next length without a prime factor above 5, which the FFT handles fast.
fn fast_length(n: usize) -> usize {
    (n..)
        .find(|m| {
            let mut rest = *m;
            for p in [2, 3, 5] {
                while rest % p == 0 {
                    rest /= p;
                }
            }
            rest == 1
        })
        .unwrap_or(n)
}
