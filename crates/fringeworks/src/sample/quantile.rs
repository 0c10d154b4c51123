//! Quantiles by selection instead of sorting.

use crate::{Error, check_value};

/// A number with a key that is ordered like it.
pub trait Value: Copy + Send + Sync + 'static {
    type Key: Ord + Copy + Send;
    fn key(self) -> Self::Key;
    /// The number of a key.
    fn of(key: Self::Key) -> f64;
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
}
