//! Groups of values with similar keys.

use super::quantile::Value;
use crate::{Error, check_length, check_value};

/// Rearrange keys and values in groups of equal size, from the smallest keys to the largest.
///
/// The groups are those of a stable sort by the key, the first ones larger by one where the number
/// of values is no multiple. Within a group the order is arbitrary.
pub fn by_key(key: &[f64], values: &[f64], groups: usize) -> Result<(Vec<f64>, Vec<f64>), Error> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_those_of_a_stable_sort() {
        let key = [2.0, -1.0, 2.0, 0.0, 2.0, -1.0, 5.0];
        let values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        let (_, mut found) = by_key(&key, &values, 3).unwrap();
        for group in [0..3, 3..5, 5..7] {
            found[group].sort_by(f64::total_cmp);
        }
        assert_eq!(found, [1.0, 3.0, 5.0, 0.0, 2.0, 4.0, 6.0]);
    }
}
