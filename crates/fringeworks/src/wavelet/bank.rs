//! Wavelets in the frequency domain, and the nodes at which their coefficients are computed.

use super::Options;
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};
use std::f32::consts::TAU;
use std::sync::Arc;

/// Beyond this many 1/a of its centre a wavelet's spectrum is below 10⁻⁵.
const BANDWIDTH: f64 = 4.8;
/// The border's width in envelopes of the coarsest wavelet.
const MARGIN: f64 = 3.0;

/// Wavelets in the frequency domain, for one length of row.
pub struct Bank {
    pub width: usize,
    pub margin: usize,
    pub length: usize,
    pub nodes: usize,
    /// Distance of neighbouring nodes, px; the first lies on the first sample of the border.
    pub pitch: f32,
    /// First bin and gains of every scale, one per node.
    pub windows: Vec<(isize, Vec<f32>)>,
    /// Envelope of every scale, px.
    pub scales: Vec<f32>,
    pub omega: f32,
    pub forward: Arc<dyn Fft<f32>>,
    pub inverse: Arc<dyn Fft<f32>>,
}

impl Bank {
    pub fn new(width: usize, options: &Options) -> Self {
        let scale = |f: f64| options.omega / (std::f64::consts::TAU * f);
        let margin = ((MARGIN * scale(options.frequencies[0])).ceil() as usize).min(width);
        let length = fast_length(width + 2 * margin);
        let per_bin = std::f64::consts::TAU / length as f64;
        let finest = scale(options.frequencies[options.frequencies.len() - 1]);
        let band = (2.0 * BANDWIDTH / finest / per_bin).ceil() as usize + 1;
        let nodes = fast_length(band).min(length);
        let windows = options
            .frequencies
            .iter()
            .map(|f| {
                let a = scale(*f);
                let first = (options.omega / a / per_bin).round() as isize - (nodes / 2) as isize;
                let gain = |k: isize| {
                    let t = a * k as f64 * per_bin - options.omega;
                    // Negative frequencies are the mirror image of a real row.
                    let height = if k > 0 { (-0.5 * t * t).exp() } else { 0.0 };
                    (height * 2.0 / length as f64) as f32
                };
                let gains = (0..nodes as isize).map(|k| gain(first + k)).collect();
                (first, gains)
            })
            .collect();
        let mut planner = FftPlanner::new();
        Self {
            width,
            margin,
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

    /// Wave of the bin that a scale's coefficients were demodulated by, at a node.
    pub fn shift(&self, scale: usize, node: usize) -> Complex32 {
        let turns = (self.windows[scale].0 * node as isize).rem_euclid(self.nodes as isize);
        Complex32::from_polar(1.0, TAU * turns as f32 / self.nodes as f32)
    }
}

/// Next length that has no prime factor above 5.
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
