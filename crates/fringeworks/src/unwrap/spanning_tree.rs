//! The minimum spanning tree of a map: tiles in parallel, then the edges that they left open.

use super::groups::Groups;
use super::tile::{self, Band, Map, Tile};
use super::{Unwrapped, turns};
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Pixels of a map joined tile by tile.
struct Tiles {
    /// Fringe order of every pixel relative to its group.
    order: Vec<i32>,
    /// Group of every pixel, numbered within its band.
    group: Vec<u32>,
    bands: Vec<Band>,
}

/// The groups of the whole map.
struct Regions {
    /// First group of every band.
    first: Vec<u32>,
    /// Fringe order of every group relative to its region.
    offset: Vec<i32>,
    /// Number of the region of every group.
    label: Vec<u32>,
}

/// Unwrap a map along its minimum spanning tree.
pub fn unwrap(map: &Map) -> Unwrapped {
    let mut tiles = join_tiles(map);
    let regions = join_regions(map, &mut tiles);
    add_orders(map, &tiles, &regions)
}

/// Join the pixels of every tile; a band of tiles per task.
fn join_tiles(map: &Map) -> Tiles {
    let width = map.width;
    let mut order = vec![0i32; map.phase.len()];
    let mut group = vec![0u32; map.phase.len()];
    let bands = order
        .par_chunks_mut(tile::SIDE_PIXELS * width)
        .zip(group.par_chunks_mut(tile::SIDE_PIXELS * width))
        .enumerate()
        .map(|(k, (order, group))| {
            let mut band = Band::default();
            let mut tile = Tile::new(map);
            for x0 in (0..width).step_by(tile::SIDE_PIXELS) {
                tile.join(k * tile::SIDE_PIXELS, x0, order, group, &mut band);
            }
            band
        })
        .collect();
    Tiles {
        order,
        group,
        bands,
    }
}

/// Index among all groups of the group that pixel `i` belongs to.
#[inline(always)]
fn group_of(i: usize, first: &[u32], group: &[u32], width: usize) -> usize {
    (first[i / (width * tile::SIDE_PIXELS)] + group[i]) as usize
}

/// Join the groups of all tiles along the open edges, smoothest first.
fn join_regions(map: &Map, tiles: &mut Tiles) -> Regions {
    let mut sizes = Vec::new();
    let mut first = Vec::with_capacity(tiles.bands.len());
    let mut open = Vec::new();
    for band in &mut tiles.bands {
        first.push(sizes.len() as u32);
        sizes.append(&mut band.sizes);
        open.append(&mut band.open);
    }
    open.par_sort_unstable();
    let (phase, order) = (map.phase, &tiles.order);
    let mut groups = Groups::new(sizes);
    for edge in open {
        let (a, b) = tile::ends(edge, map.width);
        let step = order[a] - order[b] - turns(phase[b] - phase[a]) as i32;
        let of = |i: usize| group_of(i, &first, &tiles.group, map.width);
        groups.join(of(a), of(b), step);
    }
    let (offset, label) = groups.labelled();
    Regions {
        first,
        offset,
        label,
    }
}

/// Add the fringe orders to the wrapped phase.
fn add_orders(map: &Map, tiles: &Tiles, regions: &Regions) -> Unwrapped {
    let width = map.width;
    let mut unwrapped = vec![f32::NAN; map.phase.len()];
    let mut region = vec![0u32; map.phase.len()];
    unwrapped
        .par_chunks_mut(width)
        .zip(region.par_chunks_mut(width))
        .enumerate()
        .for_each(|(y, (out, region))| {
            for x in 0..width {
                let i = y * width + x;
                if map.mask[i] != 0 {
                    let group = group_of(i, &regions.first, &tiles.group, width);
                    let order = tiles.order[i] + regions.offset[group];
                    out[x] = map.phase[i] + order as f32 * TAU;
                    region[x] = regions.label[group];
                }
            }
        });
    Unwrapped {
        phase: unwrapped,
        region,
    }
}
