//! Distances of points from a plane, sphere or cylinder, and the normal equations of its fit.

use crate::sample::quantiles;
use crate::{Error, Image, check_length, check_shape, check_value};
use rayon::prelude::*;

/// Points that are computed together: sums have as many parts, whose order does not depend on the
/// processor.
const LANES: usize = 8;

/// Points of one task. Sums of tasks are added in the order of the points, however many threads there are.
const TASK: usize = 4096;

/// Length that is divided by where a point lies on the centre or axis: its direction is undefined, and any
/// finite one does.
const TINY_LENGTH: f64 = 1e-300;

/// A body, in any coordinates. Directions need not have length 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Body {
    /// Normal, and distance from the origin times the normal's length.
    Plane([f64; 4]),
    /// Centre and radius.
    Sphere([f64; 4]),
    /// A point of the axis, the axis, and the radius.
    Cylinder([f64; 7]),
}

impl Body {
    /// A body of these values; `kind` is "plane", "sphere" or "cylinder".
    ///
    /// ```
    /// use fringeworks::form::Body;
    ///
    /// assert_eq!(Body::new("sphere", &[0.0, 0.0, 0.0, 2.0])?, Body::Sphere([0.0, 0.0, 0.0, 2.0]));
    /// assert!(Body::new("cone", &[1.0]).is_err());
    /// # Ok::<(), fringeworks::Error>(())
    /// ```
    pub fn new(kind: &str, values: &[f64]) -> Result<Self, Error> {
        let count = if kind == "cylinder" { 7 } else { 4 };
        check_length("values", values.len(), count)?;
        let four = || [values[0], values[1], values[2], values[3]];
        match kind {
            "plane" => Ok(Self::Plane(four())),
            "sphere" => Ok(Self::Sphere(four())),
            "cylinder" => Ok(Self::Cylinder(std::array::from_fn(|k| values[k]))),
            _ => Err(Error::Value {
                name: "body",
                expected: "plane, sphere or cylinder",
                got: kind.to_owned(),
            }),
        }
    }
}

/// Signed distances of points (n, 3) from a body: out of a sphere or cylinder, along the normal of a plane.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::form::{Body, form_distances};
///
/// let points = Image::new(&[0.0, 0.0, 5.0], 1, 3)?;
/// assert_eq!(form_distances(Body::Sphere([0.0, 0.0, 0.0, 2.0]), points)?, [3.0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn form_distances(body: Body, points: Image<f64>) -> Result<Vec<f64>, Error> {
    check_shape("points", points.shape(), (points.height(), 3))?;
    let mut found = vec![0.0; points.height()];
    found
        .par_chunks_mut(TASK)
        .zip(points.par_chunks(3 * TASK))
        .for_each(|(out, points)| distances(out, points, body));
    Ok(found)
}

/// Signed distances of points from a body.
fn distances(out: &mut [f64], points: &[f64], body: Body) {
    match body {
        Body::Plane(q) => distances_of(out, points, |p| plane(&q, p)[4]),
        Body::Sphere(q) => distances_of(out, points, |p| sphere(&q, p)[4]),
        Body::Cylinder(q) => {
            let (axis, length) = direction([q[3], q[4], q[5]]);
            distances_of(out, points, |p| cylinder(&q, axis, length, p)[7]);
        }
    }
}

/// Sums of the products of all pairs of columns: the derivatives of the weighted distances by the body's
/// values, and the weighted distances. (values + 1)², row after row.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::form::{Body, form_moments};
///
/// let points = Image::new(&[0.0, 0.0, 5.0], 1, 3)?;
/// let sums = form_moments(Body::Sphere([0.0, 0.0, 0.0, 2.0]), points, &[1.0])?;
/// assert_eq!(sums[24], 9.0);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn form_moments(body: Body, points: Image<f64>, weight: &[f64]) -> Result<Vec<f64>, Error> {
    check_shape("points", points.shape(), (points.height(), 3))?;
    check_length("weight", weight.len(), points.height())?;
    Ok(match body {
        Body::Plane(q) => sums_of(&points, weight, |p| plane(&q, p)),
        Body::Sphere(q) => sums_of(&points, weight, |p| sphere(&q, p)),
        Body::Cylinder(q) => {
            let (axis, length) = direction([q[3], q[4], q[5]]);
            sums_of(&points, weight, |p| cylinder(&q, axis, length, p))
        }
    })
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A vector of length 1, and the length before.
#[inline(always)]
fn direction(v: [f64; 3]) -> ([f64; 3], f64) {
    let length = dot(v, v).sqrt();
    (v.map(|c| c / length), length)
}

/// Derivatives of the distance from a plane by its values, and the distance.
#[inline(always)]
fn plane(q: &[f64; 4], p: [f64; 3]) -> [f64; 5] {
    let (n, size) = direction([q[0], q[1], q[2]]);
    let away = dot(p, n) - q[3] / size;
    let by = |c: usize| (p[c] - away * n[c]) / size;
    [by(0), by(1), by(2), -1.0 / size, away]
}

/// Derivatives of the distance from a sphere by its values, and the distance.
#[inline(always)]
fn sphere(q: &[f64; 4], p: [f64; 3]) -> [f64; 5] {
    let inwards = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
    let size = dot(inwards, inwards).sqrt();
    let by = inwards.map(|c| c / size.max(TINY_LENGTH));
    [by[0], by[1], by[2], -1.0, size - q[3]]
}

/// Derivatives of the distance from a cylinder by its values, and the distance.
#[inline(always)]
fn cylinder(q: &[f64; 7], axis: [f64; 3], length: f64, p: [f64; 3]) -> [f64; 8] {
    let inwards = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
    let along = dot(inwards, axis);
    let across: [f64; 3] = std::array::from_fn(|c| inwards[c] - along * axis[c]);
    let size = dot(across, across).sqrt();
    let by = across.map(|c| c / size.max(TINY_LENGTH));
    let turned = along / -length;
    [
        by[0],
        by[1],
        by[2],
        turned * by[0],
        turned * by[1],
        turned * by[2],
        -1.0,
        size - q[6],
    ]
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn distances_of(out: &mut [f64], points: &[f64], distance: impl Fn([f64; 3]) -> f64) {
    for (found, p) in out.iter_mut().zip(points.chunks_exact(3)) {
        *found = distance([p[0], p[1], p[2]]);
    }
}

/// The sums over all points, of tasks in parallel.
fn sums_of<const N: usize>(
    points: &[f64],
    weight: &[f64],
    row: impl Fn([f64; 3]) -> [f64; N] + Sync,
) -> Vec<f64> {
    let parts: Vec<[[f64; N]; N]> = points
        .par_chunks(3 * TASK)
        .zip(weight.par_chunks(TASK))
        .map(|(points, weight)| task(points, weight, &row))
        .collect();
    let mut sums = [[0.0; N]; N];
    for part in parts {
        for i in 0..N {
            for j in 0..=i {
                sums[i][j] += part[i][j];
                sums[j][i] = sums[i][j];
            }
        }
    }
    sums.as_flattened().to_vec()
}

/// The sums over the points of one task, of which j ≤ i are set.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn task<const N: usize, R: Fn([f64; 3]) -> [f64; N]>(
    points: &[f64],
    weight: &[f64],
    row: &R,
) -> [[f64; N]; N] {
    let mut lanes = [[[0.0; LANES]; N]; N];
    let mut block = [[0.0; LANES]; N];
    let mut places = [[0.0; LANES]; 3];
    let mut factors;
    for (points, weight) in points.chunks(3 * LANES).zip(weight.chunks(LANES)) {
        // Lanes behind the last point repeat an earlier one, without weight.
        factors = [0.0; LANES];
        factors[..weight.len()].copy_from_slice(weight);
        for (lane, p) in points.chunks_exact(3).enumerate() {
            for axis in 0..3 {
                places[axis][lane] = p[axis];
            }
        }
        for lane in 0..LANES {
            let values = row([places[0][lane], places[1][lane], places[2][lane]]);
            for i in 0..N {
                block[i][lane] = values[i] * factors[lane];
            }
        }
        for i in 0..N {
            for j in 0..=i {
                for lane in 0..LANES {
                    lanes[i][j][lane] += block[i][lane] * block[j][lane];
                }
            }
        }
    }
    lanes.map(|row| row.map(|part| part.iter().sum()))
}

/// For each of several bodies of one kind, the distance within which a share of the points lies: a quantile of
/// the distances' magnitudes.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::form::{Body, form_scores};
///
/// let points = [0.0, 0.0, 5.0, 0.0, 0.0, 1.0];
/// let bodies = [Body::Sphere([0.0, 0.0, 0.0, 2.0])];
/// assert_eq!(form_scores(&bodies, Image::new(&points, 2, 3)?, 0.5)?, [2.0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn form_scores(bodies: &[Body], points: Image<f64>, share: f64) -> Result<Vec<f64>, Error> {
    check_shape("points", points.shape(), (points.height(), 3))?;
    bodies
        .par_iter()
        .map_init(
            || vec![0.0; points.height()],
            |away, &body| {
                distances(away, &points, body);
                away.iter_mut().for_each(|value| *value = value.abs());
                Ok(quantiles(away, &[share])?[0])
            },
        )
        .collect()
}

/// Random numbers of Steele, Lea and Flood (splitmix64, 2014): few are drawn, and each from 64 bits.
struct Random(u64);

impl Random {
    /// A whole number below `count`, which is above 0.
    fn below(&mut self, count: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ bits >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^= bits >> 31;
        ((u128::from(bits) * count as u128) >> 64) as usize
    }
}

/// Draws for each point of a group, before the neighbours of its place are listed: where a group has a tenth of
/// the points around it, all are found by then.
const DRAWS: usize = 32;

/// Largest number of groups: a thousand is usual, and each takes a microsecond or more.
const MOST_GROUPS: usize = 1_000_000;

/// `count` different ones of all, at random; none of too few.
fn drawn_from(mut all: Vec<u32>, count: usize, random: &mut Random) -> Vec<u32> {
    if all.len() < count {
        return Vec::new();
    }
    for k in 0..count {
        let other = k + random.below(all.len() - k);
        all.swap(k, other);
    }
    all.truncate(count);
    all
}

/// Groups of `count` different points each, at random within `reach` of a random point; their indices, group
/// after group. Places with too few points have no group.
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::form::near_groups;
///
/// let points = [0.0, 0.0, 5.0, 0.0, 0.0, 5.5, 0.0, 0.0, 99.0];
/// let found = near_groups(Image::new(&points, 3, 3)?, 2, 10, 1.0, 7)?;
/// assert!(found.iter().all(|&k| k < 2) && found.len() <= 20);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn near_groups(
    points: Image<f64>,
    count: usize,
    groups: usize,
    reach: f64,
    seed: u64,
) -> Result<Vec<u32>, Error> {
    check_shape("points", points.shape(), (points.height(), 3))?;
    let place = |k: usize| [points[3 * k], points[3 * k + 1], points[3 * k + 2]];
    check_value("count", count > 0, "1 or more", count)?;
    check_value(
        "groups",
        groups <= MOST_GROUPS,
        "a million or fewer",
        groups,
    )?;
    let (n, limit) = (points.height(), reach * reach);
    let mut random = Random(seed);
    let (mut found, mut group) = (Vec::new(), Vec::new());
    for _ in 0..if n < count { 0 } else { groups } {
        let middle = place(random.below(n));
        let near = |k: usize| {
            let off = place(k);
            let off: [f64; 3] = std::array::from_fn(|c| off[c] - middle[c]);
            dot(off, off) < limit
        };
        group.clear();
        for _ in 0..DRAWS * count {
            let k = random.below(n);
            if near(k) && !group.contains(&(k as u32)) {
                group.push(k as u32);
            }
            if group.len() == count {
                break;
            }
        }
        if group.len() < count {
            // Few are near: the group is drawn anew from a list of them.
            let all = (0..n).filter(|&k| near(k)).map(|k| k as u32).collect();
            group = drawn_from(all, count, &mut random);
        }
        found.extend(&group);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on no body in particular.
    fn points(count: usize) -> Vec<f64> {
        (0..3 * count).map(|k| (k as f64 * 0.7).sin()).collect()
    }

    fn bodies() -> [Body; 3] {
        [
            Body::Plane([0.2, -0.3, 1.9, 0.1]),
            Body::Sphere([0.1, 0.2, -0.3, 0.8]),
            Body::Cylinder([0.1, 0.2, -0.1, 0.3, 1.7, 0.2, 0.6]),
        ]
    }

    #[test]
    fn derivatives_are_those_of_the_distances() {
        let all = points(3);
        for body in bodies() {
            let (kind, values): (&str, Vec<f64>) = match body {
                Body::Plane(q) => ("plane", q.to_vec()),
                Body::Sphere(q) => ("sphere", q.to_vec()),
                Body::Cylinder(q) => ("cylinder", q.to_vec()),
            };
            for point in all.chunks(3) {
                let at = |q: &[f64]| {
                    form_distances(
                        Body::new(kind, q).unwrap(),
                        Image::new(point, 1, 3).unwrap(),
                    )
                    .unwrap()[0]
                };
                let n = values.len() + 1;
                let sums = form_moments(body, Image::new(point, 1, 3).unwrap(), &[1.0]).unwrap();
                let away = at(&values);
                assert!((sums[n * n - 1] - away * away).abs() < 1e-14);
                for k in 0..values.len() {
                    let step = 1e-6;
                    let (mut up, mut down) = (values.clone(), values.clone());
                    up[k] += step;
                    down[k] -= step;
                    let slope = (at(&up) - at(&down)) / (2.0 * step);
                    assert!(
                        (sums[n * (n - 1) + k] - slope * away).abs() < 1e-8,
                        "{kind} {k}"
                    );
                }
            }
        }
    }

    #[test]
    fn sums_do_not_depend_on_the_number_of_points_of_a_block() {
        let all = points(21);
        for body in bodies() {
            let whole = form_moments(body, Image::new(&all, 21, 3).unwrap(), &[1.0; 21]).unwrap();
            let mut sum = vec![0.0; whole.len()];
            for point in all.chunks(3) {
                let part = form_moments(body, Image::new(point, 1, 3).unwrap(), &[1.0]).unwrap();
                sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
            }
            assert!(whole.iter().zip(sum).all(|(a, b)| (a - b).abs() < 1e-12));
        }
    }

    #[test]
    fn groups_are_near_and_different_and_take_all_points_alike() {
        let all = points(400);
        let image = Image::new(&all, 400, 3).unwrap();
        let far = near_groups(image, 4, 50, 0.0, 1).unwrap();
        assert!(far.is_empty());
        let mut taken = vec![0.0f64; 400];
        for reach in [0.35, 9.0] {
            let found = near_groups(image, 4, 5000, reach, 3).unwrap();
            for group in found.chunks(4) {
                for (i, &a) in group.iter().enumerate() {
                    assert!(!group[..i].contains(&a));
                    for &b in &group[..i] {
                        let off: [f64; 3] = std::array::from_fn(|c| {
                            all[3 * a as usize + c] - all[3 * b as usize + c]
                        });
                        assert!(dot(off, off).sqrt() < 2.0 * reach);
                    }
                }
            }
            if reach > 1.0 {
                assert_eq!(found.len(), 20_000);
                found.iter().for_each(|&k| taken[k as usize] += 1.0);
            }
        }
        // Within reach of all, each point is taken 50 times, ± 7.
        let chi: f64 = taken.iter().map(|t| (t - 50.0).powi(2) / 50.0).sum();
        assert!((300.0..510.0).contains(&chi), "{chi}");
    }
}
