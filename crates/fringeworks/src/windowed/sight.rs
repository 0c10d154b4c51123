//! What a window sees: moments that stop at walls.
//!
//! Windows far from walls are gathered from blocks; those near one are summed over smaller cells,
//! weighted by how much of the cell their centre sees.

use super::lattice::Lattice;
use super::moments::{self as m, CHANNELS, NodeRow, Window};
use super::walls::Walls;
use multiversion::multiversion;

/// Least visibility of a cell that is summed; less is rounding of the rays.
const MIN_VISIBLE: f32 = 0.02;

/// Cells along a side of a block: nothing is seen past a cell that holds a wall.
const BLOCK_CELLS: usize = 4;

/// A cell of the square around a centre, and the two before it on the ray that leads there.
struct Ray {
    own: u32,
    first: u32,
    second: u32,
    /// Share of the second.
    share: f32,
}

/// Rays to all cells of a square of half-width `radius`, from the inside out.
fn rays(radius: usize) -> Vec<Ray> {
    let radius = radius as isize;
    let index = |dx: isize, dy: isize| ((dy + radius) * (2 * radius + 1) + dx + radius) as u32;
    let mut rays = Vec::new();
    for ring in 1..=radius {
        let mut lead = |dx: isize, dy: isize| {
            let upright = dy.abs() == ring;
            let (across, along) = if upright { (dx, dy) } else { (dy, dx) };
            let position = across as f64 * (ring - 1) as f64 / ring as f64;
            let first = position.floor();
            let before = |k: isize| {
                let inner = along - along.signum();
                if upright {
                    index(k, inner)
                } else {
                    index(inner, k)
                }
            };
            let share = (position - first) as f32;
            let k = first as isize;
            rays.push(Ray {
                own: index(dx, dy),
                first: before(k),
                second: before(if share > 0.0 { k + 1 } else { k }),
                share,
            });
        };
        for t in -ring..=ring {
            lead(t, -ring);
            lead(t, ring);
            if t.abs() < ring {
                lead(-ring, t);
                lead(ring, t);
            }
        }
    }
    rays
}

/// The cells of a scale.
pub struct Cells<'a> {
    lattice: Lattice,
    /// Sums of the products of each cell, as those of blocks.
    sums: &'a [f64],
    /// Whether a wall is in the cell.
    walls: Vec<bool>,
}

impl<'a> Cells<'a> {
    /// The cells into which the blocks of a window are divided; those of one pixel are not.
    pub fn lattice(window: &Window, height: usize, width: usize) -> Lattice {
        Lattice::new((window.block / BLOCK_CELLS).max(1), height, width)
    }

    pub fn new(lattice: Lattice, sums: &'a [f64], walls: &Walls) -> Self {
        let walls = lattice.any(&walls.mask, walls.mask.width());
        Self {
            lattice,
            sums,
            walls,
        }
    }
}

/// Sums over the cells that a centre sees.
pub struct Sight<'a> {
    cells: &'a Cells<'a>,
    walls: &'a Walls<'a>,
    /// Distance from a wall from which nothing is hidden, px.
    reach: usize,
    /// Half-width of the square that is summed, cells.
    radius: usize,
    rays: Vec<Ray>,
    /// Gaussian weight of a pixel at every offset along one axis, from −radius; their product sums to 1
    /// over the plane.
    weights: Vec<f64>,
    /// How much of each cell around the centre is seen, 0…1.
    visible: Vec<f32>,
    /// How much of what is behind it is seen.
    through: Vec<f32>,
    /// Weights of the cells of a row, and the same times their offset to the power 1 and 2.
    row: [Vec<f64>; 3],
}

impl<'a> Sight<'a> {
    pub fn new(cells: &'a Cells<'a>, walls: &'a Walls<'a>, window: &Window) -> Self {
        let size = cells.lattice.block;
        let reach = Walls::reach(window);
        let radius = reach / size;
        let norm = (std::f64::consts::TAU.sqrt() * window.sigma).recip();
        let weights = (0..=2 * radius)
            .map(|k| (k as f64 - radius as f64) * size as f64 / window.sigma)
            .map(|z| norm * (-0.5 * z * z).exp())
            .collect();
        let side = 2 * radius + 1;
        Self {
            cells,
            walls,
            reach,
            radius,
            rays: rays(radius),
            weights,
            visible: vec![0.0; side * side],
            through: vec![0.0; side * side],
            row: std::array::from_fn(|_| vec![0.0; side]),
        }
    }

    /// Pass visibility on from ring to ring, along the rays from the centre.
    fn look(&mut self, (cx, cy): (usize, usize)) {
        let columns = self.cells.lattice.columns;
        let (x0, x1) = clipped(cx, self.radius, columns);
        let (y0, y1) = clipped(cy, self.radius, self.cells.lattice.rows);
        let side = 2 * self.radius + 1;
        self.visible.fill(0.0);
        self.through.fill(0.0);
        for y in y0..y1 {
            let first = (y + self.radius - cy) * side + x0 + self.radius - cx;
            let walls = &self.cells.walls[y * columns + x0..y * columns + x1];
            for (through, wall) in self.through[first..].iter_mut().zip(walls) {
                *through = !*wall as u8 as f32;
            }
        }
        self.visible[self.radius * (side + 1)] = 1.0;
        for ray in &self.rays {
            let (first, second) = (
                self.through[ray.first as usize],
                self.through[ray.second as usize],
            );
            let own = ray.own as usize;
            self.visible[own] = first + ray.share * (second - first);
            self.through[own] *= self.visible[own];
        }
    }

    /// Replace the moments of the nodes of a row that are near a wall.
    pub fn replace(&mut self, gathered: &mut NodeRow, row: usize, nodes: Lattice) {
        let cells = self.cells.lattice;
        for column in 0..nodes.columns {
            let (x, y) = self.walls.pixel_of(nodes.block, row, column);
            if !self.walls.within(x, y, self.reach) {
                continue;
            }
            let from = (x / cells.block, y / cells.block);
            let hidden = self.cells.walls[from.1 * cells.columns + from.0];
            let moments = if hidden {
                [0.0; CHANNELS]
            } else {
                self.moments(from, (nodes.centre(column), nodes.centre(row)))
            };
            gathered.set(column, moments);
        }
    }

    /// Moments about a node's centre of the cells that are seen from cell `from`.
    fn moments(&mut self, from: (usize, usize), (cx, cy): (f64, f64)) -> [f64; CHANNELS] {
        self.look(from);
        let Lattice { rows, columns, .. } = self.cells.lattice;
        let centre = |i: usize| self.cells.lattice.centre(i);
        let (x0, x1) = clipped(from.0, self.radius, columns);
        let (y0, y1) = clipped(from.1, self.radius, rows);
        let across = &self.weights[x0 + self.radius - from.0..];
        let side = 2 * self.radius + 1;
        let stored = m::stored_channels(self.cells.lattice.block) * columns;
        let mut sums = [0.0; CHANNELS];
        for y in y0..y1 {
            let down = self.weights[y + self.radius - from.1];
            let seen = (y + self.radius - from.1) * side + x0 + self.radius - from.0;
            let [plain, first, second] = &mut self.row;
            for k in 0..x1 - x0 {
                let visible = self.visible[seen + k];
                let visible = if visible < MIN_VISIBLE { 0.0 } else { visible };
                let dx = centre(x0 + k) - cx;
                plain[k] = visible as f64 * down * across[k];
                first[k] = plain[k] * dx;
                second[k] = first[k] * dx;
            }
            let row = CellRow {
                sums: &self.cells.sums[y * stored..(y + 1) * stored],
                columns,
                first: x0,
                weights: [plain, first, second].map(|weights| &weights[..x1 - x0]),
            };
            add_row(&row, &mut sums, centre(y) - cy);
        }
        sums
    }
}

/// First cell, and the one after the last, within a distance of a position.
fn clipped(position: usize, reach: usize, count: usize) -> (usize, usize) {
    (
        position.saturating_sub(reach),
        (position + reach + 1).min(count),
    )
}

/// Neighbouring cells of a row, and their weights.
struct CellRow<'a> {
    sums: &'a [f64],
    columns: usize,
    first: usize,
    weights: [&'a [f64]; 3],
}

/// Values that are summed at once, so that processors with wide registers add them together.
const LANES: usize = 4;

impl CellRow<'_> {
    /// Sum of a channel times the weights, which are multiplied by a power of the offset.
    #[inline(always)]
    fn sum(&self, channel: usize, power: usize) -> f64 {
        let weights = self.weights[power];
        let from = channel * self.columns + self.first;
        let values = &self.sums[from..from + weights.len()];
        let mut lanes = [0.0f64; LANES];
        let (w, v) = (weights.chunks_exact(LANES), values.chunks_exact(LANES));
        let rest = w.remainder().iter().zip(v.remainder());
        let mut total: f64 = rest.map(|(w, v)| w * v).sum();
        for (w, v) in w.zip(v) {
            for l in 0..LANES {
                lanes[l] += w[l] * v[l];
            }
        }
        for lane in lanes {
            total += lane;
        }
        total
    }
}

/// Add the cells to the moments about a node that is `dy` px above them.
#[multiversion(targets(
    "x86_64+avx512f+avx512vl",
    "x86_64+avx2+fma",
    "x86_64+avx",
    "aarch64+neon"
))]
fn add_row(row: &CellRow, sums: &mut [f64; CHANNELS], dy: f64) {
    let mut plain = [0.0; m::PLAIN];
    for (channel, sum) in plain.iter_mut().enumerate() {
        *sum = row.sum(channel, 0);
        sums[channel] += *sum;
    }
    let mut gg_x = 0.0;
    for c in 0..4 {
        let along = row.sum(m::G + c, 1);
        sums[m::GX + c] += along;
        sums[m::GY + c] += dy * plain[m::G + c];
        gg_x = along;
    }
    sums[m::GGXX] += row.sum(m::GG, 2);
    sums[m::GGXY] += dy * gg_x;
    sums[m::GGYY] += dy * dy * plain[m::GG];
    if row.sums.len() < CHANNELS * row.columns {
        // A single pixel has no moments about its centre.
        return;
    }
    for c in 0..4 {
        sums[m::GX + c] += row.sum(m::GX + c, 0);
        sums[m::GY + c] += row.sum(m::GY + c, 0);
    }
    let (gg_gx, gg_gy) = (row.sum(m::GX + 3, 0), row.sum(m::GY + 3, 0));
    sums[m::GGXX] += row.sum(m::GGXX, 0) + 2.0 * row.sum(m::GX + 3, 1);
    sums[m::GGXY] += row.sum(m::GGXY, 0) + dy * gg_gx + row.sum(m::GY + 3, 1);
    sums[m::GGYY] += row.sum(m::GGYY, 0) + 2.0 * dy * gg_gy;
}
