//! Solutions on the grid of nodes, and their way back to pixels.

use super::lattice::Lattice;
use super::moments::{block_sums, NodeRow, Window};
use super::solve::{solve, Limits, Node, Prior};
use super::warp::Pair;
use rayon::prelude::*;

/// The solved windows of one scale.
pub struct Grid {
    pub lattice: Lattice,
    nodes: Vec<Node>,
}

/// What the nodes around a pixel say about it.
#[derive(Clone, Copy)]
pub struct Blend {
    pub delta: f32,
    pub sigma: f32,
    pub offset: f32,
    pub gain: f32,
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
        let lattice = window.lattice(pair.height, pair.width);
        let Lattice { rows, columns, .. } = lattice;
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
        Grid { lattice, nodes }
    }

    fn node(&self, row: usize, column: usize) -> &Node {
        &self.nodes[row * self.lattice.columns + column]
    }

    fn prior_at(&self, x: f64, y: f64) -> Prior {
        let corners = self.lattice.corners(x, y);
        let mix = |field: fn(&Prior) -> f32| -> f32 {
            corners
                .iter()
                .map(|(r, c, w)| w * field(&self.node(*r, *c).prior))
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
        let block = self.lattice.block;
        if block == 1 {
            let node = self.node(y, x);
            return node.determined.then_some(Blend {
                delta: node.delta,
                sigma: node.sigma,
                offset: node.prior.offset,
                gain: node.gain,
            });
        }
        let mut sum = Blend {
            delta: 0.0,
            sigma: 0.0,
            offset: 0.0,
            gain: 0.0,
        };
        let mut total = 0.0f32;
        for (row, column, weight) in self.lattice.corners(x as f64, y as f64) {
            let node = self.node(row, column);
            if !node.determined || weight <= 0.0 {
                continue;
            }
            let centre = |i: usize| (i as f32 + 0.5) * block as f32 - 0.5;
            let dx = x as f32 - centre(column);
            let dy = y as f32 - centre(row);
            sum.delta += weight * (node.delta + node.slope[0] * dx + node.slope[1] * dy);
            sum.sigma += weight * node.sigma;
            sum.offset += weight * node.prior.offset;
            sum.gain += weight * node.gain;
            total += weight;
        }
        (total > 0.0).then(|| Blend {
            delta: sum.delta / total,
            sigma: sum.sigma / total,
            offset: sum.offset / total,
            gain: sum.gain / total,
        })
    }
}
