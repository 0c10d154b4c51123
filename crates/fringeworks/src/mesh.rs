//! Intersection of rays with triangles, by a tree of boxes halved at the median of the longest side.

use crate::{Error, check_length, check_value};
use rayon::prelude::*;

pub(crate) type Point = [f64; 3];
/// Triangles per leaf: about where testing them costs as much as another box.
const LEAF_TRIANGLES: usize = 4;

/// Width of the rim that is added to a triangle, in barycentric coordinates.
///
/// A little above rounding, so that rays find no gap between neighbouring triangles.
const RIM: f64 = 1e-12;

/// Relative tolerance of a ray's interval in a box: a little above rounding.
const BOX_TOLERANCE: f64 = 1e-12;

/// Rays that one task casts: enough to hide the cost of a task.
const RAYS_PER_TASK: usize = 1024;

/// Nodes that can wait on the way down the tree.
///
/// Halving makes a tree of n triangles log₂ n deep, and each level leaves one child waiting.
pub(crate) const MAX_WAITING: usize = 2 * usize::BITS as usize;

pub(crate) struct Node {
    pub(crate) low: Point,
    pub(crate) high: Point,
    /// Of a leaf, its first triangle. Of an inner node, its right child; the left child is the next
    /// node.
    pub(crate) first: usize,
    /// Number of triangles of a leaf; 0 for an inner node.
    pub(crate) count: usize,
}

/// Triangles that rays can be cast at, and that points have a distance from.
pub struct Triangles {
    pub(crate) nodes: Vec<Node>,
    /// A corner and the two sides from it, in the order of the tree.
    pub(crate) triangles: Vec<[Point; 3]>,
    /// The caller's index of each triangle.
    pub(crate) order: Vec<u32>,
}

pub(crate) fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn cross(a: Point, b: Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

pub(crate) fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Triangles {
    /// `vertices` holds x, y, z of each vertex, `faces` three vertex indices per triangle.
    pub fn new(vertices: &[f64], faces: &[u32]) -> Result<Self, Error> {
        check_length("vertices", vertices.len() % 3, 0)?;
        check_length("faces", faces.len() % 3, 0)?;
        let last = faces.iter().max().map_or(0, |&k| k as usize + 1);
        check_value(
            "faces",
            last <= vertices.len() / 3,
            "vertices that exist",
            last,
        )?;
        let vertex = |k: u32| -> Point {
            let k = 3 * k as usize;
            [vertices[k], vertices[k + 1], vertices[k + 2]]
        };
        let corners: Vec<[Point; 3]> = faces
            .chunks_exact(3)
            .map(|f| [vertex(f[0]), vertex(f[1]), vertex(f[2])])
            .collect();
        let centres: Vec<Point> = corners
            .iter()
            .map(|c| [0, 1, 2].map(|k| (c[0][k] + c[1][k] + c[2][k]) / 3.0))
            .collect();
        let mut order: Vec<u32> = (0..corners.len() as u32).collect();
        let mut nodes = Vec::new();
        build(&corners, &centres, &mut order, 0, &mut nodes);
        let triangles = order
            .iter()
            .map(|&k| {
                let [a, b, c] = corners[k as usize];
                [a, minus(b, a), minus(c, a)]
            })
            .collect();
        Ok(Self {
            nodes,
            triangles,
            order,
        })
    }

    /// First hit of every ray beyond the distance `near`, in lengths of the ray's direction (∞ for
    /// none), and the index of the triangle (−1 for none).
    pub fn hit(
        &self,
        origins: &[f64],
        directions: &[f64],
        near: f64,
        distance: &mut [f64],
        face: &mut [i32],
    ) -> Result<(), Error> {
        let n = distance.len();
        check_length("origins", origins.len(), 3 * n)?;
        check_length("directions", directions.len(), 3 * n)?;
        check_length("faces", face.len(), n)?;
        origins
            .par_chunks_exact(3)
            .zip(directions.par_chunks_exact(3))
            .zip(distance.par_iter_mut().zip(face.par_iter_mut()))
            .with_min_len(RAYS_PER_TASK)
            .for_each(|((o, d), (distance, face))| {
                (*distance, *face) = self.first([o[0], o[1], o[2]], [d[0], d[1], d[2]], near);
            });
        Ok(())
    }

    /// Distance and triangle of the first hit of one ray.
    fn first(&self, origin: Point, direction: Point, near: f64) -> (f64, i32) {
        let (mut best, mut face) = (f64::INFINITY, -1);
        if self.order.is_empty() {
            return (best, face);
        }
        let inverse = direction.map(|d| 1.0 / d);
        let mut waiting = [0usize; MAX_WAITING];
        let mut n = 1;
        while n > 0 {
            n -= 1;
            let k = waiting[n];
            let node = &self.nodes[k];
            if enter_distance(node, origin, inverse) >= best {
                continue;
            }
            if node.count == 0 {
                let (left, right) = (k + 1, node.first);
                let (a, b) = (
                    enter_distance(&self.nodes[left], origin, inverse),
                    enter_distance(&self.nodes[right], origin, inverse),
                );
                // The nearer child is on top, so it is tested first.
                [waiting[n], waiting[n + 1]] = if a < b { [right, left] } else { [left, right] };
                n += 2;
                continue;
            }
            for t in node.first..node.first + node.count {
                let distance = hit_distance(&self.triangles[t], origin, direction);
                if distance > near && distance < best {
                    (best, face) = (distance, self.order[t] as i32);
                }
            }
        }
        (best, face)
    }
}

/// Append the tree of the triangles in `order`; `offset` is the index of the first one in the whole
/// order.
fn build(
    corners: &[[Point; 3]],
    centres: &[Point],
    order: &mut [u32],
    offset: usize,
    nodes: &mut Vec<Node>,
) {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for &k in order.iter() {
        for corner in corners[k as usize] {
            for axis in 0..3 {
                low[axis] = low[axis].min(corner[axis]);
                high[axis] = high[axis].max(corner[axis]);
            }
        }
    }
    let here = nodes.len();
    nodes.push(Node {
        low,
        high,
        first: offset,
        count: order.len(),
    });
    if order.len() <= LEAF_TRIANGLES {
        return;
    }
    let side = minus(high, low);
    let axis = (0..3)
        .max_by(|&a, &b| side[a].total_cmp(&side[b]))
        .unwrap_or(0);
    let half = order.len() / 2;
    order.select_nth_unstable_by(half, |&a, &b| {
        centres[a as usize][axis].total_cmp(&centres[b as usize][axis])
    });
    let (left, right) = order.split_at_mut(half);
    build(corners, centres, left, offset, nodes);
    let second = nodes.len();
    build(corners, centres, right, offset + half, nodes);
    nodes[here].first = second;
    nodes[here].count = 0;
}

/// Distance at which a ray enters a node's box; ∞ where it misses the box.
fn enter_distance(node: &Node, origin: Point, inverse: Point) -> f64 {
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        let a = (node.low[axis] - origin[axis]) * inverse[axis];
        let b = (node.high[axis] - origin[axis]) * inverse[axis];
        // A ray in the plane of a side gives 0 · ∞ = NaN, which min and max ignore.
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    if enter <= leave * (1.0 + BOX_TOLERANCE) {
        enter
    } else {
        f64::INFINITY
    }
}

/// Distance at which a ray meets a triangle; NaN where it misses (Möller and Trumbore, Journal of
/// Graphics Tools 2, 1997).
fn hit_distance(triangle: &[Point; 3], origin: Point, direction: Point) -> f64 {
    let [corner, one, other] = *triangle;
    let p = cross(direction, other);
    let scale = 1.0 / dot(one, p);
    let from = minus(origin, corner);
    let u = dot(from, p) * scale;
    let q = cross(from, one);
    let v = dot(direction, q) * scale;
    if u >= -RIM && v >= -RIM && u + v <= 1.0 + RIM {
        dot(other, q) * scale
    } else {
        f64::NAN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wavy sheet of n × n vertices.
    fn sheet(n: usize) -> (Vec<f64>, Vec<u32>) {
        let at = |i: usize, j: usize| -> Point {
            let (x, y) = (i as f64, j as f64);
            [x, y, (x * 0.7).sin() + (y * 0.9).cos()]
        };
        let vertices = (0..n * n).flat_map(|k| at(k % n, k / n)).collect();
        let mut faces = Vec::new();
        for j in 0..n - 1 {
            for i in 0..n - 1 {
                let a = (j * n + i) as u32;
                let n = n as u32;
                faces.extend([a, a + 1, a + n, a + 1, a + n + 1, a + n]);
            }
        }
        (vertices, faces)
    }

    /// Directions of rays in a cone, along a spiral.
    fn cone(rays: usize) -> Vec<f64> {
        (0..rays)
            .flat_map(|k| {
                let a = k as f64 * 2.4;
                let r = 0.8 * (k as f64 / rays as f64).sqrt();
                [r * a.cos(), r * a.sin(), -1.0]
            })
            .collect()
    }

    #[test]
    fn tree_finds_what_a_search_through_all_finds() {
        let (vertices, faces) = sheet(40);
        let tree = Triangles::new(&vertices, &faces).unwrap();
        let rays = 500;
        let origin = [19.3, 20.1, 30.0];
        let directions = cone(rays);
        let origins = origin.repeat(rays);
        let (mut distance, mut face) = (vec![0.0; rays], vec![0; rays]);
        tree.hit(&origins, &directions, 1e-9, &mut distance, &mut face)
            .unwrap();
        let mut missed = 0;
        for (k, d) in directions.chunks_exact(3).enumerate() {
            let all = tree
                .triangles
                .iter()
                .map(|t| hit_distance(t, origin, [d[0], d[1], d[2]]))
                .filter(|&t| t > 1e-9)
                .fold(f64::INFINITY, f64::min);
            assert_eq!(distance[k], all);
            assert_eq!(face[k] < 0, all.is_infinite());
            missed += usize::from(all.is_infinite());
        }
        assert!(missed > 0 && missed < rays / 2);
    }
}
