//! Phase unwrapping in space: [`reliability`] sorting, and the local [`average`] that guides it
//! through noise. Residues tell which of the two a map needs.

mod average;
mod groups;
mod tile;

pub use average::average;

use crate::{check_length, check_value, Error};
use groups::Groups;
use rayon::prelude::*;
use std::f32::consts::TAU;
use tile::Tile;

const PER_TURN: f32 = 1.0 / TAU;
/// Adding and taking away 1.5 · 2²³ rounds a float to the nearest whole number, in two operations
/// that every processor does on whole vectors.
const ROUNDER: f32 = 12_582_912.0;

#[inline(always)]
fn turns(x: f32) -> f32 {
    (x * PER_TURN + ROUNDER) - ROUNDER
}

#[inline(always)]
fn wrap(x: f32) -> f32 {
    x - TAU * turns(x)
}

/// Unwrapped phase, and a label per pixel: 0 where masked, 1, 2, … for regions that are not
/// connected and whose orders are therefore unrelated (1 is the largest).
pub struct Unwrapped {
    pub phase: Vec<f32>,
    pub region: Vec<u32>,
}

fn check(phase: &[f32], mask: &[u8], height: usize, width: usize) -> Result<(), Error> {
    check_length("phase", phase.len(), height * width)?;
    check_length("mask", mask.len(), height * width)?;
    check_value(
        "size",
        !phase.is_empty() && phase.len() < u32::MAX as usize / 2,
        "1 to 2^31 pixels",
        phase.len(),
    )
}

/// Second differences of the wrapped phase; small where the phase is locally smooth. Pixels at the
/// border or beside masked ones get the worst value.
fn roughness(phase: &[f32], mask: &[u8], height: usize, width: usize) -> Vec<f32> {
    let mut out = vec![f32::MAX; phase.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        if y > 0 && y + 1 < height && width >= 3 {
            let lines = |v: usize| (v - 1) * width..(v + 2) * width;
            rough_row(&phase[lines(y)], &mask[lines(y)], row);
        }
    });
    out
}

#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx512f+avx512vl"))]
fn rough_row(phase: &[f32], mask: &[u8], out: &mut [f32]) {
    let w = out.len();
    let (above, rest) = phase.split_at(w);
    let (here, below) = rest.split_at(w);
    let (m_above, m_rest) = mask.split_at(w);
    let (m_here, m_below) = m_rest.split_at(w);
    for x in 1..w - 1 {
        let c = here[x];
        let second = |a: f32, b: f32| {
            let d = wrap(a - c) - wrap(c - b);
            d * d
        };
        let sum = second(here[x - 1], here[x + 1])
            + second(above[x], below[x])
            + second(above[x - 1], below[x + 1])
            + second(above[x + 1], below[x - 1]);
        let whole = m_above[x - 1]
            & m_above[x]
            & m_above[x + 1]
            & m_here[x - 1]
            & m_here[x]
            & m_here[x + 1]
            & m_below[x - 1]
            & m_below[x]
            & m_below[x + 1];
        out[x] = if whole != 0 { sum } else { f32::MAX };
    }
}

/// Loops of four valid pixels around which the phase does not come back to itself. Where there are
/// none, every path gives the same result.
pub fn residues(phase: &[f32], mask: &[u8], height: usize, width: usize) -> Result<usize, Error> {
    check(phase, mask, height, width)?;
    Ok((0..height - 1)
        .into_par_iter()
        .map(|y| {
            let lines = y * width..(y + 2) * width;
            residues_row(&phase[lines.clone()], &mask[lines], width)
        })
        .sum())
}

#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx512f+avx512vl"))]
fn residues_row(phase: &[f32], mask: &[u8], width: usize) -> usize {
    let (p, q) = phase.split_at(width);
    let (m, n) = mask.split_at(width);
    let mut count = 0u32;
    for x in 0..width - 1 {
        let sum = turns(p[x + 1] - p[x])
            + turns(q[x + 1] - p[x + 1])
            + turns(q[x] - q[x + 1])
            + turns(p[x] - q[x]);
        let whole = m[x] & m[x + 1] & n[x] & n[x + 1];
        count += ((whole != 0) & (sum != 0.0)) as u32;
    }
    count as usize
}

/// Edges are ordered by the sum of both ends' roughness, then by place: smooth joins come first.
/// The bits of a non-negative float sort like the float itself. The place is the edge's upper or
/// left pixel, times two, plus one where it goes down.
#[inline(always)]
fn key(rough: &[f32], a: usize, b: usize, down: u64) -> u64 {
    let sum = (rough[a] + rough[b]).min(f32::MAX);
    (sum.to_bits() as u64) << 32 | (a as u64) << 1 | down
}

/// Unwrap a `height × width` phase in radians by sorting by reliability, following a
/// non-continuous path (Herráez, Burton, Lalor, Gdeisat, Applied Optics 41(35), 2002).
///
/// `mask` is 1 where the phase is valid, which is finite everywhere. `roughness` (non-negative, small where the phase is
/// to be trusted) takes the place of the second differences of the phase.
///
/// The path is the minimum spanning tree over all edges. It is found tile by tile: an edge that is
/// the smoothest way out of a group of pixels belongs to the tree of the whole map, and inside a
/// tile that is known unless the group touches the tile's border by a smoother edge. What stays
/// open, a few per cent, is sorted and joined over the whole map.
pub fn reliability(
    phase: &[f32],
    mask: &[u8],
    roughness: Option<&[f32]>,
    height: usize,
    width: usize,
) -> Result<Unwrapped, Error> {
    check(phase, mask, height, width)?;
    let second_differences;
    let rough = match roughness {
        Some(given) => {
            check_length("roughness", given.len(), height * width)?;
            given
        }
        None => {
            second_differences = self::roughness(phase, mask, height, width);
            &second_differences
        }
    };
    let mut order = vec![0i32; phase.len()];
    let mut group = vec![0u32; phase.len()];
    let mut bands: Vec<tile::Band> = order
        .par_chunks_mut(tile::SIDE * width)
        .zip(group.par_chunks_mut(tile::SIDE * width))
        .enumerate()
        .map(|(k, (order, group))| {
            let mut band = tile::Band::default();
            let mut tile = Tile::new(phase, mask, rough, height, width);
            for x0 in (0..width).step_by(tile::SIDE) {
                tile.join(k * tile::SIDE, x0, order, group, &mut band);
            }
            band
        })
        .collect();
    // Groups were numbered within their band.
    let mut sizes = Vec::new();
    let mut first = Vec::with_capacity(bands.len());
    let mut open = Vec::new();
    for band in &mut bands {
        first.push(sizes.len() as u32);
        sizes.append(&mut band.sizes);
        open.append(&mut band.open);
    }
    open.par_sort_unstable();
    let node = |i: usize| (first[i / (width * tile::SIDE)] + group[i]) as usize;
    let mut groups = Groups::new(sizes);
    for edge in open {
        let (a, b) = tile::ends(edge, width);
        let step = order[a] - order[b] - turns(phase[b] - phase[a]) as i32;
        groups.join(node(a), node(b), step);
    }
    let (offset, label) = groups.labelled();
    let mut unwrapped = vec![f32::NAN; phase.len()];
    let mut region = vec![0u32; phase.len()];
    unwrapped
        .par_chunks_mut(width)
        .zip(region.par_chunks_mut(width))
        .enumerate()
        .for_each(|(y, (out, region))| {
            for x in 0..width {
                let i = y * width + x;
                if mask[i] != 0 {
                    let n = node(i);
                    out[x] = phase[i] + (order[i] + offset[n]) as f32 * TAU;
                    region[x] = label[n];
                }
            }
        });
    Ok(Unwrapped {
        phase: unwrapped,
        region,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ramp_and_islands() {
        let (h, w) = (40, 160);
        let truth: Vec<f32> = (0..h * w)
            .map(|i| 0.7 * (i % w) as f32 + 0.4 * (i / w) as f32)
            .collect();
        let wrapped: Vec<f32> = truth.iter().map(|t| wrap(*t)).collect();
        let mask: Vec<u8> = (0..h * w).map(|i| (i % w != 20) as u8).collect();
        let out = reliability(&wrapped, &mask, None, h, w).unwrap();
        for side in [1, 2] {
            let offsets: Vec<f32> = (0..h * w)
                .filter(|i| out.region[*i] == side)
                .map(|i| out.phase[i] - truth[i])
                .collect();
            assert!(!offsets.is_empty());
            assert!(offsets.iter().all(|o| (o - offsets[0]).abs() < 1e-3));
        }
        assert!(out.phase[20].is_nan() && out.region[20] == 0);
        assert_eq!(out.region[59], 1);
        assert_eq!(residues(&wrapped, &mask, h, w).unwrap(), 0);
    }

    #[test]
    fn a_vortex_is_one_residue() {
        let (h, w) = (20, 20);
        let phase: Vec<f32> = (0..h * w)
            .map(|i| ((i / w) as f32 - 9.5).atan2((i % w) as f32 - 9.5))
            .collect();
        assert_eq!(residues(&phase, &vec![1; h * w], h, w).unwrap(), 1);
    }
}
