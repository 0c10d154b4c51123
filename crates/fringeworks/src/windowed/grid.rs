//! Solutions on the grid of nodes, and their way back to pixels.

use super::moments::{block_sums, NodeRow, Window};
use super::solve::{solve, Limits, Node, Prior};
use super::warp::Pair;
use rayon::prelude::*;

/// The solved windows of one scale.
pub struct Grid {
    pub nodes: Vec<Node>,
    pub rows: usize,
    pub columns: usize,
    block: usize,
}

/// What the nodes around a pixel say about it.
#[derive(Clone, Copy)]
pub struct Blend {
    pub delta: f32,
    pub sigma: f32,
    pub gain: f32,
}

/// Two neighbours and the share of the second.
fn between(position: f64, count: usize) -> (usize, usize, f32) {
    let clamped = position.clamp(0.0, (count - 1) as f64);
    let first = (clamped as usize).min(count - 1);
    let second = (first + 1).min(count - 1);
    (first, second, (clamped - first as f64) as f32)
}

impl Grid {
    /// One Gauss–Newton step: solve every window of this scale about the displacement `u`.
    pub fn solve(
        pair: &Pair,
        u: &[f32],
        window: &Window,
        coarser: Option<&Grid>,
        start: &Prior,
        limits: &Limits,
    ) -> Grid {
        let rows = window.nodes(pair.height);
        let columns = window.nodes(pair.width);
        let sums = block_sums(pair, u, window);
        let mut nodes = vec![
            Node {
                delta: 0.0,
                slope: [0.0; 2],
                gain: 0.0,
                sigma: f32::INFINITY,
                determined: false,
                prior: *start,
            };
            rows * columns
        ];
        nodes.par_chunks_mut(columns).enumerate().for_each_init(
            || NodeRow::new(columns),
            |gathered, (row, out)| {
                gathered.gather(&sums, row, rows, window);
                let y = window.centre(row);
                for (i, node) in out.iter_mut().enumerate() {
                    let prior = coarser.map_or(*start, |grid| grid.prior_at(window.centre(i), y));
                    *node = solve(gathered, i, window, &prior, limits);
                }
            },
        );
        Grid {
            nodes,
            rows,
            columns,
            block: window.block,
        }
    }

    fn position(&self, pixel: f64) -> f64 {
        (pixel + 0.5) / self.block as f64 - 0.5
    }

    fn prior_at(&self, x: f64, y: f64) -> Prior {
        let (c0, c1, tx) = between(self.position(x), self.columns);
        let (r0, r1, ty) = between(self.position(y), self.rows);
        let corners = [
            (r0 * self.columns + c0, (1.0 - tx) * (1.0 - ty)),
            (r0 * self.columns + c1, tx * (1.0 - ty)),
            (r1 * self.columns + c0, (1.0 - tx) * ty),
            (r1 * self.columns + c1, tx * ty),
        ];
        let mix = |field: fn(&Prior) -> f32| -> f32 {
            corners
                .iter()
                .map(|(i, w)| w * field(&self.nodes[*i].prior))
                .sum()
        };
        Prior {
            offset: mix(|p| p.offset),
            gain: mix(|p| p.gain),
            offset_variance: mix(|p| p.offset_variance),
            gain_variance: mix(|p| p.gain_variance),
            residual: mix(|p| p.residual),
        }
    }

    /// Blend the affine solutions of the four nodes around a pixel, leaving out those that do not
    /// determine the displacement; `None` where no node does.
    pub fn blend(&self, x: usize, y: usize) -> Option<Blend> {
        if self.block == 1 {
            let node = &self.nodes[y * self.columns + x];
            return node.determined.then_some(Blend {
                delta: node.delta,
                sigma: node.sigma,
                gain: node.gain,
            });
        }
        let (c0, c1, tx) = between(self.position(x as f64), self.columns);
        let (r0, r1, ty) = between(self.position(y as f64), self.rows);
        let mut sum = Blend {
            delta: 0.0,
            sigma: 0.0,
            gain: 0.0,
        };
        let mut total = 0.0f32;
        for (row, wy) in [(r0, 1.0 - ty), (r1, ty)] {
            for (column, wx) in [(c0, 1.0 - tx), (c1, tx)] {
                let node = &self.nodes[row * self.columns + column];
                let weight = wx * wy;
                if !node.determined || weight <= 0.0 {
                    continue;
                }
                let centre = |i: usize| (i as f32 + 0.5) * self.block as f32 - 0.5;
                let dx = x as f32 - centre(column);
                let dy = y as f32 - centre(row);
                sum.delta += weight * (node.delta + node.slope[0] * dx + node.slope[1] * dy);
                sum.sigma += weight * node.sigma;
                sum.gain += weight * node.gain;
                total += weight;
            }
        }
        (total > 0.0).then(|| Blend {
            delta: sum.delta / total,
            sigma: sum.sigma / total,
            gain: sum.gain / total,
        })
    }
}
