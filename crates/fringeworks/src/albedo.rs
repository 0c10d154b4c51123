//! Albedo of an object with sharp edges, together with a smooth correction of its displacement (theory
//! §4, "Paint").
//!
//! Minimises ½ Σ (d − β f + δ q)² + Σ λ H(|∇β|) + ½ μ Σ |∇δ|² over the albedo β and the correction δ.
//! H is Huber's function: quadratic up to a slope, then linear, so that edges of paint stay sharp.
//! Without δ, β would take over the error of the displacement. Chambolle and Pock's primal-dual method
//! (J. Math. Imaging Vis. 40, 2011) from coarse to fine.

use crate::{Error, Image, MIN_WIDTH, check_shape, check_value};
use multiversion::multiversion;
use rayon::prelude::*;

/// Primal and dual step. The method converges for a product with the squared norm of the gradient, 8,
/// of up to 1.
const STEP: f32 = 0.35;

/// Least weight of an edge; 0 would divide by 0.
const MIN_WEIGHT: f32 = 1e-9;

/// A model of the object frame, one value per pixel, row after row.
pub struct Model<'a> {
    /// f: what an object of albedo 1 would show; 0 without data.
    pub value: Image<'a, f32>,
    /// q: minus its derivative by the correction; 0 without data.
    pub slope: Image<'a, f32>,
    /// d: what the object shows; 0 without data.
    pub object: Image<'a, f32>,
    /// λ: price of an edge of β at a pixel.
    pub edge_weight: Image<'a, f32>,
    /// 1 where the correction may jump, as at a cliff.
    pub cliff: Image<'a, u8>,
}

/// How smooth albedo and correction are.
#[derive(Clone, Debug)]
pub struct Options {
    /// μ: stiffness of the correction.
    pub stiffness: f32,
    /// Slope of β per px up to which it costs its square.
    pub huber: f32,
    /// Steps at every level, from the coarsest to the frame itself.
    pub iterations: Vec<usize>,
}

/// Normal equations of all pixels of a level.
struct Level {
    height: usize,
    width: usize,
    /// f², −f q, q², f d and −q d.
    products: [Vec<f32>; 5],
    edge_weight: Vec<f32>,
    cliff: Vec<u8>,
}

/// Solution of a level: β and δ, their dual variables (x and y of both).
struct State {
    primal: [Vec<f32>; 2],
    dual: [Vec<f32>; 4],
}

/// A map at half the size; `reduce` joins four pixels. Odd sides are continued by their last pixel.
fn halved<T: Copy + Send + Sync>(
    values: &[T],
    (height, width): (usize, usize),
    reduce: impl Fn([T; 4]) -> T + Sync,
) -> Vec<T> {
    let (rows, columns) = (height.div_ceil(2), width.div_ceil(2));
    (0..rows * columns)
        .into_par_iter()
        .with_min_len(columns)
        .map(|i| {
            let (y, x) = (2 * (i / columns), 2 * (i % columns));
            let (below, right) = ((y + 1).min(height - 1), (x + 1).min(width - 1));
            let at = |y: usize, x: usize| values[y * width + x];
            reduce([at(y, x), at(y, right), at(below, x), at(below, right)])
        })
        .collect()
}

impl Level {
    fn finest(model: &Model) -> Self {
        let product = |a: Image<f32>, b: Image<f32>, sign: f32| -> Vec<f32> {
            a.iter()
                .zip(b.values())
                .map(|(a, b)| sign * a * b)
                .collect()
        };
        Self {
            height: model.object.height(),
            width: model.object.width(),
            products: [
                product(model.value, model.value, 1.0),
                product(model.value, model.slope, -1.0),
                product(model.slope, model.slope, 1.0),
                product(model.value, model.object, 1.0),
                product(model.slope, model.object, -1.0),
            ],
            edge_weight: model
                .edge_weight
                .iter()
                .map(|w| w.max(MIN_WEIGHT))
                .collect(),
            cliff: model.cliff.to_vec(),
        }
    }

    /// The level of half the size. An edge has half as many pixels there, each of which stands for four:
    /// the price of one falls to a half. It is that of the cheapest one that it covers.
    fn coarser(&self) -> Self {
        let shape = (self.height, self.width);
        Self {
            height: self.height.div_ceil(2),
            width: self.width.div_ceil(2),
            products: std::array::from_fn(|k| {
                halved(&self.products[k], shape, |v| 0.25 * v.iter().sum::<f32>())
            }),
            edge_weight: halved(&self.edge_weight, shape, |v| {
                0.5 * v.into_iter().fold(f32::INFINITY, f32::min)
            }),
            cliff: halved(&self.cliff, shape, |v| v.into_iter().max().unwrap_or(0)),
        }
    }

    /// A constant albedo, without correction.
    fn start(&self) -> State {
        let n = self.height * self.width;
        let sum = |k: usize| self.products[k].iter().map(|v| *v as f64).sum::<f64>();
        let mean = (sum(3) / sum(0).max(f64::MIN_POSITIVE)) as f32;
        State {
            primal: [vec![mean; n], vec![0.0; n]],
            dual: std::array::from_fn(|_| vec![0.0; n]),
        }
    }

    /// Continue on this level from the solution of the next coarser one.
    fn refined(&self, coarse: &State) -> State {
        let columns = self.width.div_ceil(2);
        let repeat = |values: &[f32], factor: f32| -> Vec<f32> {
            (0..self.height * self.width)
                .into_par_iter()
                .with_min_len(self.width)
                .map(|i| factor * values[i / self.width / 2 * columns + i % self.width / 2])
                .collect()
        };
        let mut state = State {
            primal: std::array::from_fn(|k| repeat(&coarse.primal[k], 1.0)),
            // The limits of the dual variables are twice those of the coarser level.
            dual: std::array::from_fn(|k| repeat(&coarse.dual[k], 2.0)),
        };
        // No edge leads out of the frame.
        let last = (self.height - 1) * self.width;
        for k in [0, 2] {
            for row in state.dual[k].chunks_mut(self.width) {
                row[self.width - 1] = 0.0;
            }
            state.dual[k + 1][last..].fill(0.0);
        }
        state
    }

    /// What the primal step of every pixel needs: the inverse of 1 + τ A, and τ times the data.
    fn resolvent(&self) -> [Vec<f32>; 5] {
        let n = self.height * self.width;
        let mut found: [Vec<f32>; 5] = std::array::from_fn(|_| vec![0.0; n]);
        for i in 0..n {
            let p = |k: usize| STEP * self.products[k][i];
            let (m0, m1, m2) = (1.0 + p(0), p(1), 1.0 + p(2));
            let scale = 1.0 / (m0 * m2 - m1 * m1);
            found[0][i] = m2 * scale;
            found[1][i] = -m1 * scale;
            found[2][i] = m0 * scale;
            found[3][i] = p(3);
            found[4][i] = p(4);
        }
        found
    }

    fn descend(&self, state: &mut State, stiffness: f32, huber: f32, iterations: usize) {
        let resolvent = self.resolvent();
        let mut bar = state.primal.clone();
        for _ in 0..iterations {
            self.dual_step(&bar, &mut state.dual, stiffness, huber);
            self.primal_step(&state.dual, &resolvent, &mut state.primal, &mut bar);
        }
    }

    fn dual_step(&self, bar: &[Vec<f32>; 2], dual: &mut [Vec<f32>; 4], stiffness: f32, huber: f32) {
        let width = self.width;
        let shrink = 1.0 / (1.0 + STEP / stiffness);
        let [d0, d1, d2, d3] = dual;
        (d0.par_chunks_mut(width))
            .zip(d1.par_chunks_mut(width))
            .zip(d2.par_chunks_mut(width))
            .zip(d3.par_chunks_mut(width))
            .enumerate()
            .for_each(|(y, (((d0, d1), d2), d3))| {
                let here = y * width..(y + 1) * width;
                // Below the last row there is no edge.
                let next = (y + 1).min(self.height - 1) * width;
                let [(b0, n0), (b1, n1)] =
                    [0, 1].map(|k| (&bar[k][here.clone()], &bar[k][next..next + width]));
                dual_edges(b0, n0, &self.edge_weight[here.clone()], huber, d0, d1);
                dual_slopes(b1, n1, &self.cliff[here], shrink, d2, d3);
            });
    }

    fn primal_step(
        &self,
        dual: &[Vec<f32>; 4],
        resolvent: &[Vec<f32>; 5],
        primal: &mut [Vec<f32>; 2],
        bar: &mut [Vec<f32>; 2],
    ) {
        let width = self.width;
        let nothing = vec![0.0; width];
        let ([p0, p1], [b0, b1]) = (primal, bar);
        (p0.par_chunks_mut(width))
            .zip(p1.par_chunks_mut(width))
            .zip(b0.par_chunks_mut(width))
            .zip(b1.par_chunks_mut(width))
            .enumerate()
            .for_each(|(y, (((p0, p1), b0), b1))| {
                let here = y * width..(y + 1) * width;
                let above = [1, 3].map(|k: usize| match y {
                    0 => &nothing[..],
                    _ => &dual[k][here.start - width..here.start],
                });
                let row: [&[f32]; 4] = std::array::from_fn(|k| &dual[k][here.clone()]);
                let inverse: [&[f32]; 5] = std::array::from_fn(|k| &resolvent[k][here.clone()]);
                primal_row(row, above, inverse, [p0, p1], [b0, b1]);
            });
    }
}

/// Dual step of β along one row: projected on to the price of an edge.
#[multiversion(targets(
    "x86_64+avx512f+avx512vl",
    "x86_64+avx2+fma",
    "x86_64+avx",
    "aarch64+neon"
))]
fn dual_edges(
    here: &[f32],
    below: &[f32],
    weight: &[f32],
    huber: f32,
    along: &mut [f32],
    down: &mut [f32],
) {
    let n = here.len();
    let (below, weight, along, down) = (&below[..n], &weight[..n], &mut along[..n], &mut down[..n]);
    let step = |dx: f32, dy: f32, price: f32, a: &mut f32, b: &mut f32| {
        let soft = price / (price + STEP * huber);
        let (p, q) = ((*a + STEP * dx) * soft, (*b + STEP * dy) * soft);
        let scale = price / (p * p + q * q).sqrt().max(price);
        *a = p * scale;
        *b = q * scale;
    };
    let right = &here[1..];
    for x in 0..n - 1 {
        let (dx, dy) = (right[x] - here[x], below[x] - here[x]);
        step(dx, dy, weight[x], &mut along[x], &mut down[x]);
    }
    let x = n - 1;
    step(
        0.0,
        below[x] - here[x],
        weight[x],
        &mut along[x],
        &mut down[x],
    );
}

/// Dual step of δ along one row.
#[multiversion(targets(
    "x86_64+avx512f+avx512vl",
    "x86_64+avx2+fma",
    "x86_64+avx",
    "aarch64+neon"
))]
fn dual_slopes(
    here: &[f32],
    below: &[f32],
    cliff: &[u8],
    shrink: f32,
    along: &mut [f32],
    down: &mut [f32],
) {
    let n = here.len();
    let (below, cliff, along, down) = (&below[..n], &cliff[..n], &mut along[..n], &mut down[..n]);
    let right = &here[1..];
    for x in 0..n - 1 {
        let tied = shrink * (1 - cliff[x].min(1)) as f32;
        along[x] = tied * (along[x] + STEP * (right[x] - here[x]));
        down[x] = tied * (down[x] + STEP * (below[x] - here[x]));
    }
    let x = n - 1;
    down[x] = shrink * (1 - cliff[x].min(1)) as f32 * (down[x] + STEP * (below[x] - here[x]));
}

/// Primal step of both unknowns along one row.
#[multiversion(targets(
    "x86_64+avx512f+avx512vl",
    "x86_64+avx2+fma",
    "x86_64+avx",
    "aarch64+neon"
))]
fn primal_row(
    dual: [&[f32]; 4],
    above: [&[f32]; 2],
    inverse: [&[f32]; 5],
    primal: [&mut [f32]; 2],
    bar: [&mut [f32]; 2],
) {
    let [p0, p1] = primal;
    let [b0, b1] = bar;
    let n = p0.len();
    let [d0, d1, d2, d3] = dual.map(|v| &v[..n]);
    let [u1, u3] = above.map(|v| &v[..n]);
    let [i0, i1, i2, r0, r1] = inverse.map(|v| &v[..n]);
    let (p1, b0, b1) = (&mut p1[..n], &mut b0[..n], &mut b1[..n]);
    let mut step = |x: usize, left: [f32; 2]| {
        let v0 = d0[x] + d1[x] - left[0] - u1[x];
        let v1 = d2[x] + d3[x] - left[1] - u3[x];
        let (o0, o1) = (p0[x], p1[x]);
        let (g0, g1) = (o0 + STEP * v0 + r0[x], o1 + STEP * v1 + r1[x]);
        let (n0, n1) = (i0[x] * g0 + i1[x] * g1, i1[x] * g0 + i2[x] * g1);
        p0[x] = n0;
        p1[x] = n1;
        b0[x] = 2.0 * n0 - o0;
        b1[x] = 2.0 * n1 - o1;
    };
    step(0, [0.0, 0.0]);
    for x in 1..n {
        step(x, [d0[x - 1], d2[x - 1]]);
    }
}

fn check(model: &Model, options: &Options) -> Result<(), Error> {
    let (height, width) = model.object.shape();
    check_value("width", width >= MIN_WIDTH, "at least 8 px", width)?;
    check_value("height", height >= 1, "at least 1 px", height)?;
    check_shape("value", model.value.shape(), (height, width))?;
    check_shape("slope", model.slope.shape(), (height, width))?;
    check_shape("edge_weight", model.edge_weight.shape(), (height, width))?;
    check_shape("cliff", model.cliff.shape(), (height, width))?;
    let levels = options.iterations.len();
    check_value(
        "iterations",
        (1..usize::BITS as usize).contains(&levels) && width >> (levels - 1) >= 2,
        "one level or more of 2 px or more",
        levels,
    )?;
    let stiff = options.stiffness > 0.0;
    check_value("stiffness", stiff, "above 0", options.stiffness)
}

/// Albedo β and correction δ of every pixel.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::albedo::{Model, Options, joint_albedo};
///
/// // Half of a bright object is painted at an albedo of 0.5.
/// let (h, w) = (16, 32);
/// let object: Vec<f32> = (0..h * w).map(|i| if i % w < 16 { 2.0 } else { 1.0 }).collect();
/// let model = Model {
///     value: Image::new(&[2.0; 512], h, w)?,
///     slope: Image::new(&[0.0; 512], h, w)?,
///     object: Image::new(&object, h, w)?,
///     edge_weight: Image::new(&[0.05; 512], h, w)?,
///     cliff: Image::new(&[0; 512], h, w)?,
/// };
/// let options = Options { stiffness: 1.0, huber: 0.0, iterations: vec![200] };
/// let (albedo, _correction) = joint_albedo(&model, &options)?;
/// assert!((albedo[0] - 1.0).abs() < 0.05 && (albedo[31] - 0.5).abs() < 0.05);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn joint_albedo(model: &Model, options: &Options) -> Result<(Vec<f32>, Vec<f32>), Error> {
    check(model, options)?;
    let mut pyramid = vec![Level::finest(model)];
    for k in 1..options.iterations.len() {
        pyramid.push(pyramid[k - 1].coarser());
    }
    let mut state: Option<State> = None;
    for (k, level) in pyramid.iter().enumerate().rev() {
        let mut here = match &state {
            None => level.start(),
            Some(coarse) => level.refined(coarse),
        };
        // The gradient of one pixel of a level is that over 2 ᵏ px.
        let scale = (1u64 << k) as f32;
        let stiffness = options.stiffness / (scale * scale);
        let iterations = options.iterations[pyramid.len() - 1 - k];
        level.descend(&mut here, stiffness, options.huber * scale, iterations);
        state = Some(here);
    }
    let State { primal, .. } = state.expect("there is one level or more");
    let [albedo, correction] = primal;
    Ok((albedo, correction))
}
