//! What a window sees: moments that stop at walls.
//!
//! Windows far from walls are gathered from blocks; those near one are summed pixel by pixel, weighted
//! by how much of the pixel their centre sees.

use super::moments::{self as m, NodeRow, Window, CHANNELS};
use super::walls::Walls;
use super::warp::{Pair, Warped};
use multiversion::multiversion;

/// Least visibility of a pixel that is summed; less is rounding of the rays.
const MIN_VISIBLE: f32 = 0.02;

/// A pixel of the square around a centre, and the two before it on the ray that leads there.
struct Ray {
    own: u32,
    first: u32,
    second: u32,
    /// Share of the second.
    share: f32,
}

/// Rays to all pixels of a square of half-width `radius`, from the inside out.
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

/// Sums over the pixels that a centre sees.
pub struct Sight<'a> {
    pair: &'a Pair<'a>,
    walls: &'a Walls<'a>,
    warped: &'a Warped,
    radius: usize,
    rays: Vec<Ray>,
    /// Gaussian weight of every offset along one axis, from −radius; their product sums to 1 over the plane.
    weights: Vec<f64>,
    /// How much of each pixel around the centre is seen, 0…1.
    visible: Vec<f32>,
    /// Weights of a row's pixels.
    row: Vec<f64>,
}

impl<'a> Sight<'a> {
    pub fn new(
        pair: &'a Pair<'a>,
        walls: &'a Walls<'a>,
        warped: &'a Warped,
        window: &Window,
    ) -> Self {
        let radius = Walls::reach(window);
        let norm = (std::f64::consts::TAU.sqrt() * window.sigma).recip();
        let weights = (0..=2 * radius)
            .map(|k| (k as f64 - radius as f64) / window.sigma)
            .map(|z| norm * (-0.5 * z * z).exp())
            .collect();
        let side = 2 * radius + 1;
        Self {
            pair,
            walls,
            warped,
            radius,
            rays: rays(radius),
            weights,
            visible: vec![0.0; side * side],
            row: vec![0.0; side],
        }
    }

    /// Pass visibility on from ring to ring, along the rays from the centre.
    fn look(&mut self, (cx, cy): (usize, usize)) {
        let (x0, x1) = clipped(cx, self.radius, self.pair.width);
        let (y0, y1) = clipped(cy, self.radius, self.pair.height);
        let side = 2 * self.radius + 1;
        self.visible.fill(0.0);
        for y in y0..y1 {
            let first = (y + self.radius - cy) * side + x0 + self.radius - cx;
            let walls = &self.walls.mask[y * self.pair.width + x0..y * self.pair.width + x1];
            for (visible, wall) in self.visible[first..].iter_mut().zip(walls) {
                *visible = (*wall == 0) as u8 as f32;
            }
        }
        for ray in &self.rays {
            let (first, second) = (
                self.visible[ray.first as usize],
                self.visible[ray.second as usize],
            );
            self.visible[ray.own as usize] *= first + ray.share * (second - first);
        }
    }

    /// Replace the moments of the nodes of a row that are near a wall.
    pub fn replace(&mut self, gathered: &mut NodeRow, row: usize, window: &Window) {
        let columns = self.pair.width.div_ceil(window.block);
        for column in 0..columns {
            let from = self.walls.pixel_of(window.block, row, column);
            if !self.walls.within(from.0, from.1, self.radius) {
                continue;
            }
            let centre = (window.centre(column), window.centre(row));
            let moments = if self.walls.is_wall(from.0, from.1) {
                [0.0; CHANNELS]
            } else {
                self.moments(from, centre)
            };
            gathered.set(column, moments);
        }
    }

    /// Moments about a node's centre of the pixels that it sees from pixel `from`.
    fn moments(&mut self, from: (usize, usize), (cx, cy): (f64, f64)) -> [f64; CHANNELS] {
        self.look(from);
        let (x0, x1) = clipped(from.0, self.radius, self.pair.width);
        let (y0, y1) = clipped(from.1, self.radius, self.pair.height);
        let (values, slopes, known) = self.warped;
        let mut sums = [0.0; CHANNELS];
        for y in y0..y1 {
            let down = self.weights[y + self.radius - from.1];
            let side = 2 * self.radius + 1;
            let seen = (y + self.radius - from.1) * side + x0 + self.radius - from.0;
            let here = y * self.pair.width + x0..y * self.pair.width + x1;
            let across = &self.weights[x0 + self.radius - from.0..];
            let seen = &self.visible[seen..];
            for (k, weight) in self.row[..x1 - x0].iter_mut().enumerate() {
                let visible = if seen[k] < MIN_VISIBLE { 0.0 } else { seen[k] };
                let open = (known[here.start + k] > 0) as u8 as f32;
                *weight = (visible * open) as f64 * down * across[k];
            }
            let samples = Samples {
                weight: &self.row[..x1 - x0],
                value: &values[here.clone()],
                slope: &slopes[here.clone()],
                object: &self.pair.object[here.clone()],
                albedo: self.pair.albedo.map(|albedo| &albedo[here]),
            };
            add(&samples, &mut sums, x0 as f64 - cx, y as f64 - cy);
        }
        sums
    }
}

/// First pixel, and the one after the last, within a distance of a position.
fn clipped(position: usize, reach: usize, side: usize) -> (usize, usize) {
    (
        position.saturating_sub(reach),
        (position + reach + 1).min(side),
    )
}

/// Samples that are summed at once, so that processors with wide registers add them together.
const LANES: usize = 8;

/// Sums along a row: the plain ones, then x times β g, s g, d g and g², and x² g².
const ALONG: usize = m::PLAIN + 5;

/// Neighbouring pixels of a row of the frame.
struct Samples<'a> {
    weight: &'a [f64],
    value: &'a [f32],
    slope: &'a [f32],
    object: &'a [f32],
    albedo: Option<&'a [f32]>,
}

/// Add the pixels to the moments; (dx, dy) leads from the node to the first one.
fn add(samples: &Samples, sums: &mut [f64; CHANNELS], dx: f64, dy: f64) {
    let mut lanes = [[0.0f64; LANES]; ALONG];
    add_row(samples, &mut lanes, dx);
    let total = lanes.map(|lane| lane.iter().sum::<f64>());
    for (sum, value) in sums.iter_mut().zip(&total[..m::PLAIN]) {
        *sum += value;
    }
    for c in 0..4 {
        sums[m::GX + c] += total[m::PLAIN + c];
        sums[m::GY + c] += dy * total[m::G + c];
    }
    sums[m::GGXX] += total[m::PLAIN + 4];
    sums[m::GGXY] += dy * total[m::PLAIN + 3];
    sums[m::GGYY] += dy * dy * total[m::GG];
}

#[multiversion(targets(
    "x86_64+avx512f+avx512vl",
    "x86_64+avx2+fma",
    "x86_64+avx",
    "aarch64+neon"
))]
fn add_row(samples: &Samples, lanes: &mut [[f64; LANES]; ALONG], dx: f64) {
    let n = samples.weight.len();
    let whole = n - n % LANES;
    for first in (0..whole).step_by(LANES) {
        add_lanes(samples, lanes, first, LANES, dx);
    }
    add_lanes(samples, lanes, whole, n - whole, dx);
}

#[inline(always)]
fn add_lanes(
    samples: &Samples,
    lanes: &mut [[f64; LANES]; ALONG],
    first: usize,
    count: usize,
    dx: f64,
) {
    let load = |from: &[f32]| -> [f64; LANES] {
        let from = &from[first..first + count];
        std::array::from_fn(|l| if l < count { from[l] as f64 } else { 0.0 })
    };
    let weights = &samples.weight[first..first + count];
    let w: [f64; LANES] = std::array::from_fn(|l| if l < count { weights[l] } else { 0.0 });
    let one = samples.albedo.map_or([1.0; LANES], load);
    let (value, slope, d) = (
        load(samples.value),
        load(samples.slope),
        load(samples.object),
    );
    for l in 0..LANES {
        let (b, d, w) = (one[l], d[l], w[l]);
        let (s, g) = (b * value[l], b * slope[l]);
        let x = dx + (first + l) as f64;
        let (wg, wd) = (w * g, w * d);
        let along = [wg * b, wg * s, wg * d, wg * g];
        let products = [w * b * b, w * b * s, w * s * s, wd * b, wd * s, wd * d];
        for (c, product) in products.into_iter().enumerate() {
            lanes[c][l] += product;
        }
        for (c, product) in along.into_iter().enumerate() {
            lanes[m::G + c][l] += product;
            lanes[m::PLAIN + c][l] += x * product;
        }
        lanes[m::COUNT][l] += w;
        lanes[m::PLAIN + 4][l] += x * x * along[3];
    }
}
