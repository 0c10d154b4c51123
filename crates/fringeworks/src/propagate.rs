//! How errors of points add up in a quantity that changes linearly with them.

use crate::{Error, Image, check_length, check_shape, check_value};
use rayon::prelude::*;

/// Points of one task. Sums of tasks are added in the order of the points, however many threads there are.
const TASK: usize = 16_384;

/// Values that are summed for each group of points.
const PER_GROUP: usize = 4;

/// Largest number of groups: each task has sums of all of them.
const MOST_GROUPS: usize = 4096;

/// Points and their errors, of one length n.
#[derive(Clone, Copy)]
pub struct Errors<'a> {
    /// Derivative of each point by its measured value, (n, 3).
    pub by_value: Image<'a, f64>,
    /// Standard deviation of the value that is independent from point to point.
    pub noise: &'a [f64],
    /// Standard deviation that the points of a group have in common.
    pub common: &'a [f64],
    /// Error that all points have in common, with its sign.
    pub blur: &'a [f64],
    /// Number of each point's group.
    pub group: &'a [i64],
}

/// Sums over points, and over those of each group.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums {
    /// Variance of the quantity by noise.
    pub variance: f64,
    /// Change of the quantity by blur.
    pub blur: f64,
    /// Of each group: the change of the quantity by the common error, and the weighted directions, x, y and z.
    pub groups: Vec<[f64; PER_GROUP]>,
}

impl Sums {
    fn new(groups: usize) -> Self {
        Self {
            variance: 0.0,
            blur: 0.0,
            groups: vec![[0.0; PER_GROUP]; groups],
        }
    }

    fn add(&mut self, other: &Self) {
        self.variance += other.variance;
        self.blur += other.blur;
        for (sum, part) in self.groups.iter_mut().zip(&other.groups) {
            for k in 0..PER_GROUP {
                sum[k] += part[k];
            }
        }
    }
}

/// Sums of the errors of a quantity that changes by `weights` for points that move along `directions`: one
/// (1, 3) for all points, or one for each, (n, 3).
///
/// ```
/// use fringeworks::Image;
/// use fringeworks::propagate::{Errors, error_sums};
///
/// let errors = Errors {
///     by_value: Image::new(&[0.0, 0.0, 1.0], 1, 3)?,
///     noise: &[3.0],
///     common: &[5.0],
///     blur: &[7.0],
///     group: &[0],
/// };
/// let sums = error_sums(errors, &[2.0], Image::new(&[0.0, 0.0, 1.0], 1, 3)?, 1)?;
/// assert_eq!((sums.variance, sums.blur, sums.groups[0]), (36.0, 14.0, [10.0, 0.0, 0.0, 2.0]));
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn error_sums(
    errors: Errors,
    weights: &[f64],
    directions: Image<f64>,
    groups: usize,
) -> Result<Sums, Error> {
    let n = weights.len();
    check_shape("by_value", errors.by_value.shape(), (n, 3))?;
    check_length("noise", errors.noise.len(), n)?;
    check_length("common", errors.common.len(), n)?;
    check_length("blur", errors.blur.len(), n)?;
    check_length("group", errors.group.len(), n)?;
    let rows = if directions.height() == 1 { 1 } else { n };
    check_shape("directions", directions.shape(), (rows, 3))?;
    check_value("groups", groups <= MOST_GROUPS, "4096 or fewer", groups)?;
    let inside = errors
        .group
        .iter()
        .all(|&k| (0..groups as i64).contains(&k));
    check_value("group", inside, "numbers of groups", groups)?;
    let starts: Vec<usize> = (0..n).step_by(TASK).collect();
    let parts: Vec<Sums> = starts
        .par_iter()
        .map(|&start| part(&errors, weights, &directions, groups, start))
        .collect();
    let mut sums = Sums::new(groups);
    parts.iter().for_each(|part| sums.add(part));
    Ok(sums)
}

/// The sums over the points of one task.
fn part(errors: &Errors, weights: &[f64], directions: &[f64], groups: usize, start: usize) -> Sums {
    let mut sums = Sums::new(groups);
    let one = directions.len() == 3;
    for k in start..(start + TASK).min(weights.len()) {
        let at = if one { 0 } else { 3 * k };
        let d = &directions[at..at + 3];
        let v = &errors.by_value[3 * k..3 * k + 3];
        let weight = weights[k];
        let change = weight * (v[0] * d[0] + v[1] * d[1] + v[2] * d[2]);
        let noise = change * errors.noise[k];
        sums.variance += noise * noise;
        sums.blur += change * errors.blur[k];
        let group = &mut sums.groups[errors.group[k] as usize];
        group[0] += change * errors.common[k];
        for axis in 0..3 {
            group[1 + axis] += weight * d[axis];
        }
    }
    sums
}
