//! Phase unwrapping by sorting by reliability, following a non-continuous path
//! (Herráez, Burton, Lalor, Gdeisat, Applied Optics 41(35), 2002).

use crate::{check_length, check_value, Error};
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};

#[inline(always)]
fn wrap(x: f32) -> f32 {
    x - TAU * (x * (1.0 / TAU)).round()
}

/// Second differences of the wrapped phase; small where the phase is locally smooth. Pixels at the
/// border or beside masked ones get the worst value.
fn roughness(phase: &[f32], mask: &[u8], height: usize, width: usize) -> Vec<f32> {
    let mut out = vec![f32::MAX; phase.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        if y == 0 || y + 1 >= height {
            return;
        }
        for x in 1..width.saturating_sub(1) {
            let i = y * width + x;
            let around = [
                (i - 1, i + 1),
                (i - width, i + width),
                (i - width - 1, i + width + 1),
                (i - width + 1, i + width - 1),
            ];
            if mask[i] == 0 || around.iter().any(|(a, b)| mask[*a] == 0 || mask[*b] == 0) {
                continue;
            }
            row[x] = around
                .iter()
                .map(|(a, b)| (wrap(phase[*a] - phase[i]) - wrap(phase[i] - phase[*b])).powi(2))
                .sum();
        }
    });
    out
}

/// Disjoint sets whose members know their fringe order relative to the root.
struct Groups {
    parent: Vec<u32>,
    order: Vec<i32>,
    size: Vec<u32>,
}

impl Groups {
    /// Root of `i` and the order of `i` relative to it; flattens the path.
    fn find(&mut self, i: usize) -> (usize, i32) {
        let (mut root, mut total) = (i, 0);
        while self.parent[root] as usize != root {
            total += self.order[root];
            root = self.parent[root] as usize;
        }
        let (mut node, mut rest) = (i, total);
        while self.parent[node] as usize != root && node != root {
            let next = self.parent[node] as usize;
            let own = self.order[node];
            self.parent[node] = root as u32;
            self.order[node] = rest;
            rest -= own;
            node = next;
        }
        (root, total)
    }

    /// Join the groups of `a` and `b` so that order(b) − order(a) = `step`.
    fn join(&mut self, a: usize, b: usize, step: i32) {
        let (root_a, order_a) = self.find(a);
        let (root_b, order_b) = self.find(b);
        if root_a == root_b {
            return;
        }
        let shift = order_a + step - order_b;
        if self.size[root_a] >= self.size[root_b] {
            self.parent[root_b] = root_a as u32;
            self.order[root_b] = shift;
            self.size[root_a] += self.size[root_b];
        } else {
            self.parent[root_a] = root_b as u32;
            self.order[root_a] = -shift;
            self.size[root_b] += self.size[root_a];
        }
    }
}

/// Unwrapped phase, and a label per pixel: 0 where masked, 1, 2, … for regions that are not
/// connected and whose orders are therefore unrelated (1 is the largest).
pub struct Unwrapped {
    pub phase: Vec<f32>,
    pub region: Vec<u32>,
}

/// Unwrap a `height × width` phase in radians. `mask` is 1 where the phase is valid.
pub fn reliability(
    phase: &[f32],
    mask: &[u8],
    height: usize,
    width: usize,
) -> Result<Unwrapped, Error> {
    check_length("phase", phase.len(), height * width)?;
    check_length("mask", mask.len(), height * width)?;
    check_value(
        "size",
        phase.len() < u32::MAX as usize / 2,
        "fewer than 2^31 pixels",
        phase.len(),
    )?;
    let rough = roughness(phase, mask, height, width);
    // Edges carry the sum of both ends' roughness; sorted by it, smooth joins come first. The
    // bits of a non-negative float sort like the float itself.
    let mut edges: Vec<(u32, u32)> = Vec::with_capacity(2 * phase.len());
    for y in 0..height {
        for x in 0..width {
            let i = y * width + x;
            if mask[i] == 0 {
                continue;
            }
            let mut push = |j: usize, down: u32| {
                if mask[j] != 0 {
                    let sum = (rough[i] + rough[j]).min(f32::MAX);
                    edges.push((sum.to_bits(), (i as u32) << 1 | down));
                }
            };
            if x + 1 < width {
                push(i + 1, 0);
            }
            if y + 1 < height {
                push(i + width, 1);
            }
        }
    }
    edges.par_sort_unstable();
    let mut groups = Groups {
        parent: (0..phase.len() as u32).collect(),
        order: vec![0; phase.len()],
        size: vec![1; phase.len()],
    };
    for (_, edge) in edges {
        let a = (edge >> 1) as usize;
        let b = if edge & 1 == 0 { a + 1 } else { a + width };
        let jump = phase[b] - phase[a];
        let step = -(jump * (1.0 / TAU)).round() as i32;
        debug_assert!((jump + step as f32 * TAU).abs() <= PI * 1.001);
        groups.join(a, b, step);
    }
    Ok(collect(phase, mask, &mut groups))
}

fn collect(phase: &[f32], mask: &[u8], groups: &mut Groups) -> Unwrapped {
    let mut roots: Vec<(u32, usize)> = (0..phase.len())
        .filter(|i| mask[*i] != 0 && groups.parent[*i] as usize == *i)
        .map(|i| (groups.size[i], i))
        .collect();
    roots.sort_by_key(|(size, i)| (std::cmp::Reverse(*size), *i));
    let mut label = vec![0u32; phase.len()];
    for (k, (_, root)) in roots.iter().enumerate() {
        label[*root] = k as u32 + 1;
    }
    let mut unwrapped = vec![f32::NAN; phase.len()];
    let mut region = vec![0u32; phase.len()];
    for i in 0..phase.len() {
        if mask[i] != 0 {
            let (root, order) = groups.find(i);
            unwrapped[i] = phase[i] + order as f32 * TAU;
            region[i] = label[root];
        }
    }
    Unwrapped {
        phase: unwrapped,
        region,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ramp_and_islands() {
        let (h, w) = (40, 60);
        let truth: Vec<f32> = (0..h * w)
            .map(|i| 0.7 * (i % w) as f32 + 0.4 * (i / w) as f32)
            .collect();
        let wrapped: Vec<f32> = truth.iter().map(|t| wrap(*t)).collect();
        let mask: Vec<u8> = (0..h * w).map(|i| (i % w != 20) as u8).collect();
        let out = reliability(&wrapped, &mask, h, w).unwrap();
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
    }
}
