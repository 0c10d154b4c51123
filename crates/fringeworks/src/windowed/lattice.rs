//! The nodes of a scale, and interpolation between them.

use rayon::prelude::*;

/// Nodes of a scale, which lie at the centres of square blocks of pixels.
#[derive(Clone, Copy)]
pub struct Lattice {
    pub rows: usize,
    pub columns: usize,
    /// Side of a block, px.
    pub block: usize,
}

/// The two nodes around a position, and the share of the second.
fn between(position: f64, count: usize) -> (usize, usize, f32) {
    let clamped = position.clamp(0.0, (count - 1) as f64);
    let first = (clamped as usize).min(count - 1);
    let second = (first + 1).min(count - 1);
    (first, second, (clamped - first as f64) as f32)
}

impl Lattice {
    /// Offset (x, y) of a pixel from a node (row, column), px.
    pub fn offset(&self, (x, y): (usize, usize), (row, column): (usize, usize)) -> (f32, f32) {
        let centre = |i: usize| (i as f32 + 0.5) * self.block as f32 - 0.5;
        (x as f32 - centre(column), y as f32 - centre(row))
    }

    /// Row, column and bilinear weight of the four nodes around a pixel position.
    pub fn corners(&self, x: f64, y: f64) -> [(usize, usize, f32); 4] {
        let position = |pixel: f64| (pixel + 0.5) / self.block as f64 - 0.5;
        let (c0, c1, tx) = between(position(x), self.columns);
        let (r0, r1, ty) = between(position(y), self.rows);
        [
            (r0, c0, (1.0 - tx) * (1.0 - ty)),
            (r0, c1, tx * (1.0 - ty)),
            (r1, c0, (1.0 - tx) * ty),
            (r1, c1, tx * ty),
        ]
    }
}

/// Values averaged over the blocks of a lattice.
pub struct BlockMeans {
    lattice: Lattice,
    values: Vec<f32>,
}

impl BlockMeans {
    /// Average `value(pixel index)` over each block without the pixels that are `None`; 0 for a block
    /// without values.
    pub fn new(
        lattice: Lattice,
        height: usize,
        width: usize,
        value: impl Fn(usize) -> Option<f32> + Sync,
    ) -> Self {
        let mut values = vec![0.0f32; lattice.rows * lattice.columns];
        values
            .par_chunks_mut(lattice.columns)
            .enumerate()
            .for_each(|(row, out)| {
                let mut counts = vec![0u32; out.len()];
                let first = row * lattice.block;
                for y in first..(first + lattice.block).min(height) {
                    for x in 0..width {
                        if let Some(v) = value(y * width + x) {
                            out[x / lattice.block] += v;
                            counts[x / lattice.block] += 1;
                        }
                    }
                }
                for (sum, count) in out.iter_mut().zip(counts) {
                    *sum /= count.max(1) as f32;
                }
            });
        Self { lattice, values }
    }

    /// Bilinear interpolation at a pixel.
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.lattice
            .corners(x as f64, y as f64)
            .iter()
            .map(|(r, c, w)| w * self.values[r * self.lattice.columns + c])
            .sum()
    }
}
