//! The nearest of many triangles to a point, by the tree of boxes that rays use as well.

use crate::mesh::{MAX_WAITING, Node, Point, Triangles, cross, dot, minus};
use crate::{Error, check_length};
use rayon::prelude::*;

/// Points that one task searches for: enough to hide the cost of a task.
const POINTS_PER_TASK: usize = 256;

impl Triangles {
    /// Index of the triangle that is nearest to every point; −1 where none lies within `reach`.
    pub fn nearest(&self, points: &[f64], reach: f64, face: &mut [i32]) -> Result<(), Error> {
        check_length("points", points.len(), 3 * face.len())?;
        points
            .par_chunks_exact(3)
            .zip(face.par_iter_mut())
            .with_min_len(POINTS_PER_TASK)
            .for_each(|(p, face)| *face = self.nearest_to([p[0], p[1], p[2]], reach));
        Ok(())
    }

    /// Index of the triangle that is nearest to a point, or −1.
    fn nearest_to(&self, point: Point, reach: f64) -> i32 {
        let (mut best, mut face) = (reach * reach, -1);
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
                    (best, face) = (square, self.order[t] as i32);
                }
            }
        }
        face
    }
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

    #[test]
    fn tree_finds_what_a_search_through_all_finds() {
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
}
