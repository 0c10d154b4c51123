//! Spatial phase unwrapping: sorting by [`reliability`], and the local [`average`] that guides it
//! through noise (theory §5). The number of [`residues`] determines whether a map needs the guide.

mod average;
mod groups;
mod spanning_tree;
mod tile;

pub use average::average;

use crate::{Error, check_length, check_value};
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Turns per radian.
const PER_TURN: f32 = 1.0 / TAU;

/// 1.5 · 2²³: adding and subtracting it rounds an f32 to the nearest whole number, in two operations
/// that every processor has as vector operations.
const ROUNDER: f32 = 12_582_912.0;

/// The whole number of turns nearest to a phase in rad.
#[inline(always)]
fn turns(x: f32) -> f32 {
    (x * PER_TURN + ROUNDER) - ROUNDER
}

/// The phase modulo a turn, −π … π.
#[inline(always)]
fn wrap(x: f32) -> f32 {
    x - TAU * turns(x)
}

/// An unwrapped map.
pub struct Unwrapped {
    /// Phase, rad; NaN where masked.
    pub phase: Vec<f32>,
    /// 0 where masked, else the number of the pixel's region, 1 being the largest. Regions are not
    /// connected, so their orders are unrelated.
    pub region: Vec<u32>,
}

/// Largest phase, rad in size: single precision holds phases to 0.06 rad there.
const MAX_PHASE: f32 = 1e6;

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

/// Second differences of the wrapped phase, rad²: small where the phase is locally smooth. Pixels at
/// the border or beside masked ones get the largest f32.
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

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
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

/// Number of residues: loops of four valid pixels around which the wrapped phase differences do not
/// sum to zero (Goldstein et al., 1988). Without residues, every path gives the same result.
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

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
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

/// Unwrap a `height × width` phase in radians by sorting by reliability, following a non-continuous
/// path (Herráez, Burton, Lalor, Gdeisat, Applied Optics 41(35), 2002).
///
/// `mask` is 1 where the phase is valid; the phase is finite everywhere. `roughness` (non-negative,
/// small where the phase is reliable) replaces the second differences of the phase.
///
/// The path is the minimum spanning tree over all edges between neighbours. It is found tile by tile:
/// an edge that is the smoothest way out of a group of pixels belongs to the tree of the whole map.
/// Inside a tile that is known unless the group touches the tile's border by a smoother edge. The
/// edges that stay open, a few per cent, are sorted and joined over the whole map.
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
    // Orders are whole numbers of 32 bits, and those of neighbours are subtracted.
    let small = |(p, m): (&f32, &u8)| *m == 0 || p.is_nan() || p.abs() <= MAX_PHASE;
    check_value(
        "phase",
        phase.iter().zip(mask).all(small),
        "at most 10^6 rad",
        "more",
    )?;
    let map = tile::Map {
        phase,
        mask,
        rough,
        height,
        width,
    };
    Ok(spanning_tree::unwrap(&map))
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
