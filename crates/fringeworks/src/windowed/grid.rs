//! Solutions on the grid of nodes, and their interpolation to pixels.

use super::lattice::Lattice;
use super::moments::{block_sums, NodeRow, Window};
use super::sight::Sight;
use super::solve::{solve, Limits, Node, Prior};
use super::walls::Walls;
use super::warp::{warped, Pair};
use rayon::prelude::*;

/// Distances, in blocks, within which nodes are searched near a wall: the nearest that has any.
const REACHES: [usize; 3] = [1, 2, 4];

/// The solved windows of one scale.
pub struct Grid<'a> {
    pub lattice: Lattice,
    nodes: Vec<Node>,
    walls: Option<&'a Walls<'a>>,
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

impl<'a> Grid<'a> {
    /// One Gauss–Newton step: solve every window of this scale about the displacement `u`. No window
    /// sees through `walls`.
    pub fn solve(
        pair: &Pair,
        walls: Option<&'a Walls<'a>>,
        u: &[f32],
        window: &Window,
        coarser: Option<&Grid>,
        start: &Prior,
        limits: &Limits,
    ) -> Self {
        let lattice = window.lattice(pair.height, pair.width);
        let Lattice { rows, columns, .. } = lattice;
        let sums = block_sums(pair, u, window);
        let near = walls.map(|walls| (walls, warped(pair, u).expect("the pair was checked")));
        let mut nodes = vec![Node::undetermined(start); rows * columns];
        nodes.par_chunks_mut(columns).enumerate().for_each_init(
            || {
                let sight = near
                    .as_ref()
                    .map(|(walls, warped)| Sight::new(pair, walls, warped, window));
                (NodeRow::new(columns), sight)
            },
            |(gathered, sight), (row, out)| {
                gathered.gather(&sums, row, rows, window);
                if let Some(sight) = sight {
                    sight.replace(gathered, row, window);
                }
                let y = window.centre(row);
                for (i, node) in out.iter_mut().enumerate() {
                    let prior = coarser.map_or(*start, |grid| grid.prior_at(window.centre(i), y));
                    *node = solve(gathered, i, window, &prior, limits);
                }
            },
        );
        Self {
            lattice,
            nodes,
            walls,
        }
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
        if let Some(walls) = self.walls {
            if walls.within(x, y, 2 * block) {
                return self.blend_seen(walls, x, y);
            }
        }
        let mut mean = Mean::default();
        for (row, column, weight) in self.lattice.corners(x as f64, y as f64) {
            let node = self.node(row, column);
            if node.determined && weight > 0.0 {
                let (dx, dy) = self.lattice.offset((x, y), (row, column));
                mean.add(node, (dx, dy), weight, node.sigma);
            }
        }
        mean.value()
    }

    /// The same near a wall: from the nearest nodes that the pixel sees.
    fn blend_seen(&self, walls: &Walls, x: usize, y: usize) -> Option<Blend> {
        if walls.is_wall(x, y) {
            return None;
        }
        REACHES
            .into_iter()
            .find_map(|reach| self.blend_within(walls, (x, y), reach))
    }

    /// Mean of the nodes within a number of blocks that a pixel sees; the more certain count more.
    fn blend_within(&self, walls: &Walls, (x, y): (usize, usize), reach: usize) -> Option<Blend> {
        let Lattice {
            rows,
            columns,
            block,
        } = self.lattice;
        let scale = (reach as f32 + 0.5) * block as f32;
        let around = |i: usize, count: usize| {
            (i / block).saturating_sub(reach)..=(i / block + reach).min(count - 1)
        };
        let mut mean = Mean::default();
        for (r, c) in around(y, rows).flat_map(|r| around(x, columns).map(move |c| (r, c))) {
            let node = self.node(r, c);
            let (dx, dy) = self.lattice.offset((x, y), (r, c));
            let near = (1.0 - dx.abs() / scale).max(0.0) * (1.0 - dy.abs() / scale).max(0.0);
            let hidden = || !walls.open_between((x, y), walls.pixel_of(block, r, c));
            if !node.determined || near <= 0.0 || hidden() {
                continue;
            }
            // A slope is about as uncertain as the displacement over the window's width.
            let away = (dx * dx + dy * dy) / (2.0 * block as f32).powi(2);
            let sigma = node.sigma * (1.0 + 0.5 * away).sqrt();
            mean.add(node, (dx, dy), near / (node.sigma * node.sigma), sigma);
        }
        mean.value()
    }
}

/// Weighted mean of what nodes say of a pixel.
#[derive(Default)]
struct Mean {
    delta: f32,
    sigma: f32,
    offset: f32,
    modulation_ratio: f32,
    total: f32,
}

impl Mean {
    /// Add a node that is (dx, dy) px before the pixel.
    fn add(&mut self, node: &Node, (dx, dy): (f32, f32), weight: f32, sigma: f32) {
        self.delta += weight * (node.delta + node.slope[0] * dx + node.slope[1] * dy);
        self.sigma += weight * sigma;
        self.offset += weight * node.prior.offset;
        self.modulation_ratio += weight * node.modulation_ratio;
        self.total += weight;
    }

    fn value(&self) -> Option<Blend> {
        let total = self.total;
        (total > 0.0).then(|| Blend {
            delta: self.delta / total,
            sigma: self.sigma / total,
            offset: self.offset / total,
            modulation_ratio: self.modulation_ratio / total,
        })
    }
}
