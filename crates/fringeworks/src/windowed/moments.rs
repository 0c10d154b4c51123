//! Local moments of the warped pair, at a cost that does not grow with the window.
//!
//! The products of the normal equations are first summed over square blocks, with their first and
//! second moments about the centre of the block. A Gaussian of two blocks' σ then gathers the blocks.
//! A block is half of the window's σ wide, so every window costs the same number of taps. Larger
//! windows have fewer nodes, hence they cost less.
//!
//! Sums are f64: offset, modulation ratio and displacement are nearly collinear in a window that is
//! small against the fringe, and in f32 the rounding would decide between them.

use super::lattice::Lattice;
use super::warp::{Pair, WarpedRow, warp_row};
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::Range;

// Channels: products summed per block, of albedo β, reference s and slope g, both times β, and object d.
// Products with g are also summed times the offset (x, y) of the pixel, g² also times the squares of the
// offset.
/// β².
pub const M: usize = 0;
/// β s.
pub const S: usize = 1;
/// s².
pub const SS: usize = 2;
/// β d.
pub const D: usize = 3;
/// d s.
pub const DS: usize = 4;
/// d².
pub const DD: usize = 5;
/// β g, then s g and d g.
pub const G: usize = 6;
/// g².
pub const GG: usize = 9;
/// Weight: 1 for every pixel with data.
pub const COUNT: usize = 10;
/// Number of plain sums.
pub const PLAIN: usize = 11;
/// x times β g, s g, d g and g².
pub const GX: usize = 11;
/// y times β g, s g, d g and g².
pub const GY: usize = 15;
/// x² g².
pub const GGXX: usize = 19;
/// x y g².
pub const GGXY: usize = 20;
/// y² g².
pub const GGYY: usize = 21;
/// Number of channels.
pub const CHANNELS: usize = 22;

/// Half-width of the gathering Gaussian, in blocks: three of its σ, where its weight is 0.01.
pub const RADIUS: usize = 6;

/// Blocks that the Gaussian gathers along each axis.
const TAPS: usize = 2 * RADIUS + 1;
/// σ of the gathering Gaussian, in blocks; less where a block is a single pixel.
///
/// Two samples per σ represent a Gaussian almost exactly; more would cost more taps.
const SIGMA_BLOCKS: f64 = 2.0;

/// One window size: the width of its blocks, and its weights along one axis.
pub struct Window {
    /// Width σ, px.
    pub sigma: f64,
    /// Side of a block, px.
    pub block: usize,
    /// Weight of a pixel in the block at each offset, times the offset (px) to the power 0, 1 and 2.
    pub taps: [[f64; TAPS]; 3],
    /// 1 / Σ w² over the window: the effective number of pixels.
    pub effective_pixels: f64,
}

impl Window {
    /// A Gaussian window of σ `sigma` px.
    pub fn new(sigma: f64) -> Self {
        let block = (sigma / SIGMA_BLOCKS).round().max(1.0) as usize;
        let sigma_blocks = sigma / block as f64;
        let mut weight = [0.0f64; TAPS];
        for (k, w) in weight.iter_mut().enumerate() {
            let offset = k as f64 - RADIUS as f64;
            *w = (-0.5 * (offset / sigma_blocks).powi(2)).exp();
        }
        let total: f64 = weight.iter().sum::<f64>() * block as f64;
        let mut taps = [[0.0; TAPS]; 3];
        let mut squares = 0.0;
        for k in 0..TAPS {
            let w = weight[k] / total;
            let offset = (k as f64 - RADIUS as f64) * block as f64;
            taps[0][k] = w;
            taps[1][k] = w * offset;
            taps[2][k] = w * offset * offset;
            squares += w * w * block as f64;
        }
        Self {
            sigma,
            block,
            taps,
            effective_pixels: 1.0 / (squares * squares),
        }
    }

    /// The nodes of this window size over a frame.
    pub fn lattice(&self, height: usize, width: usize) -> Lattice {
        Lattice::new(self.block, height, width)
    }
}

/// Number of channels that are stored: single-pixel blocks have no moments about their centre.
pub fn stored_channels(block: usize) -> usize {
    if block == 1 { PLAIN } else { CHANNELS }
}

/// Block sums of all products in some block rows, laid out `[block row][channel][block column]`; 0 in
/// block rows that are not `wanted`.
pub fn block_sums(
    pair: &Pair,
    u: &[f32],
    lattice: Lattice,
    block_rows: Range<usize>,
    wanted: impl Fn(usize) -> bool + Sync,
) -> Vec<f64> {
    let Lattice { columns, block, .. } = lattice;
    let channels = stored_channels(block);
    let mut sums = vec![0.0; block_rows.len() * channels * columns];
    sums.par_chunks_mut(channels * columns)
        .zip(block_rows)
        .filter(|(_, block_row)| wanted(*block_row))
        .for_each_init(
            || WarpedRow::new(pair.width()),
            |warped, (out, block_row)| {
                let first = block_row * block;
                let last = (first + block).min(pair.height());
                for y in first..last {
                    let row = y * pair.width()..(y + 1) * pair.width();
                    warp_row(pair, y, &u[row.clone()], warped);
                    let object = &pair.object[row];
                    if block == 1 {
                        products(warped, object, out, columns);
                    } else {
                        let dy = y as f64 - lattice.centre(block_row);
                        sum_row(warped, object, block, dy, out, columns);
                    }
                }
            },
        );
    sums
}

/// Memory for the block sums of a band, in values: 8 MB. The sums of a whole frame in blocks of single
/// pixels would take 88 bytes a pixel.
const BAND_VALUES: usize = 1 << 20;

/// Block sums around a band of node rows, which moves down the frame.
pub struct BandSums {
    lattice: Lattice,
    /// Block rows whose sums are known.
    known: Range<usize>,
    sums: Vec<f64>,
}

impl BandSums {
    /// Sums of a lattice, without any row yet.
    pub fn new(lattice: Lattice) -> Self {
        Self {
            lattice,
            known: 0..0,
            sums: Vec::new(),
        }
    }

    /// Number of values of a block row.
    fn stride(&self) -> usize {
        stored_channels(self.lattice.block) * self.lattice.columns
    }

    /// Number of node rows of a band.
    pub fn height(&self) -> usize {
        (BAND_VALUES / self.stride()).max(2 * RADIUS)
    }

    /// Move on to the band of node rows that begins with `first`.
    pub fn move_to(&mut self, pair: &Pair, u: &[f32], first: usize) {
        let rows = self.lattice.rows;
        let wanted = first.saturating_sub(RADIUS)..(first + self.height() + RADIUS).min(rows);
        let passed = (wanted.start - self.known.start) * self.stride();
        self.sums.drain(..passed);
        let fresh = self.known.end..wanted.end;
        self.sums
            .append(&mut block_sums(pair, u, self.lattice, fresh, |_| true));
        self.known = wanted;
    }

    /// Sums of a block row; none beyond the frame.
    fn row(&self, block_row: usize) -> Option<&[f64]> {
        let stride = self.stride();
        let at = block_row.checked_sub(self.known.start)? * stride;
        self.sums.get(at..at + stride)
    }
}

/// Products of one pixel, in the order of the plain channels.
#[inline(always)]
fn plain_products(warped: &WarpedRow, object: &[f32], x: usize) -> [f64; PLAIN] {
    let q = warped.sample(x, object);
    let (one, s, g, d) = (q.albedo, q.value, q.slope, q.object);
    [
        one * one,
        one * s,
        s * s,
        one * d,
        d * s,
        d * d,
        one * g,
        s * g,
        d * g,
        g * g,
        q.weight,
    ]
}

/// Products of one row of single-pixel blocks.
fn products(warped: &WarpedRow, object: &[f32], out: &mut [f64], columns: usize) {
    let mut channel: Vec<&mut [f64]> = out.chunks_mut(columns).collect();
    for x in 0..columns {
        for (channel, product) in channel.iter_mut().zip(plain_products(warped, object, x)) {
            channel[x] = product;
        }
    }
}

/// Add one row of pixels to the sums of its blocks; `dy` is its offset from their centres.
fn sum_row(
    warped: &WarpedRow,
    object: &[f32],
    block: usize,
    dy: f64,
    out: &mut [f64],
    columns: usize,
) {
    let width = object.len();
    let half = (block as f64 - 1.0) * 0.5;
    for column in 0..columns {
        let first = column * block;
        let last = (first + block).min(width);
        let mut plain = [0.0f64; PLAIN];
        let mut along = [0.0f64; 4];
        let mut gg_xx = 0.0f64;
        for x in first..last {
            let products = plain_products(warped, object, x);
            let dx = (x - first) as f64 - half;
            for (sum, product) in plain.iter_mut().zip(products) {
                *sum += product;
            }
            for (c, sum) in along.iter_mut().enumerate() {
                *sum += dx * products[G + c];
            }
            gg_xx += dx * dx * products[GG];
        }
        for (c, v) in plain.iter().enumerate() {
            out[c * columns + column] += v;
        }
        for c in 0..4 {
            out[(GX + c) * columns + column] += along[c];
            out[(GY + c) * columns + column] += dy * plain[G + c];
        }
        out[GGXX * columns + column] += gg_xx;
        out[GGXY * columns + column] += dy * along[3];
        out[GGYY * columns + column] += dy * dy * plain[GG];
    }
}

/// `target[i] += weight · source[i]`, compiled for several instruction sets.
#[multiversion(targets(
    "x86_64+avx512f+avx512vl",
    "x86_64+avx2+fma",
    "x86_64+avx",
    "aarch64+neon"
))]
fn add_scaled(target: &mut [f64], source: &[f64], weight: f64) {
    for (t, s) in target.iter_mut().zip(source) {
        *t += weight * s;
    }
}

/// All window moments of one row of nodes, `CHANNELS` rows of `columns` values.
pub struct NodeRow {
    /// Sums gathered along columns: `CHANNELS` rows, padded by `RADIUS` zeros on both sides.
    vertical: Vec<f64>,
    moments: Vec<f64>,
    columns: usize,
}

impl NodeRow {
    pub fn new(columns: usize) -> Self {
        Self {
            vertical: vec![0.0; CHANNELS * (columns + 2 * RADIUS)],
            moments: vec![0.0; CHANNELS * columns],
            columns,
        }
    }

    pub fn get(&self, channel: usize, column: usize) -> f64 {
        self.moments[channel * self.columns + column]
    }

    /// Replace the moments of a node.
    pub fn set(&mut self, column: usize, moments: [f64; CHANNELS]) {
        for (channel, value) in moments.into_iter().enumerate() {
            self.moments[channel * self.columns + column] = value;
        }
    }

    /// Gather the blocks around node row `row`.
    pub fn gather(&mut self, sums: &BandSums, row: usize, window: &Window) {
        self.vertical.fill(0.0);
        self.moments.fill(0.0);
        self.gather_vertical(sums, row, window);
        self.gather_horizontal(window);
    }

    fn gather_vertical(&mut self, sums: &BandSums, row: usize, window: &Window) {
        let columns = self.columns;
        let padded = columns + 2 * RADIUS;
        let channels = stored_channels(window.block);
        let vertical = &mut self.vertical;
        for k in 0..TAPS {
            let Some(block_row) = (row + k).checked_sub(RADIUS).and_then(|r| sums.row(r)) else {
                continue;
            };
            let [w0, w1, w2] = [0, 1, 2].map(|power| window.taps[power][k]);
            let mut add = |target: usize, source: usize, weight: f64| {
                let t = target * padded + RADIUS;
                add_scaled(
                    &mut vertical[t..t + columns],
                    &block_row[source * columns..(source + 1) * columns],
                    weight,
                );
            };
            for c in 0..channels {
                add(c, c, w0);
            }
            for c in 0..4 {
                add(GY + c, G + c, w1);
            }
            add(GGYY, GG, w2);
            if window.block > 1 {
                add(GGXY, GX + 3, w1);
                add(GGYY, GY + 3, 2.0 * w1);
            }
        }
    }

    fn gather_horizontal(&mut self, window: &Window) {
        let columns = self.columns;
        let padded = columns + 2 * RADIUS;
        let (vertical, moments) = (&self.vertical, &mut self.moments);
        for k in 0..TAPS {
            let [w0, w1, w2] = [0, 1, 2].map(|power| window.taps[power][k]);
            let mut add = |target: usize, source: usize, weight: f64| {
                let s = source * padded + k;
                add_scaled(
                    &mut moments[target * columns..(target + 1) * columns],
                    &vertical[s..s + columns],
                    weight,
                );
            };
            for c in 0..PLAIN {
                add(c, c, w0);
            }
            for c in GY..GX + 8 {
                add(c, c, w0);
            }
            for c in 0..4 {
                add(GX + c, G + c, w1);
            }
            add(GGYY, GGYY, w0);
            add(GGXY, GY + 3, w1);
            add(GGXX, GG, w2);
            if window.block > 1 {
                for c in GX..GX + 4 {
                    add(c, c, w0);
                }
                add(GGXY, GGXY, w0);
                add(GGXX, GX + 3, 2.0 * w1);
                add(GGXX, GGXX, w0);
            }
        }
    }
}
