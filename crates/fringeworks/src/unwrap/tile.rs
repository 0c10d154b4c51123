//! The part of the spanning tree that one tile can tell, in memory that fits the nearest cache.

use super::groups::Groups;
use super::{key, turns};

pub const SIDE: usize = 64;
const DIGIT: u32 = 11;
const BINS: usize = 1 << DIGIT;
/// No edge leaves by here.
const NONE: u64 = u64::MAX;

/// What a band of tiles leaves to the whole map: its groups' sizes, and the edges still open.
#[derive(Default)]
pub struct Band {
    pub sizes: Vec<u32>,
    pub open: Vec<u64>,
}

/// Both pixels of an edge.
#[inline(always)]
pub fn ends(edge: u64, width: usize) -> (usize, usize) {
    let place = edge as u32;
    let a = (place >> 1) as usize;
    (a, if place & 1 == 0 { a + 1 } else { a + width })
}

pub struct Tile<'a> {
    phase: &'a [f32],
    mask: &'a [u8],
    rough: &'a [f32],
    height: usize,
    width: usize,
    groups: Groups,
    /// Smoothest edge that leaves the tile, per group.
    exit: Vec<u64>,
    edges: Vec<u64>,
    spare: Vec<u64>,
    number: Vec<u32>,
}

impl<'a> Tile<'a> {
    pub fn new(
        phase: &'a [f32],
        mask: &'a [u8],
        rough: &'a [f32],
        height: usize,
        width: usize,
    ) -> Self {
        Self {
            phase,
            mask,
            rough,
            height,
            width,
            groups: Groups::new(Vec::new()),
            exit: Vec::new(),
            edges: Vec::new(),
            spare: Vec::new(),
            number: Vec::new(),
        }
    }

    /// Join what can be joined in the tile whose upper left pixel is (`y0`, `x0`). `order` and
    /// `group` are the band's rows; edges to the right and below belong to the tile's `open` ones.
    pub fn join(
        &mut self,
        y0: usize,
        x0: usize,
        order: &mut [i32],
        group: &mut [u32],
        band: &mut Band,
    ) {
        let rows = SIDE.min(self.height - y0);
        let columns = SIDE.min(self.width - x0);
        self.collect(y0, x0, rows, columns, &mut band.open);
        sort(&mut self.edges, &mut self.spare);
        self.groups.reset(rows * columns);
        let width = self.width;
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
                band.open.push(edge);
                continue;
            }
            let step = -turns(self.phase[b] - self.phase[a]) as i32;
            let root = self.groups.unite(root_a, root_b, order_a + step - order_b);
            self.exit[root] = exit;
        }
        self.number.clear();
        self.number.resize(rows * columns, u32::MAX);
        for y in 0..rows {
            for x in 0..columns {
                let place = y * width + x0 + x;
                if self.mask[y0 * width + place] == 0 {
                    continue;
                }
                let (root, own) = self.groups.find(y * columns + x);
                if self.number[root] == u32::MAX {
                    self.number[root] = band.sizes.len() as u32;
                    band.sizes.push(self.groups.size(root));
                }
                order[place] = own;
                group[place] = self.number[root];
            }
        }
    }

    /// Edges inside the tile, in order of place; those that leave it to the right or below are open.
    fn collect(&mut self, y0: usize, x0: usize, rows: usize, columns: usize, open: &mut Vec<u64>) {
        let (width, height) = (self.width, self.height);
        let (mask, rough) = (self.mask, self.rough);
        self.edges.clear();
        self.exit.clear();
        self.exit.resize(rows * columns, NONE);
        for y in y0..y0 + rows {
            for x in x0..x0 + columns {
                let i = y * width + x;
                if mask[i] == 0 {
                    continue;
                }
                let exit = &mut self.exit[(y - y0) * columns + x - x0];
                if x == x0 && x > 0 && mask[i - 1] != 0 {
                    *exit = (*exit).min(key(rough, i - 1, i, 0));
                }
                if y == y0 && y > 0 && mask[i - width] != 0 {
                    *exit = (*exit).min(key(rough, i - width, i, 1));
                }
                if x + 1 < width && mask[i + 1] != 0 {
                    let edge = key(rough, i, i + 1, 0);
                    if x + 1 < x0 + columns {
                        self.edges.push(edge);
                    } else {
                        *exit = (*exit).min(edge);
                        open.push(edge);
                    }
                }
                if y + 1 < height && mask[i + width] != 0 {
                    let edge = key(rough, i, i + width, 1);
                    if y + 1 < y0 + rows {
                        self.edges.push(edge);
                    } else {
                        *exit = (*exit).min(edge);
                        open.push(edge);
                    }
                }
            }
        }
    }
}

/// Sort edges that come in order of place by their upper half: three passes of a radix sort, which
/// keeps that order among equals.
fn sort(edges: &mut Vec<u64>, spare: &mut Vec<u64>) {
    let mut counts = [[0u32; BINS]; 3];
    for edge in edges.iter() {
        let bits = (edge >> 32) as u32;
        for (k, count) in counts.iter_mut().enumerate() {
            count[(bits >> (DIGIT * k as u32)) as usize % BINS] += 1;
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
            let bin = ((edge >> 32) as u32 >> (DIGIT * k as u32)) as usize % BINS;
            spare[count[bin] as usize] = *edge;
            count[bin] += 1;
        }
        std::mem::swap(edges, spare);
    }
}
