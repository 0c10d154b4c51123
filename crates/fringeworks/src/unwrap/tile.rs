//! The part of the spanning tree that one tile determines, in memory that fits the cache.

use super::groups::Groups;
use super::turns;

/// Side of a tile, px.
///
/// The edges and groups of 64 × 64 px fit the second cache. Smaller tiles leave more edges open.
pub const SIDE_PIXELS: usize = 64;

/// Bits per pass of the radix sort: three passes cover the 32 bits of the sorted half, and the counts
/// of a pass fit the first cache.
const DIGIT_BITS: u32 = 11;

/// Counts of one pass of the radix sort.
const DIGIT_VALUES: usize = 1 << DIGIT_BITS;

/// Exit of a group that no edge leaves the tile from.
const NO_EXIT: u64 = u64::MAX;

/// A wrapped map to unwrap.
pub struct Map<'a> {
    /// Wrapped phase, rad.
    pub phase: &'a [f32],
    pub mask: &'a [u8],
    /// Non-negative; small where the phase is reliable.
    pub rough: &'a [f32],
    pub height: usize,
    pub width: usize,
}

/// Results of a band of tiles for the whole map.
#[derive(Default)]
pub struct Band {
    /// Number of pixels of each group.
    pub sizes: Vec<u32>,
    /// Edges that the tiles could not decide on.
    pub open: Vec<u64>,
}

/// An edge as a number that sorts smooth edges first, then by place.
///
/// The upper half holds the bits of the sum of both ends' roughness; the bits of a non-negative float
/// sort like the float. The lower half holds the edge's upper or left pixel `a`, times two, plus one
/// for an edge that leads down.
#[inline(always)]
fn key(rough: &[f32], a: usize, b: usize, down: u64) -> u64 {
    let sum = (rough[a] + rough[b]).min(f32::MAX);
    (sum.to_bits() as u64) << 32 | (a as u64) << 1 | down
}

/// Both pixels of an edge.
#[inline(always)]
pub fn ends(edge: u64, width: usize) -> (usize, usize) {
    let place = edge as u32;
    let a = (place >> 1) as usize;
    (a, if place & 1 == 0 { a + 1 } else { a + width })
}

/// Memory for the tiles of a band.
pub struct Tile<'a> {
    map: &'a Map<'a>,
    groups: Groups,
    /// Smoothest edge that leaves the tile, per group.
    exit: Vec<u64>,
    /// Edges inside the tile.
    edges: Vec<u64>,
    /// Memory of the sort.
    spare: Vec<u64>,
    /// Number of a root's group within the band.
    number: Vec<u32>,
}

/// Place and size of a tile in the map, px.
#[derive(Clone, Copy)]
struct Area {
    y0: usize,
    x0: usize,
    rows: usize,
    columns: usize,
}

impl<'a> Tile<'a> {
    pub fn new(map: &'a Map<'a>) -> Self {
        Self {
            map,
            groups: Groups::new(Vec::new()),
            exit: Vec::new(),
            edges: Vec::new(),
            spare: Vec::new(),
            number: Vec::new(),
        }
    }

    /// Join the pixels of the tile whose upper left pixel is (`y0`, `x0`), as far as the tile decides.
    /// `order` and `group` are the rows of the band. Edges that leave the tile to the right or below
    /// are open.
    pub fn join(
        &mut self,
        y0: usize,
        x0: usize,
        order: &mut [i32],
        group: &mut [u32],
        band: &mut Band,
    ) {
        let area = Area {
            y0,
            x0,
            rows: SIDE_PIXELS.min(self.map.height - y0),
            columns: SIDE_PIXELS.min(self.map.width - x0),
        };
        self.collect(area, &mut band.open);
        sort(&mut self.edges, &mut self.spare);
        self.join_edges(area, &mut band.open);
        self.number_groups(area, order, group, &mut band.sizes);
    }

    /// Join the tile's groups along its edges, smoothest first. An edge that is rougher than the exits
    /// of both its groups is open.
    #[inline(always)]
    fn join_edges(&mut self, area: Area, open: &mut Vec<u64>) {
        let Area {
            y0,
            x0,
            rows,
            columns,
        } = area;
        let (phase, width) = (self.map.phase, self.map.width);
        self.groups.reset(rows * columns);
        let local = |i: usize| (i / width - y0) * columns + i % width - x0;
        for &edge in &self.edges {
            let (a, b) = ends(edge, width);
            let near = local(a);
            let far = if b == a + 1 { near + 1 } else { near + columns };
            let (root_a, order_a) = self.groups.find(near);
            let (root_b, order_b) = self.groups.find(far);
            if root_a == root_b {
                continue;
            }
            let exit = self.exit[root_a].min(self.exit[root_b]);
            if edge > self.exit[root_a].max(self.exit[root_b]) {
                open.push(edge);
                continue;
            }
            let step = -turns(phase[b] - phase[a]) as i32;
            let root = self.groups.unite(root_a, root_b, order_a + step - order_b);
            self.exit[root] = exit;
        }
    }

    /// Write every pixel's order and the number of its group; append the sizes of new groups.
    #[inline(always)]
    fn number_groups(
        &mut self,
        area: Area,
        order: &mut [i32],
        group: &mut [u32],
        sizes: &mut Vec<u32>,
    ) {
        let Area {
            y0,
            x0,
            rows,
            columns,
        } = area;
        let width = self.map.width;
        self.number.clear();
        self.number.resize(rows * columns, u32::MAX);
        for y in 0..rows {
            for x in 0..columns {
                let place = y * width + x0 + x;
                if self.map.mask[y0 * width + place] == 0 {
                    continue;
                }
                let (root, pixel_order) = self.groups.find(y * columns + x);
                if self.number[root] == u32::MAX {
                    self.number[root] = sizes.len() as u32;
                    sizes.push(self.groups.size(root));
                }
                order[place] = pixel_order;
                group[place] = self.number[root];
            }
        }
    }

    /// Collect the edges inside the tile, in order of place. Edges that leave it to the right or below
    /// are open; edges to the left and above are open in the neighbouring tile.
    fn collect(&mut self, area: Area, open: &mut Vec<u64>) {
        self.edges.clear();
        self.exit.clear();
        self.exit.resize(area.rows * area.columns, NO_EXIT);
        for y in area.y0..area.y0 + area.rows {
            for x in area.x0..area.x0 + area.columns {
                if self.map.mask[y * self.map.width + x] != 0 {
                    self.collect_pixel(area, y, x, open);
                }
            }
        }
    }

    /// Collect the edges of a valid pixel to the right and down; find its exit to all sides.
    #[inline(always)]
    fn collect_pixel(&mut self, area: Area, y: usize, x: usize, open: &mut Vec<u64>) {
        let (width, height) = (self.map.width, self.map.height);
        let (mask, rough) = (self.map.mask, self.map.rough);
        let i = y * width + x;
        let exit = &mut self.exit[(y - area.y0) * area.columns + x - area.x0];
        if x == area.x0 && x > 0 && mask[i - 1] != 0 {
            *exit = (*exit).min(key(rough, i - 1, i, 0));
        }
        if y == area.y0 && y > 0 && mask[i - width] != 0 {
            *exit = (*exit).min(key(rough, i - width, i, 1));
        }
        if x + 1 < width && mask[i + 1] != 0 {
            let edge = key(rough, i, i + 1, 0);
            if x + 1 < area.x0 + area.columns {
                self.edges.push(edge);
            } else {
                *exit = (*exit).min(edge);
                open.push(edge);
            }
        }
        if y + 1 < height && mask[i + width] != 0 {
            let edge = key(rough, i, i + width, 1);
            if y + 1 < area.y0 + area.rows {
                self.edges.push(edge);
            } else {
                *exit = (*exit).min(edge);
                open.push(edge);
            }
        }
    }
}

/// Sort edges that come in order of place by their upper half: three passes of a radix sort, which
/// keeps that order among equal ones.
fn sort(edges: &mut Vec<u64>, spare: &mut Vec<u64>) {
    let mut counts = [[0u32; DIGIT_VALUES]; 3];
    for edge in edges.iter() {
        let bits = (edge >> 32) as u32;
        for (k, count) in counts.iter_mut().enumerate() {
            count[(bits >> (DIGIT_BITS * k as u32)) as usize % DIGIT_VALUES] += 1;
        }
    }
    spare.clear();
    spare.resize(edges.len(), 0);
    for (k, count) in counts.iter_mut().enumerate() {
        let mut place = 0;
        for c in count.iter_mut() {
            place += std::mem::replace(c, place);
        }
        for edge in edges.iter() {
            let bin = ((edge >> 32) as u32 >> (DIGIT_BITS * k as u32)) as usize % DIGIT_VALUES;
            spare[count[bin] as usize] = *edge;
            count[bin] += 1;
        }
        std::mem::swap(edges, spare);
    }
}
