//! The ridge of one row.

use super::bank::Bank;
use rustfft::num_complex::Complex32;

/// Number of times that the row is continued beyond its ends by its ridge.
///
/// Each continuation improves the ridge near the ends, which the next one uses. An empirical choice.
const CONTINUATIONS: usize = 4;

/// Every how many-th scale is computed for the continuations, which need the ridge roughly only.
const COARSE_STRIDE: usize = 4;

/// Half-width of the mean of the curvature, in envelopes.
///
/// Noise in the frequency is correlated over an envelope, and its slope must average over more. An
/// empirical choice.
const SMOOTHING_ENVELOPES: f32 = 2.0;

/// Largest change of scale between neighbouring nodes of a smooth ridge, in scales; bounds the cost of
/// the search.
const MAX_SCALE_CHANGE: usize = 3;

/// Largest part of a row at either end whose curvature is taken from further inside.
const MAX_RIM: f32 = 0.25;

/// Least squared coefficient that a logarithm is taken of.
const MIN_POWER: f32 = 1e-30;

/// Least curvature of the parabola through three logarithms, so that its vertex stays finite.
const MIN_CURVATURE: f32 = 1e-6;

/// Arrays of one row, used again from row to row.
pub struct Scratch {
    /// The row with its borders.
    signal: Vec<Complex32>,
    spectrum: Vec<Complex32>,
    /// Coefficients at all nodes, scale after scale.
    coefficients: Vec<Complex32>,
    /// Squared magnitudes of the coefficients.
    power: Vec<f32>,
    /// Largest power of every node.
    best: Vec<f32>,
    /// Scale of the ridge at every node.
    index: Vec<u16>,
    /// Memory of the FFT.
    fft: Vec<Complex32>,
    /// Frequency of the ridge at every node, rad/px.
    omega: Vec<f32>,
    /// Curvature of the phase at every node, rad/px².
    curvature: Vec<f32>,
    /// Corrected wave of every node.
    wave: Vec<Complex32>,
    /// Memory of the running mean.
    sums: Vec<f64>,
    /// Memory of the smooth path.
    path: Vec<u16>,
}

impl Scratch {
    pub fn new(bank: &Bank) -> Self {
        let zero = Complex32::new(0.0, 0.0);
        let n = bank.nodes;
        let scratch = bank
            .forward
            .get_inplace_scratch_len()
            .max(bank.inverse.get_inplace_scratch_len());
        Self {
            signal: vec![zero; bank.length],
            spectrum: vec![zero; bank.length],
            coefficients: vec![zero; n * bank.scales.len()],
            power: vec![0.0; n * bank.scales.len()],
            best: vec![0.0; n],
            index: vec![0; n],
            fft: vec![zero; scratch],
            omega: vec![0.0; n],
            curvature: vec![0.0; n],
            wave: vec![zero; n],
            sums: vec![0.0; n + 1],
            path: Vec::new(),
        }
    }

    /// The ridge of one row.
    pub fn run(
        &mut self,
        bank: &Bank,
        row: &[f32],
        smoothness: f32,
        phasor: &mut [[f32; 2]],
        frequency: &mut [f32],
    ) {
        let mean = (row.iter().map(|v| *v as f64).sum::<f64>() / row.len() as f64) as f32;
        let inside = bank.border..bank.border + bank.width;
        self.signal.fill(Complex32::new(0.0, 0.0));
        for (s, v) in self.signal[inside].iter_mut().zip(row) {
            s.re = v - mean;
        }
        // Three scales at least: a peak between them is interpolated.
        let coarse = COARSE_STRIDE.min((bank.scales.len() - 1) / 2);
        for _ in 0..CONTINUATIONS {
            self.transform(bank, coarse);
            self.ridge(bank, coarse, 0.0);
            self.continue_row(bank, coarse);
        }
        self.transform(bank, 1);
        self.ridge(bank, 1, smoothness);
        self.refine(bank);
        self.blend(bank, phasor, frequency);
    }

    /// Coefficients and their squared magnitudes at every `stride`-th scale.
    fn transform(&mut self, bank: &Bank, stride: usize) {
        let (n, length) = (bank.nodes, bank.length as isize);
        self.spectrum.copy_from_slice(&self.signal);
        bank.forward
            .process_with_scratch(&mut self.spectrum, &mut self.fft);
        for k in (0..bank.scales.len()).step_by(stride) {
            let line = &mut self.coefficients[k * n..(k + 1) * n];
            let (first, weights) = &bank.windows[k];
            for (j, (c, weight)) in line.iter_mut().zip(weights).enumerate() {
                let bin = first + j as isize;
                // Outside the positive frequencies the weight is zero.
                *c = self.spectrum[bin.clamp(0, length - 1) as usize] * weight;
            }
            bank.inverse.process_with_scratch(line, &mut self.fft);
            for (p, c) in self.power[k * n..(k + 1) * n].iter_mut().zip(line.iter()) {
                *p = c.re * c.re + c.im * c.im;
            }
        }
    }

    /// Find the scale of every node, out of every `stride`-th scale.
    fn ridge(&mut self, bank: &Bank, stride: usize, smoothness: f32) {
        let n = bank.nodes;
        self.best.copy_from_slice(&self.power[..n]);
        self.index.fill(0);
        for k in (stride..bank.scales.len()).step_by(stride) {
            let line = &self.power[k * n..(k + 1) * n];
            for ((best, index), p) in self.best.iter_mut().zip(&mut self.index).zip(line) {
                let larger = *p > *best;
                *best = if larger { *p } else { *best };
                *index = if larger { k as u16 } else { *index };
            }
        }
        if smoothness > 0.0 {
            let mean = self.best.iter().sum::<f32>() / n as f32;
            self.smooth_path(bank.scales.len(), n, smoothness * mean);
        }
    }

    /// Find the path of scales with the largest sum of squared coefficients minus the cost of its
    /// changes, by dynamic programming.
    fn smooth_path(&mut self, scales: usize, n: usize, cost: f32) {
        self.path.clear();
        self.path.resize(scales * n, 0);
        let mut score: Vec<f32> = (0..scales).map(|k| self.power[k * n]).collect();
        let mut next = vec![0.0; scales];
        for i in 1..n {
            for k in 0..scales {
                let (mut best, mut from) = (f32::MIN, k);
                for j in k.saturating_sub(MAX_SCALE_CHANGE)..(k + MAX_SCALE_CHANGE + 1).min(scales)
                {
                    let step = j.abs_diff(k) as f32;
                    let value = score[j] - cost * step * step;
                    if value > best {
                        (best, from) = (value, j);
                    }
                }
                next[k] = best + self.power[k * n + i];
                self.path[i * scales + k] = from as u16;
            }
            std::mem::swap(&mut score, &mut next);
        }
        let mut k = (0..scales)
            .max_by(|a, b| score[*a].total_cmp(&score[*b]))
            .unwrap_or(0);
        for i in (0..n).rev() {
            self.index[i] = k as u16;
            k = self.path[i * scales + k] as usize;
        }
    }

    /// Fill both borders with the wave of the ridge one envelope inside the row, so that wavelets at the
    /// row's ends have the same surroundings as inside.
    fn continue_row(&mut self, bank: &Bank, stride: usize) {
        let n = bank.nodes;
        let (from, to) = (bank.border, bank.border + bank.width);
        let node = |x: f32| ((x / bank.pitch).round() as usize).min(n - 1);
        for at_start in [true, false] {
            let edge = (if at_start { from } else { to - 1 }) as f32;
            let scale = bank.scales[self.index[node(edge)] as usize];
            let inward = scale.min(0.5 * bank.width as f32);
            let i = node(if at_start {
                edge + inward
            } else {
                edge - inward
            });
            let k = self.index[i] as usize;
            let omega = ridge_frequency(bank, &self.power, k, i, stride);
            let value = self.coefficients[k * n + i] * bank.shift(k, i);
            let (size, phase) = (value.norm(), value.arg());
            let border = if at_start {
                0..from
            } else {
                to..to + bank.border
            };
            for x in border {
                let distance = x as f32 - i as f32 * bank.pitch;
                self.signal[x] = Complex32::new(size * (phase + omega * distance).cos(), 0.0);
            }
        }
    }

    /// Frequency, curvature and corrected wave of every node.
    fn refine(&mut self, bank: &Bank) {
        let n = bank.nodes;
        for i in 0..n {
            self.omega[i] = ridge_frequency(bank, &self.power, self.index[i] as usize, i, 1);
        }
        // The row was continued without curvature, so its ends take the curvature of the nodes one
        // envelope inside.
        let node = |x: f32| ((x / bank.pitch).round() as usize).min(n - 1);
        let (first, last) = (bank.border as f32, (bank.border + bank.width - 1) as f32);
        let mut middle: Vec<u16> = self.index[node(first)..=node(last)].to_vec();
        let half = middle.len() / 2;
        let (_, typical, _) = middle.select_nth_unstable(half);
        let envelope = bank.scales[*typical as usize];
        let rim = envelope.min(MAX_RIM * (last - first));
        let inner = node(first + rim)..node(last - rim) + 1;
        let reach = (SMOOTHING_ENVELOPES * envelope / bank.pitch) as usize;
        let inside = &self.omega[inner.clone()];
        let count = inside.len();
        let mut slope: Vec<f32> = (0..count)
            .map(|i| {
                let (a, b) = (i.saturating_sub(1), (i + 1).min(count - 1));
                (inside[b] - inside[a]) / ((b - a).max(1) as f32 * bank.pitch)
            })
            .collect();
        // Two running means weigh with a triangle. Slopes are averaged instead of frequencies because a
        // mean over fewer samples at the ends does not change a constant slope.
        for _ in 0..2 {
            running_mean(&mut slope, reach.max(1), &mut self.sums);
        }
        for i in 0..n {
            self.curvature[i] = slope[i.clamp(inner.start, inner.end - 1) - inner.start];
        }
        for i in 0..n {
            let k = self.index[i] as usize;
            let a = bank.scales[k];
            let delta = self.omega[i] - bank.omega / a;
            self.wave[i] = self.coefficients[k * n + i]
                * bank.shift(k, i)
                * undo_window(a * a, delta, self.curvature[i]);
        }
    }

    /// Blend the waves of the two nodes beside every pixel, each with its frequency and curvature.
    fn blend(&self, bank: &Bank, phasor: &mut [[f32; 2]], frequency: &mut [f32]) {
        for (x, (phasor, frequency)) in phasor.iter_mut().zip(frequency).enumerate() {
            let at = (x + bank.border) as f32 / bank.pitch;
            let left = (at as usize).min(bank.nodes.saturating_sub(2));
            let right = (left + 1).min(bank.nodes - 1);
            let share = at - left as f32;
            let (mut sum, mut omega) = (Complex32::new(0.0, 0.0), 0.0);
            for (i, weight) in [(left, 1.0 - share), (right, share)] {
                let d = (at - i as f32) * bank.pitch;
                let phase = d * (self.omega[i] + 0.5 * self.curvature[i] * d);
                let (sine, cosine) = phase.sin_cos();
                sum += self.wave[i] * Complex32::new(cosine, sine) * weight;
                omega += weight * (self.omega[i] + self.curvature[i] * d);
            }
            *phasor = [sum.re, sum.im];
            *frequency = omega;
        }
    }
}

/// Frequency of the ridge, rad/px: the vertex of the parabola through the logarithms of the powers of
/// three neighbouring scales.
#[inline(always)]
fn ridge_frequency(bank: &Bank, power: &[f32], k: usize, i: usize, stride: usize) -> f32 {
    let n = bank.nodes;
    let last = (bank.scales.len() - 1) / stride * stride;
    let middle = k.clamp(stride, last - stride);
    let log = |k: usize| power[k * n + i].max(MIN_POWER).ln();
    let (below, here, above) = (log(middle - stride), log(middle), log(middle + stride));
    let curvature = (below - 2.0 * here + above).min(-MIN_CURVATURE);
    let offset = (0.5 * (below - above) / curvature).clamp(-1.0, 1.0);
    // Scales are in equal ratios, so one step is the same factor everywhere.
    let ratio = bank.scales[middle - stride] / bank.scales[middle];
    bank.omega / bank.scales[middle] * ratio.powf(offset)
}

/// Inverse of the factor (1 − i s2 c)^(−1/2) · exp(−½ s2 δ² / (1 − i s2 c)) with which a Gaussian window
/// of variance `s2` multiplies a wave of curvature `c` whose frequency is `delta` off (theory §5).
#[inline(always)]
fn undo_window(s2: f32, delta: f32, c: f32) -> Complex32 {
    let q = Complex32::new(1.0, -s2 * c);
    let exponent = Complex32::new(0.5 * s2 * delta * delta, 0.0) / q;
    exponent.exp() * q.sqrt()
}

/// Mean over `reach` samples to either side (fewer at the ends), in place.
fn running_mean(line: &mut [f32], reach: usize, sums: &mut [f64]) {
    let n = line.len();
    sums[0] = 0.0;
    for i in 0..n {
        sums[i + 1] = sums[i] + line[i] as f64;
    }
    for (i, out) in line.iter_mut().enumerate() {
        let (a, b) = (i.saturating_sub(reach), (i + reach + 1).min(n));
        *out = ((sums[b] - sums[a]) / (b - a) as f64) as f32;
    }
}
