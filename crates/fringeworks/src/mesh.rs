//! Intersection of rays with triangles, and the triangles nearest to points, by a tree of boxes halved at
//! the median of the longest side.

use crate::{Error, check_length, check_value};
use rayon::prelude::*;

type Point = [f64; 3];

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
const MAX_WAITING: usize = 2 * usize::BITS as usize;

/// Triangles of a branch that is worth a task of its own.
const TRIANGLES_PER_TASK: usize = 4096;

#[derive(Clone, Default)]
struct Node {
    low: Point,
    high: Point,
    /// Of a leaf, its first triangle. Of an inner node, its right child; the left child is the next
    /// node.
    first: usize,
    /// Number of triangles of a leaf; 0 for an inner node.
    count: usize,
}

/// Triangles that rays can be cast at, and that points have a distance from.
pub struct Triangles {
    nodes: Vec<Node>,
    /// A corner and the two sides from it, in the order of the tree.
    triangles: Vec<[Point; 3]>,
    /// The caller's index of each triangle.
    order: Vec<u32>,
}

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Point, b: Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Triangles {
    /// `vertices` holds x, y, z of each vertex, `faces` three vertex indices per triangle.
    ///
    /// ```
    /// use fringeworks::mesh::Triangles;
    ///
    /// let corners = [0.0, 0.0, 5.0, 1.0, 0.0, 5.0, 0.0, 1.0, 5.0];
    /// assert!(Triangles::new(&corners, &[0, 1, 2]).is_ok());
    /// assert!(Triangles::new(&corners, &[0, 1, 3]).is_err());
    /// ```
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
        let mut nodes = vec![Node::default(); tree_size(order.len())];
        let tree = Tree {
            corners: &corners,
            centres: &centres,
        };
        tree.build(&mut order, 0, &mut nodes, 0);
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
    ///
    /// ```
    /// use fringeworks::mesh::Triangles;
    ///
    /// let triangle = Triangles::new(&[0.0, 0.0, 5.0, 1.0, 0.0, 5.0, 0.0, 1.0, 5.0], &[0, 1, 2])?;
    /// let (mut distance, mut face) = ([0.0; 2], [0; 2]);
    /// let origins = [0.2, 0.2, 0.0, 9.0, 9.0, 0.0];
    /// let directions = [0.0, 0.0, 1.0, 0.0, 0.0, 1.0];
    /// triangle.hit(&origins, &directions, 0.0, &mut distance, &mut face)?;
    /// assert_eq!((distance, face), ([5.0, f64::INFINITY], [0, -1]));
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
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

/// Number of nodes of the tree of so many triangles.
fn tree_size(triangles: usize) -> usize {
    if triangles <= LEAF_TRIANGLES {
        return 1;
    }
    let (left, right) = (triangles / 2, triangles - triangles / 2);
    let size = tree_size(left);
    1 + size
        + if left == right {
            size
        } else {
            tree_size(right)
        }
}

/// What the branches of a tree are built from.
struct Tree<'a> {
    corners: &'a [[Point; 3]],
    centres: &'a [Point],
}

impl Tree<'_> {
    /// The smallest and the largest coordinates of some triangles.
    fn bounds(&self, order: &[u32]) -> (Point, Point) {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &k in order {
            for corner in self.corners[k as usize] {
                for axis in 0..3 {
                    low[axis] = low[axis].min(corner[axis]);
                    high[axis] = high[axis].max(corner[axis]);
                }
            }
        }
        (low, high)
    }

    /// Set the nodes of the triangles in `order`. `offset` is the index of the first one in the whole order,
    /// `here` that of the first node among all nodes.
    fn build(&self, order: &mut [u32], offset: usize, nodes: &mut [Node], here: usize) {
        let (low, high) = self.bounds(order);
        let (first, count) = (offset, order.len());
        let (top, below) = nodes.split_first_mut().expect("a tree has a node");
        *top = Node {
            low,
            high,
            first,
            count,
        };
        if count <= LEAF_TRIANGLES {
            return;
        }
        let side = minus(high, low);
        let axis = (0..3)
            .max_by(|&a, &b| side[a].total_cmp(&side[b]))
            .unwrap_or(0);
        let half = count / 2;
        order.select_nth_unstable_by(half, |&a, &b| {
            self.centres[a as usize][axis].total_cmp(&self.centres[b as usize][axis])
        });
        let left_size = tree_size(half);
        let second = here + 1 + left_size;
        (top.first, top.count) = (second, 0);
        let (left, right) = order.split_at_mut(half);
        let (left_nodes, right_nodes) = below.split_at_mut(left_size);
        let mut left = || self.build(left, offset, left_nodes, here + 1);
        let mut right = || self.build(right, offset + half, right_nodes, second);
        if count > TRIANGLES_PER_TASK {
            rayon::join(left, right);
        } else {
            left();
            right();
        }
    }
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

/// Points that one task searches for: enough to hide the cost of a task.
const POINTS_PER_TASK: usize = 256;

/// Bits of a cell's number along each axis, by which points are ordered: 30 bits in all, beside which an index
/// has room in 64.
const CURVE_BITS: u32 = 10;

/// By how much farther than a triangle that is known a search looks, over the size of the mesh: well above
/// rounding, so that the bound never decides which triangle is found.
const SEARCH_TOLERANCE: f64 = 1e-12;

impl Triangles {
    /// Index of the triangle that is nearest to every point; −1 where none lies within `reach`.
    ///
    /// ```
    /// use fringeworks::mesh::Triangles;
    ///
    /// let triangle = Triangles::new(&[0.0, 0.0, 5.0, 1.0, 0.0, 5.0, 0.0, 1.0, 5.0], &[0, 1, 2])?;
    /// let mut face = [0; 2];
    /// triangle.nearest(&[0.2, 0.2, 4.0, 0.2, 0.2, 1.0], 2.0, &mut face)?;
    /// assert_eq!(face, [0, -1]);
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn nearest(&self, points: &[f64], reach: f64, face: &mut [i32]) -> Result<(), Error> {
        check_length("points", points.len(), 3 * face.len())?;
        let order = along_curve(points);
        let found: Vec<i32> = order
            .par_chunks(POINTS_PER_TASK)
            .flat_map_iter(|part| self.nearest_to_each(points, part, reach))
            .collect();
        for (&k, found) in order.iter().zip(found) {
            face[k as usize] = found;
        }
        Ok(())
    }

    /// Triangles that are nearest to the points of these indices, or −1.
    ///
    /// Each search starts from what the point before has found: no triangle farther away can be the nearest.
    fn nearest_to_each(&self, points: &[f64], index: &[u32], reach: f64) -> Vec<i32> {
        let rim = self.nodes.first().map_or(0.0, |node| {
            SEARCH_TOLERANCE * length(minus(node.high, node.low))
        });
        let mut last = None;
        let search = |&k: &u32| {
            let k = 3 * k as usize;
            let point = [points[k], points[k + 1], points[k + 2]];
            let bound = last.map_or(f64::INFINITY, |t: usize| {
                (triangle_square(&self.triangles[t], point).sqrt() + rim).powi(2)
            });
            let limit = reach * reach;
            let mut found = self.nearest_to(point, bound.min(limit));
            if found.is_none() && bound < limit {
                found = self.nearest_to(point, limit);
            }
            last = found.or(last);
            found.map_or(-1, |t| self.order[t] as i32)
        };
        index.iter().map(search).collect()
    }

    /// Place in the tree's order of the triangle that is nearest to a point and nearer than the root of `best`.
    fn nearest_to(&self, point: Point, mut best: f64) -> Option<usize> {
        let mut found = None;
        let mut waiting = [(0usize, 0.0f64); MAX_WAITING];
        // Comparisons with NaN are false: a point that is no number has no triangle.
        let mut n = usize::from(!self.order.is_empty());
        while n > 0 {
            n -= 1;
            let (k, square) = waiting[n];
            if square > best {
                continue;
            }
            let node = &self.nodes[k];
            if node.count == 0 {
                let (left, right) = (k + 1, node.first);
                let a = (left, box_square(&self.nodes[left], point));
                let b = (right, box_square(&self.nodes[right], point));
                // The nearer child is on top, so it is tested first.
                [waiting[n], waiting[n + 1]] = if a.1 < b.1 { [b, a] } else { [a, b] };
                n += 2;
                continue;
            }
            for t in node.first..node.first + node.count {
                let square = triangle_square(&self.triangles[t], point);
                if square < best {
                    (best, found) = (square, Some(t));
                }
            }
        }
        found
    }
}

/// Indices of points along a curve that fills space (Morton's order): neighbours in it are near each other,
/// and searches of neighbours read the same boxes.
fn along_curve(points: &[f64]) -> Vec<u32> {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for point in points.chunks_exact(3) {
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    let longest = minus(high, low).into_iter().fold(0.0, f64::max);
    let cells = f64::from(1u32 << CURVE_BITS) / longest.max(f64::MIN_POSITIVE);
    let mut keys: Vec<u64> = points
        .par_chunks_exact(3)
        .enumerate()
        .map(|(k, point)| {
            let cell = |axis: usize| ((point[axis] - low[axis]) * cells) as u64;
            let key = spread(cell(0)) << 2 | spread(cell(1)) << 1 | spread(cell(2));
            key << 32 | k as u64
        })
        .collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|key| key as u32).collect()
}

/// The lowest bits of a number with two zeros between neighbours.
fn spread(cell: u64) -> u64 {
    let cell = cell.min((1 << CURVE_BITS) - 1);
    (0..CURVE_BITS).fold(0, |bits, k| bits | (cell >> k & 1) << (3 * k))
}

fn length(v: Point) -> f64 {
    dot(v, v).sqrt()
}

/// Square of the distance of a point from a node's box.
fn box_square(node: &Node, point: Point) -> f64 {
    let mut square = 0.0;
    for axis in 0..3 {
        let below = node.low[axis] - point[axis];
        let above = point[axis] - node.high[axis];
        let off = below.max(above).max(0.0);
        square += off * off;
    }
    square
}

/// Square of the distance of a point from a triangle.
///
/// The nearest point lies inside where the barycentric coordinates are positive, and else on one of
/// the three sides.
fn triangle_square(triangle: &[Point; 3], point: Point) -> f64 {
    let [corner, one, other] = *triangle;
    let from = minus(point, corner);
    let normal = cross(one, other);
    let size = dot(normal, normal);
    let v = dot(cross(from, other), normal);
    let w = dot(cross(one, from), normal);
    if size > 0.0 && v >= 0.0 && w >= 0.0 && v + w <= size {
        let height = dot(from, normal);
        return height * height / size;
    }
    side_square(from, one)
        .min(side_square(from, other))
        .min(side_square(minus(from, one), minus(other, one)))
}

/// Square of the distance of a point from a side that starts at the origin.
fn side_square(from: Point, side: Point) -> f64 {
    let length = dot(side, side);
    let t = if length > 0.0 {
        (dot(from, side) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let off = minus(from, side.map(|s| t * s));
    dot(off, off)
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

    #[test]
    fn tree_finds_the_nearest_of_all() {
        let n = 30usize;
        let vertices: Vec<f64> = (0..n * n)
            .flat_map(|k| {
                let (x, y) = ((k % n) as f64, (k / n) as f64);
                [x, y, 2.0 * (x * 0.7).sin() * (y * 0.9).cos()]
            })
            .collect();
        let mut faces = Vec::new();
        for a in 0..(n * (n - 1)) as u32 {
            if (a as usize) % n < n - 1 {
                let n = n as u32;
                faces.extend([a, a + 1, a + n, a + 1, a + n + 1, a + n]);
            }
        }
        let tree = Triangles::new(&vertices, &faces).unwrap();
        let points: Vec<f64> = (0..3000)
            .map(|k| (k as f64 * 7.3).rem_euclid(34.0) - 2.0)
            .collect();
        let mut face = vec![0; 1000];
        tree.nearest(&points, 6.0, &mut face).unwrap();
        let mut far = 0;
        for (p, &face) in points.chunks_exact(3).zip(&face) {
            let point = [p[0], p[1], p[2]];
            let all = tree
                .triangles
                .iter()
                .map(|t| triangle_square(t, point))
                .fold(f64::INFINITY, f64::min);
            if face < 0 {
                assert!(all >= 36.0);
                far += 1;
                continue;
            }
            let at = tree.order.iter().position(|&k| k as i32 == face).unwrap();
            assert_eq!(triangle_square(&tree.triangles[at], point), all);
        }
        assert!(far > 100 && far < 900);
        tree.nearest(&[f64::NAN; 3], 6.0, &mut face[..1]).unwrap();
        assert_eq!(face[0], -1);
    }

    #[test]
    fn what_is_nearest_does_not_depend_on_other_points() {
        let (vertices, faces) = sheet(40);
        let tree = Triangles::new(&vertices, &faces).unwrap();
        let mut points: Vec<f64> = (0..3000)
            .map(|k| (k as f64 * 7.3).rem_euclid(44.0) - 2.0)
            .collect();
        // On triangles themselves no bound above their distance of 0 is left.
        points.extend(&vertices);
        let mut face = vec![0; points.len() / 3];
        tree.nearest(&points, 9.0, &mut face).unwrap();
        for (p, &together) in points.chunks_exact(3).zip(&face) {
            let mut alone = [0];
            tree.nearest(p, 9.0, &mut alone).unwrap();
            assert_eq!(alone[0], together);
        }
    }
}
