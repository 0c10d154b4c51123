//! Solutions on the grid of nodes, and their interpolation to pixels.

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

/// Solution at a pixel, interpolated between the nodes around it.
#[derive(Clone, Copy)]
pub struct Blend {
    /// Correction of the displacement, px.
    pub delta: f32,
    /// Standard deviation of the displacement, px.
    pub sigma: f32,
    pub offset: f32,
    pub modulation_ratio: f32,
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
        let mut nodes = vec![Node::undetermined(start); rows * columns];
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

    /// Prior of a finer window at a pixel position.
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
            modulation_ratio: mix(|p| p.modulation_ratio),
            offset_variance: mix(|p| p.offset_variance),
            ratio_variance: mix(|p| p.ratio_variance),
            residual: mix(|p| p.residual),
        }
    }

    /// Interpolate the affine solutions of the four nodes around a pixel, without those that do not
    /// determine the displacement; `None` where no node does.
    pub fn blend(&self, x: usize, y: usize) -> Option<Blend> {
        let block = self.lattice.block;
        if block == 1 {
            let node = self.node(y, x);
            return node.determined.then_some(Blend {
                delta: node.delta,
                sigma: node.sigma,
                offset: node.prior.offset,
                modulation_ratio: node.modulation_ratio,
            });
        }
        let mut sum = Blend {
            delta: 0.0,
            sigma: 0.0,
            offset: 0.0,
            modulation_ratio: 0.0,
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
            sum.modulation_ratio += weight * node.modulation_ratio;
            total += weight;
        }
        (total > 0.0).then(|| Blend {
            delta: sum.delta / total,
            sigma: sum.sigma / total,
            offset: sum.offset / total,
            modulation_ratio: sum.modulation_ratio / total,
        })
    }
}
