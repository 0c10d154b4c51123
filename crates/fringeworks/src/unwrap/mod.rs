//! Spatial phase unwrapping: sorting by [`unwrap_reliability`], and the local [`average_phasor`] that guides it
//! through noise (theory §5). The number of [`count_residues`] determines whether a map needs the guide.

mod average;
mod groups;
mod spanning_tree;
mod tile;

pub use average::average_phasor;

use crate::{Error, Image, check_shape, check_value};
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

fn check(phase: Image<f32>, mask: Image<u8>) -> Result<(), Error> {
    check_shape("mask", mask.shape(), phase.shape())?;
    check_value(
        "size",
        !phase.is_empty() && phase.len() < u32::MAX as usize / 2,
        "1 to 2^31 pixels",
        phase.len(),
    )
}

/// Second differences of the wrapped phase, rad²: small where the phase is locally smooth. Pixels at
/// the border or beside masked ones get the largest f32.
fn second_differences(phase: Image<f32>, mask: Image<u8>) -> Vec<f32> {
    let (height, width) = phase.shape();
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
///
/// ```
/// use fringeworks::{Image, unwrap::count_residues};
///
/// // A phase that turns once around the middle.
/// let phase: Vec<f32> = (0..16).map(|i| ((i / 4) as f32 - 1.5).atan2((i % 4) as f32 - 1.5)).collect();
/// assert_eq!(count_residues(Image::new(&phase, 4, 4)?, Image::new(&[1; 16], 4, 4)?)?, 1);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn count_residues(phase: Image<f32>, mask: Image<u8>) -> Result<usize, Error> {
    check(phase, mask)?;
    let (height, width) = phase.shape();
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

/// Unwrap a phase in radians by sorting by reliability, following a non-continuous
/// path (Herráez, Burton, Lalor, Gdeisat, Applied Optics 41(35), 2002).
///
/// `mask` is 1 where the phase is valid; the phase is finite everywhere. `roughness` (non-negative,
/// small where the phase is reliable) replaces the second differences of the phase.
///
/// The path is the minimum spanning tree over all edges between neighbours. It is found tile by tile:
/// an edge that is the smoothest way out of a group of pixels belongs to the tree of the whole map.
/// Inside a tile that is known unless the group touches the tile's border by a smoother edge. The
/// edges that stay open, a few per cent, are sorted and joined over the whole map.
///
/// ```
/// use fringeworks::{Image, unwrap::unwrap_reliability};
/// use std::f32::consts::TAU;
///
/// let truth: Vec<f32> = (0..600).map(|i| 0.5 * (i % 30) as f32).collect();
/// let wrapped: Vec<f32> = truth.iter().map(|t| t - TAU * (t / TAU).round()).collect();
/// let found = unwrap_reliability(Image::new(&wrapped, 20, 30)?, Image::new(&[1; 600], 20, 30)?, None)?;
/// let offset = found.phase[0] - truth[0];
/// assert!(found.phase.iter().zip(&truth).all(|(p, t)| (p - t - offset).abs() < 1e-4));
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn unwrap_reliability(
    phase: Image<f32>,
    mask: Image<u8>,
    roughness: Option<Image<f32>>,
) -> Result<Unwrapped, Error> {
    check(phase, mask)?;
    let computed;
    let rough = match roughness {
        Some(given) => {
            check_shape("roughness", given.shape(), phase.shape())?;
            given.values()
        }
        None => {
            computed = second_differences(phase, mask);
            &computed
        }
    };
    // Orders are whole numbers of 32 bits, and those of neighbours are subtracted.
    let small = |(p, m): (&f32, &u8)| *m == 0 || p.is_nan() || p.abs() <= MAX_PHASE;
    check_value(
        "phase",
        phase.iter().zip(mask.values()).all(small),
        "at most 10^6 rad",
        "more",
    )?;
    let map = tile::Map {
        phase: phase.values(),
        mask: mask.values(),
        rough,
        height: phase.height(),
        width: phase.width(),
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
        let phase = Image::new(&wrapped, h, w).unwrap();
        let valid = Image::new(&mask, h, w).unwrap();
        let out = unwrap_reliability(phase, valid, None).unwrap();
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
        assert_eq!(count_residues(phase, valid).unwrap(), 0);
    }

    #[test]
    fn a_vortex_is_one_residue() {
        let (h, w) = (20, 20);
        let phase: Vec<f32> = (0..h * w)
            .map(|i| ((i / w) as f32 - 9.5).atan2((i % w) as f32 - 9.5))
            .collect();
        let phase = Image::new(&phase, h, w).unwrap();
        let valid = Image::new(&[1; 400], h, w).unwrap();
        assert_eq!(count_residues(phase, valid).unwrap(), 1);
    }
}
