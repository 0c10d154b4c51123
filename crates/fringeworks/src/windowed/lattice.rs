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
    /// Blocks of side `block` px over a frame.
    pub fn new(block: usize, height: usize, width: usize) -> Self {
        Self {
            rows: height.div_ceil(block),
            columns: width.div_ceil(block),
            block,
        }
    }

    /// Pixel coordinate of the centre of block `i` along an axis.
    pub fn centre(&self, i: usize) -> f64 {
        (i as f64 + 0.5) * self.block as f64 - 0.5
    }

    /// Whether a block holds a pixel that is not 0, for a mask as wide as the frame.
    pub fn any(&self, mask: &[u8], width: usize) -> Vec<bool> {
        let mut found = vec![false; self.rows * self.columns];
        for (y, row) in mask.chunks(width).enumerate() {
            let found = &mut found[y / self.block * self.columns..][..self.columns];
            for (found, pixels) in found.iter_mut().zip(row.chunks(self.block)) {
                *found |= pixels.iter().any(|pixel| *pixel > 0);
            }
        }
        found
    }

    /// Offset (x, y) of a pixel from a node (row, column), px.
    pub fn offset(&self, (x, y): (usize, usize), (row, column): (usize, usize)) -> (f32, f32) {
        let from = |pixel: usize, i: usize| (pixel as f64 - self.centre(i)) as f32;
        (from(x, column), from(y, row))
    }

    fn position(&self, pixel: f64) -> f64 {
        (pixel + 0.5) / self.block as f64 - 0.5
    }

    /// The rows of nodes above and below a pixel position, and the share of the second.
    pub fn rows_around(&self, y: f64) -> (usize, usize, f32) {
        between(self.position(y), self.rows)
    }

    /// The pixels of a row of a frame in stretches between the same two columns of nodes; beyond the
    /// first and the last column, these are the same.
    pub fn stretches(
        &self,
        width: usize,
    ) -> impl Iterator<Item = (usize, usize, std::ops::Range<usize>)> {
        let (block, last) = (self.block, self.columns - 1);
        // First pixel at or behind the centre of a node.
        let from = move |column: usize| (column * block + block / 2).min(width);
        let inner = (0..last).map(move |c| (c, c + 1, from(c)..from(c + 1)));
        std::iter::once((0, 0, 0..from(0)))
            .chain(inner)
            .chain(std::iter::once((last, last, from(last)..width)))
    }

    /// Interpolate values of nodes at the pixels of row `y` of a frame.
    fn interpolate(&self, values: &[f32], y: usize, out: &mut [f32]) {
        let (above, below, down) = self.rows_around(y as f64);
        let row = |row: usize| &values[row * self.columns..(row + 1) * self.columns];
        let (above, below) = (row(above), row(below));
        let at = |column: usize| above[column] + down * (below[column] - above[column]);
        for (first, second, pixels) in self.stretches(out.len()) {
            let (value, step) = (at(first), at(second) - at(first));
            let from = self.offset((pixels.start, 0), (0, first)).0;
            for (k, out) in out[pixels].iter_mut().enumerate() {
                *out = value + step * (from + k as f32) / self.block as f32;
            }
        }
    }

    /// Row, column and bilinear weight of the four nodes around a pixel position.
    pub fn corners(&self, x: f64, y: f64) -> [(usize, usize, f32); 4] {
        let (c0, c1, tx) = between(self.position(x), self.columns);
        let (r0, r1, ty) = self.rows_around(y);
        [
            (r0, c0, (1.0 - tx) * (1.0 - ty)),
            (r0, c1, tx * (1.0 - ty)),
            (r1, c0, (1.0 - tx) * ty),
            (r1, c1, tx * ty),
        ]
    }
}

/// Weights along one axis that smooth mean squares over neighbouring blocks: σ of one block.
const SPREAD: [f32; 5] = [1.0, 4.0, 6.0, 4.0, 1.0];

/// Mean and mean square of a difference over the blocks of a lattice.
pub struct Differences {
    lattice: Lattice,
    means: Vec<f32>,
    /// Smoothed over neighbouring blocks.
    squares: Vec<f32>,
}

impl Differences {
    /// Average `value(pixel index)` over each block without the pixels that are `None`; 0 for a block
    /// without values.
    pub fn new(
        lattice: Lattice,
        height: usize,
        width: usize,
        value: impl Fn(usize) -> Option<f32> + Sync,
    ) -> Self {
        let nodes = lattice.rows * lattice.columns;
        let (mut means, mut squares) = (vec![0.0f32; nodes], vec![0.0f32; nodes]);
        let mut counts = vec![0.0f32; nodes];
        means
            .par_chunks_mut(lattice.columns)
            .zip(squares.par_chunks_mut(lattice.columns))
            .zip(counts.par_chunks_mut(lattice.columns))
            .enumerate()
            .for_each(|(row, ((means, squares), counts))| {
                let first = row * lattice.block;
                for y in first..(first + lattice.block).min(height) {
                    for x in 0..width {
                        if let Some(v) = value(y * width + x) {
                            let at = x / lattice.block;
                            means[at] += v;
                            squares[at] += v * v;
                            counts[at] += 1.0;
                        }
                    }
                }
            });
        let around = spread(&counts, &lattice);
        let squares = quotient(&spread(&squares, &lattice), &around);
        Self {
            lattice,
            means: quotient(&means, &counts),
            squares,
        }
    }

    /// Mean difference around the pixels of a row.
    pub fn mean(&self, y: usize, out: &mut [f32]) {
        self.lattice.interpolate(&self.means, y, out);
    }

    /// Mean squared difference around the pixels of a row, over the neighbouring blocks.
    pub fn mean_square(&self, y: usize, out: &mut [f32]) {
        self.lattice.interpolate(&self.squares, y, out);
    }
}

/// Sums of the values over neighbouring nodes, with the weights of `SPREAD`.
fn spread(values: &[f32], lattice: &Lattice) -> Vec<f32> {
    let (rows, columns) = (lattice.rows as isize, lattice.columns as isize);
    let along = |values: &[f32], (dr, dc): (isize, isize)| -> Vec<f32> {
        (0..rows * columns)
            .into_par_iter()
            .map(|i| {
                let (row, column) = (i / columns, i % columns);
                (-2isize..=2)
                    .zip(SPREAD)
                    .map(|(k, weight)| (row + k * dr, column + k * dc, weight))
                    .filter(|(r, c, _)| (0..rows).contains(r) && (0..columns).contains(c))
                    .map(|(r, c, weight)| weight * values[(r * columns + c) as usize])
                    .sum()
            })
            .collect()
    };
    along(&along(values, (0, 1)), (1, 0))
}

fn quotient(sums: &[f32], counts: &[f32]) -> Vec<f32> {
    sums.iter()
        .zip(counts)
        .map(|(sum, count)| if *count > 0.0 { sum / count } else { 0.0 })
        .collect()
}
