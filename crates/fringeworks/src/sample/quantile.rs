//! Statistics in order: quantiles by selection instead of sorting, groups of similar keys, and a
//! variance that outliers do not change.

use super::LANES;
use crate::{Error, check_length, check_value};

/// A number with a key that is ordered like it.
pub trait Value: Copy + Send + Sync + 'static {
    /// A whole number of the same size.
    type Key: Ord + Copy + Send;
    /// The key of a number.
    fn key(self) -> Self::Key;
    /// The number of a key.
    fn of(key: Self::Key) -> f64;
    /// Whether it is no number.
    fn nan(self) -> bool;
}

macro_rules! value {
    ($type:ident, $key:ident, $signed:ident) => {
        impl Value for $type {
            type Key = $key;

            /// Bits of floats are ordered by magnitude: negative ones are turned round. Adding zero
            /// makes both zeros equal.
            #[inline(always)]
            fn key(self) -> $key {
                let bits = (self + 0.0).to_bits();
                let sign = (bits as $signed >> ($key::BITS - 1)) as $key;
                bits ^ (sign | 1 << ($key::BITS - 1))
            }

            #[inline(always)]
            fn of(key: $key) -> f64 {
                let sign = !((key as $signed >> ($key::BITS - 1)) as $key);
                f64::from($type::from_bits(key ^ (sign | 1 << ($key::BITS - 1))))
            }

            #[inline(always)]
            fn nan(self) -> bool {
                self.is_nan()
            }
        }
    };
}
value!(f32, u32, i32);
value!(f64, u64, i64);

/// Quantiles of values for rising shares, interpolated linearly between neighbours in order.
///
/// They are NaN where there are no values, or a NaN among them.
///
/// ```
/// use fringeworks::sample::quantiles;
///
/// assert_eq!(quantiles(&[3.0, 1.0, 2.0], &[0.0, 0.25, 1.0])?, [1.0, 1.5, 3.0]);
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn quantiles<T: Value>(values: &[T], shares: &[f64]) -> Result<Vec<f64>, Error> {
    let rising = shares.windows(2).all(|pair| pair[0] <= pair[1]);
    let inside = shares.iter().all(|share| (0.0..=1.0).contains(share));
    check_value(
        "shares",
        rising && inside,
        "rising shares from 0 to 1",
        shares,
    )?;
    let mut nan = false;
    for value in values {
        nan |= value.nan();
    }
    if nan || values.is_empty() {
        return Ok(vec![f64::NAN; shares.len()]);
    }
    let mut keys: Vec<T::Key> = values.iter().map(|value| value.key()).collect();
    let (last, mut start) = (values.len() - 1, 0);
    let found = shares.iter().map(|share| {
        let place = share * last as f64;
        // Keys before the one of the previous share are below it.
        let low = place as usize;
        let (_, key, above) = keys[start..].select_nth_unstable(low - start);
        let (a, t) = (T::of(*key), place - low as f64);
        let b = above.iter().min().map_or(a, |key| T::of(*key));
        start = low;
        between(a, b, t)
    });
    Ok(found.collect())
}

/// The median; NaN where there is none.
///
/// ```
/// use fringeworks::sample::median;
///
/// assert_eq!(median(&[3.0, 1.0, 9.0]), 3.0);
/// assert!(median::<f32>(&[]).is_nan());
/// ```
pub fn median<T: Value>(values: &[T]) -> f64 {
    quantiles(values, &[0.5]).map_or(f64::NAN, |found| found[0])
}

/// The value at a share `t` of the way from `a` to `b`, exact at both ends.
fn between(a: f64, b: f64, t: f64) -> f64 {
    if t <= 0.0 {
        a
    } else if t < 0.5 {
        a + (b - a) * t
    } else {
        b - (b - a) * (1.0 - t)
    }
}

/// Rearrange keys and values in groups of equal size, from the smallest keys to the largest.
///
/// The groups are those of a stable sort by the key, the first ones larger by one where the number
/// of values is no multiple. Within a group the order is arbitrary.
///
/// ```
/// use fringeworks::sample::similar_groups;
///
/// let (keys, _values) = similar_groups(&[5.0, 1.0, 4.0, 2.0], &[50.0, 10.0, 40.0, 20.0], 2)?;
/// assert!(keys[..2].iter().all(|&key| key < 3.0));
/// # Ok::<(), fringeworks::Error>(())
/// ```
pub fn similar_groups(
    key: &[f64],
    values: &[f64],
    groups: usize,
) -> Result<(Vec<f64>, Vec<f64>), Error> {
    check_length("values", values.len(), key.len())?;
    check_value("groups", groups > 0, "one or more", groups)?;
    // The index decides between equal keys: that is the order of a stable sort.
    let mut order: Vec<u128> = (0..)
        .zip(key)
        .map(|(index, key)| u128::from(key.key()) << 64 | index)
        .collect();
    part(&mut order, groups);
    let place = |packed: &u128| *packed as u64 as usize;
    Ok((
        order.iter().map(|k| key[place(k)]).collect(),
        order.iter().map(|k| values[place(k)]).collect(),
    ))
}

/// Part values in groups: halve the groups until there is one.
fn part(order: &mut [u128], groups: usize) {
    if groups < 2 || order.is_empty() {
        return;
    }
    let (below, n) = (groups / 2, order.len());
    let first = below * (n / groups) + below.min(n % groups);
    if first > 0 && first < n {
        order.select_nth_unstable(first);
    }
    let (low, high) = order.split_at_mut(first);
    part(low, below);
    part(high, groups - below);
}

/// What sums of squared residuals are like for a variance of 1.
#[derive(Clone, Copy)]
pub struct Usual {
    /// Their median.
    pub median: f64,
    /// Sums above it do not count.
    pub limit: f64,
    /// Mean of the sums below the limit.
    pub mean: f64,
}

/// Mean of the sums below a limit, in steps that start from the median.
///
/// ```
/// use fringeworks::sample::{Usual, trimmed_variance};
///
/// // Sums of squares of two normal numbers have a median of 1.386; half of them lie below.
/// let usual = Usual { median: 1.386, limit: 9.2, mean: 1.9 };
/// let sums = [0.5, 1.0, 1.386, 2.0, 3.0, 1e6];
/// assert!(trimmed_variance(&sums, usual, 3) < 2.0);
/// ```
pub fn trimmed_variance(square: &[f64], usual: Usual, steps: usize) -> f64 {
    let mut variance = median(square) / usual.median;
    for _ in 0..steps {
        if variance <= 0.0 {
            break;
        }
        variance = mean_below(square, variance * usual.limit) / usual.mean;
    }
    variance
}

#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2+fma"))]
fn mean_below(square: &[f64], limit: f64) -> f64 {
    let (mut sums, mut counts) = ([0.0; LANES], [0.0; LANES]);
    let chunks = square.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        for k in 0..LANES {
            let inner = chunk[k] <= limit;
            sums[k] += if inner { chunk[k] } else { 0.0 };
            counts[k] += if inner { 1.0 } else { 0.0 };
        }
    }
    let inner = || rest.iter().filter(|value| **value <= limit);
    let sum = sums.iter().sum::<f64>() + inner().sum::<f64>();
    sum / (counts.iter().sum::<f64>() + inner().count() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_neighbours_in_order() {
        let values = [3.0, -1.0, 2.0, -4.0];
        let found = quantiles(&values, &[0.0, 0.25, 0.5, 0.5, 1.0]).unwrap();
        assert_eq!(found, [-4.0, -1.75, 0.5, 0.5, 3.0]);
        assert_eq!(median(&[2.5_f32]), 2.5);
        assert!(median(&[1.0, f64::NAN]).is_nan() && median::<f32>(&[]).is_nan());
        assert!(quantiles(&values, &[0.5, 0.1]).is_err());
    }

    #[test]
    fn groups_are_those_of_a_stable_sort() {
        let key = [2.0, -1.0, 2.0, 0.0, 2.0, -1.0, 5.0];
        let values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let (_, mut found) = similar_groups(&key, &values, 3).unwrap();
        for group in [0..3, 3..5, 5..7] {
            found[group].sort_by(f64::total_cmp);
        }
        assert_eq!(found, [1.0, 3.0, 5.0, 0.0, 2.0, 4.0, 6.0]);
    }
}
