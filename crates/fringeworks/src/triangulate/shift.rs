//! What the projector's distortion moves a decoded coordinate by, so that Newton's method starts next
//! to the solution.
//!
//! The camera's ray ties the projector's other coordinate to the decoded one, so along a ray the shift
//! depends on one coordinate. It is a cubic in that coordinate, and bilinear between rays.

use super::arithmetic::{Cubic, cubic};
use super::lens::{INVERSION_TOLERANCE, newton_steps};
use super::rays::{between, interpolate};
use super::{Rig, Spread};
use rayon::prelude::*;

/// Nodes along each side of the camera's frame.
///
/// Between 33 nodes, a shift that is quadratic over the frame is wrong by 1/8192 of its curvature. One
/// step of Newton's method squares that.
const NODES: usize = 33;

/// Coordinates at which the shift is exact, −1 … 1 over the projector: the Chebyshev nodes.
const AT: [f64; 4] = [-0.923_879_5, -0.382_683_4, 0.382_683_4, 0.923_879_5];

/// Coordinates at which the cubic is compared with the exact shift: where it is furthest off.
const TESTED: [f64; 5] = [-1.0, -0.7, 0.0, 0.7, 1.0];

/// Passes after which a shift is given up. Each divides its error by the inverse of the distortion's
/// slope: ten for strong lenses.
const MAX_PASSES: usize = 40;

/// How far outside of the projector's frame a point may lie, as a share of the frame: no decoded
/// coordinate belongs to points beyond, and the distortion's polynomial does not describe them.
const BEYOND: f64 = 0.05;

/// Cubics of the shift over the camera's frame.
pub struct Shift {
    nodes: Vec<Cubic>,
    /// Newton steps that are left.
    pub newton_steps: usize,
}

/// One axis of the projector, along which coordinates shift.
struct Along<'a> {
    rig: &'a Rig,
    /// Index of the axis: 0 for x.
    axis: usize,
    /// Columns and rows of the projector.
    size: [f64; 2],
}

impl Shift {
    /// Shifts along the axis of the `spread`. `ray` is the direction of a camera pixel, `shape` is rows and columns of the camera, `size`
    /// columns and rows of the projector.
    pub fn new(
        rig: &Rig,
        ray: &(impl Fn(f64, f64) -> (f64, f64) + Sync),
        spread: &Spread,
        shape: (usize, usize),
        size: (usize, usize),
    ) -> Self {
        let along = Along {
            rig,
            axis: usize::from(!spread.along_x),
            size: [size.0 as f64, size.1 as f64],
        };
        let place = |k: usize, pixels: usize| k as f64 / (NODES - 1) as f64 * (pixels - 1) as f64;
        let rows: Vec<(Cubic, Option<f64>)> = (0..NODES * NODES)
            .into_par_iter()
            .map(|k| {
                let (column, row) = (place(k % NODES, shape.1), place(k / NODES, shape.0));
                along.node(ray(column, row))
            })
            .collect();
        let off = rows
            .iter()
            .map(|(_, off)| *off)
            .try_fold(0.0, |a, b| Some(f64::max(a, b?)));
        let shift = |nodes: Vec<Cubic>, newton_steps| Self {
            nodes,
            newton_steps,
        };
        match off {
            Some(off) => shift(rows.iter().map(|(c, _)| *c).collect(), newton_steps(off)),
            None => shift(
                vec![[0.0; 4]; NODES * NODES],
                newton_steps(rig.projector.largest_distortion(size)),
            ),
        }
    }

    /// The cubic at a pixel of the camera's frame.
    pub fn at(&self, shape: (usize, usize), column: f32, row: usize) -> Cubic {
        between(
            self.nodes.as_flattened(),
            (NODES, NODES),
            shape,
            (column, row),
        )
    }
}

impl Along<'_> {
    /// The cubic of a ray, and its largest error; `None` where a shift has no solution.
    fn node(&self, ray: (f64, f64)) -> (Cubic, Option<f64>) {
        let shifts = AT.map(|s| self.shift(ray, s));
        if shifts.iter().any(Option::is_none) {
            return ([0.0; 4], None);
        }
        let found = interpolate(AT, shifts.map(|shift| shift.unwrap_or_default().0));
        let mut off = 0.0f64;
        for s in TESTED {
            let Some((exact, inside)) = self.shift(ray, s) else {
                return (found, None);
            };
            if inside {
                off = off.max((exact - f64::from(cubic::<false>(&found, s as f32))).abs());
            }
        }
        (found, Some(off))
    }

    /// Undistorted less decoded direction of a coordinate s on a ray's epipolar line, and whether the
    /// point lies inside of the projector's frame.
    fn shift(&self, (x, y): (f64, f64), s: f64) -> Option<(f64, bool)> {
        let (lens, r, t) = (
            &self.rig.projector,
            &self.rig.rotation,
            self.rig.translation,
        );
        let column = (s + 1.0) / 2.0 * self.size[self.axis] - 0.5;
        let goal = (column - lens.principal[self.axis]) / lens.focal[self.axis];
        let q = [0, 1, 2].map(|k| r[3 * k] * x + r[3 * k + 1] * y + r[3 * k + 2]);
        let mut straight = goal;
        for _ in 0..MAX_PASSES {
            let w = (straight * q[2] - q[self.axis]) / (t[self.axis] - straight * t[2]);
            let depth = q[2] + w * t[2];
            let seen = [0, 1].map(|k| (q[k] + w * t[k]) / depth);
            let kept = [0, 1].map(|k| self.within(k, seen[k]));
            let (distorted_x, distorted_y) = lens.distort(kept[0], kept[1]);
            let step = goal - [distorted_x, distorted_y][self.axis] + kept[self.axis] - straight;
            straight += step;
            if step.abs() < INVERSION_TOLERANCE {
                return Some((straight - goal, seen == kept));
            }
        }
        None
    }

    /// A direction brought into the projector's frame, and a margin around it.
    fn within(&self, axis: usize, direction: f64) -> f64 {
        let lens = &self.rig.projector;
        let margin = BEYOND * self.size[axis];
        let edge = |at: f64| (at - lens.principal[axis]) / lens.focal[axis];
        direction.clamp(edge(-margin), edge(self.size[axis] + margin))
    }
}
