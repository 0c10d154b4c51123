//! Solutions on the grid of nodes, and their interpolation to pixels.

use super::LOOSE;
use super::lattice::Lattice;
use super::moments::{BandSums, NodeRow, Window, block_sums};
use super::sight::{Cells, Sight};
use super::solve::{Limits, Node, Prior, solve};
use super::walls::Walls;
use super::warp::Pair;
use rayon::prelude::*;

/// Distances, in blocks, within which nodes are searched near a wall: the nearest that has any.
const REACHES: [usize; 3] = [1, 2, 4];

/// Sums of cells that windows near a wall may see; 0 in the other rows of cells.
fn sums_near_walls(pair: &Pair, u: &[f32], walls: &Walls, window: &Window) -> Vec<f64> {
    let small = Cells::lattice(window, pair.height(), pair.width());
    // A window near a wall reaches as far again.
    let reach = 2 * Walls::reach(window) + window.block;
    block_sums(pair, u, small, 0..small.rows, |row| {
        walls.row_within(row * small.block, reach)
    })
}

/// What pixels need of a solved window.
struct Kept {
    delta: f32,
    slope: [f32; 2],
    /// Infinite where the window does not determine the displacement.
    sigma: f32,
    offset: f32,
    modulation_ratio: f32,
}

impl Kept {
    fn of(node: &Node) -> Self {
        Self {
            delta: node.delta,
            slope: node.slope,
            sigma: if node.determined {
                node.sigma
            } else {
                f32::INFINITY
            },
            offset: node.prior.offset,
            modulation_ratio: node.modulation_ratio,
        }
    }
}

/// The solved windows of one scale. Pixels are interpolated row by row whenever they are needed: maps of
/// all scales would take more memory than everything else.
pub struct Grid<'a> {
    pub lattice: Lattice,
    nodes: Vec<Kept>,
    /// Priors of the next finer windows, until these are solved.
    priors: Vec<Prior>,
    walls: Option<&'a Walls<'a>>,
}

/// What the windows of a scale say of the pixels of a row; where none determines the displacement, σ is
/// infinite, and offset and modulation ratio are NaN.
pub struct Blended {
    /// Correction of the displacement, px; 0 where none is determined.
    pub delta: Vec<f32>,
    /// Standard deviation of the displacement, px.
    pub sigma: Vec<f32>,
    pub offset: Vec<f32>,
    pub modulation_ratio: Vec<f32>,
}

impl Blended {
    /// Arrays for a row of `width` pixels.
    pub fn new(width: usize) -> Self {
        let row = || vec![0.0f32; width];
        Self {
            delta: row(),
            sigma: row(),
            offset: row(),
            modulation_ratio: row(),
        }
    }

    fn set(&mut self, x: usize, mean: &Mean) {
        if mean.total > 0.0 {
            let share = mean.total.recip();
            self.delta[x] = mean.delta * share;
            self.sigma[x] = mean.sigma * share;
            self.offset[x] = mean.offset * share;
            self.modulation_ratio[x] = mean.modulation_ratio * share;
        } else {
            self.delta[x] = 0.0;
            self.sigma[x] = f32::INFINITY;
            self.offset[x] = f32::NAN;
            self.modulation_ratio[x] = f32::NAN;
        }
    }
}

impl<'a> Grid<'a> {
    /// One Gauss–Newton step: solve every window of this scale about the displacement `u`. No window
    /// sees through `walls`. With `has_finer`, the priors of finer windows are kept.
    pub fn solve(
        pair: &Pair,
        walls: Option<&'a Walls<'a>>,
        u: &[f32],
        window: &Window,
        coarser: Option<&Grid>,
        has_finer: bool,
        limits: &Limits,
    ) -> Self {
        let lattice = window.lattice(pair.height(), pair.width());
        let Lattice { rows, columns, .. } = lattice;
        let near = walls.map(|walls| (walls, sums_near_walls(pair, u, walls, window)));
        let small = Cells::lattice(window, pair.height(), pair.width());
        let cells = (near.as_ref()).map(|(walls, sums)| (*walls, Cells::new(small, sums, walls)));
        let mut grid = Self {
            lattice,
            nodes: Vec::with_capacity(rows * columns),
            priors: Vec::new(),
            walls,
        };
        let mut sums = BandSums::new(lattice);
        let height = sums.height().min(rows);
        let mut solved = vec![Node::undetermined(&LOOSE); height * columns];
        for (band, first) in (0..rows).step_by(height).enumerate() {
            sums.move_to(pair, u, first);
            let solved = &mut solved[..(rows - first).min(height) * columns];
            solved.par_chunks_mut(columns).enumerate().for_each_init(
                || {
                    let sight =
                        (cells.as_ref()).map(|(walls, cells)| Sight::new(cells, walls, window));
                    (NodeRow::new(columns), sight)
                },
                |(gathered, sight), (row, out)| {
                    let row = band * height + row;
                    gathered.gather(&sums, row, window);
                    if let Some(sight) = sight {
                        sight.replace(gathered, row, lattice);
                    }
                    let y = lattice.centre(row);
                    for (i, node) in out.iter_mut().enumerate() {
                        let prior =
                            coarser.map_or(LOOSE, |grid| grid.prior_at(lattice.centre(i), y));
                        *node = solve(gathered, i, window, &prior, limits);
                    }
                },
            );
            grid.keep(solved, has_finer);
        }
        grid
    }

    /// Append what is needed of solved windows.
    fn keep(&mut self, solved: &[Node], has_finer: bool) {
        self.nodes.extend(solved.iter().map(Kept::of));
        if has_finer {
            self.priors.extend(solved.iter().map(|node| node.prior));
        }
    }

    /// Free what only the next finer windows need.
    pub fn without_priors(&mut self) {
        self.priors = Vec::new();
    }

    fn node(&self, row: usize, column: usize) -> &Kept {
        &self.nodes[row * self.lattice.columns + column]
    }

    /// Prior of a finer window at a pixel position.
    fn prior_at(&self, x: f64, y: f64) -> Prior {
        let corners = self.lattice.corners(x, y);
        let mix = |field: fn(&Prior) -> f32| -> f32 {
            corners
                .iter()
                .map(|(r, c, w)| w * field(&self.priors[r * self.lattice.columns + c]))
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

    /// Interpolate the affine solutions of the four nodes around every pixel of a row, without those
    /// that do not determine the displacement. `means` is room to work in.
    pub fn blend_row(&self, y: usize, means: &mut Vec<Mean>, out: &mut Blended) {
        let Lattice { columns, block, .. } = self.lattice;
        means.clear();
        means.extend((0..columns).map(|column| self.mean_of_column(y, column)));
        if block == 1 {
            for (x, mean) in means.iter().enumerate() {
                out.set(x, mean);
            }
            return;
        }
        for (first, second, pixels) in self.lattice.stretches(out.delta.len()) {
            let (before, after) = (&means[first], &means[second]);
            for x in pixels {
                let dx = self.lattice.offset((x, 0), (0, first)).0;
                let share = (dx / block as f32).clamp(0.0, 1.0);
                let share = if first == second { 0.0 } else { share };
                out.set(x, &before.mixed(after, dx, share, block as f32));
            }
        }
        let Some(walls) = self.walls else { return };
        for x in 0..out.delta.len() {
            if walls.within(x, y, 2 * block) {
                out.set(x, &self.mean_seen(walls, x, y));
            }
        }
    }

    /// Mean of the nodes above and below row `y` in a column of nodes.
    fn mean_of_column(&self, y: usize, column: usize) -> Mean {
        let (above, below, share) = self.lattice.rows_around(y as f64);
        let mut mean = Mean::default();
        for (row, weight) in [(above, 1.0 - share), (below, share)] {
            let node = self.node(row, column);
            if node.sigma.is_finite() && weight > 0.0 {
                let dy = self.lattice.offset((0, y), (row, column)).1;
                mean.add(node, (0.0, dy), weight, node.sigma);
            }
        }
        mean
    }

    /// The same near a wall: from the nearest nodes that the pixel sees.
    fn mean_seen(&self, walls: &Walls, x: usize, y: usize) -> Mean {
        if walls.is_wall(x, y) {
            return Mean::default();
        }
        REACHES
            .into_iter()
            .map(|reach| self.mean_within(walls, (x, y), reach))
            .find(|mean| mean.total > 0.0)
            .unwrap_or_default()
    }

    /// Mean of the nodes within a number of blocks that a pixel sees; the more certain count more.
    fn mean_within(&self, walls: &Walls, (x, y): (usize, usize), reach: usize) -> Mean {
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
            if !node.sigma.is_finite() || near <= 0.0 || hidden() {
                continue;
            }
            // A slope is about as uncertain as the displacement over the window's width.
            let away = (dx * dx + dy * dy) / (2.0 * block as f32).powi(2);
            let sigma = node.sigma * (1.0 + 0.5 * away).sqrt();
            mean.add(node, (dx, dy), near / (node.sigma * node.sigma), sigma);
        }
        mean
    }
}

/// Sums of what nodes say of a pixel, times their weights.
#[derive(Clone, Copy, Default)]
pub struct Mean {
    delta: f32,
    /// Slope of delta along x.
    slope: f32,
    sigma: f32,
    offset: f32,
    modulation_ratio: f32,
    total: f32,
}

impl Mean {
    /// Add a node that is (dx, dy) px before the pixel.
    fn add(&mut self, node: &Kept, (dx, dy): (f32, f32), weight: f32, sigma: f32) {
        self.delta += weight * (node.delta + node.slope[0] * dx + node.slope[1] * dy);
        self.slope += weight * node.slope[0];
        self.sigma += weight * sigma;
        self.offset += weight * node.offset;
        self.modulation_ratio += weight * node.modulation_ratio;
        self.total += weight;
    }

    /// This mean, `dx` px on, with a share of the one that is `apart` px further.
    #[inline(always)]
    fn mixed(&self, after: &Self, dx: f32, share: f32, apart: f32) -> Self {
        let mix = |a: f32, b: f32| (1.0 - share) * a + share * b;
        Self {
            delta: mix(
                self.delta + dx * self.slope,
                after.delta + (dx - apart) * after.slope,
            ),
            slope: mix(self.slope, after.slope),
            sigma: mix(self.sigma, after.sigma),
            offset: mix(self.offset, after.offset),
            modulation_ratio: mix(self.modulation_ratio, after.modulation_ratio),
            total: mix(self.total, after.total),
        }
    }
}
