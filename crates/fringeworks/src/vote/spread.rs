//! Orders of pixels whose window fits none, from the votes next to them.

use super::field::Field;
use super::{Rules, UNDECIDED};
use rayon::prelude::*;

/// Pixels from the middle of the window of next neighbours to its edges.
const NEXT: usize = 1;

/// Most different orders that the votes next to a pixel may have: a pixel sees two surfaces, or three in
/// a corner.
const MOST_ORDERS: usize = 3;

/// Orders of all pixels, with those that spread from decided ones.
pub fn orders(field: &Field, decided: &[i32], rules: &Rules) -> Vec<i32> {
    (0..field.len())
        .into_par_iter()
        .map(|i| {
            if decided[i] != UNDECIDED || !field.is_lit(i) {
                return decided[i];
            }
            continued(field, decided, i, rules).unwrap_or(UNDECIDED)
        })
        .collect()
}

/// The order of an undecided pixel: one that decided pixels of its window continue, and that its next
/// neighbours and its own phases find the best.
fn continued(field: &Field, decided: &[i32], i: usize, rules: &Rules) -> Option<i32> {
    let (y, x) = (i / field.width(), i % field.width());
    let mut offered: Vec<i32> = Vec::with_capacity(MOST_ORDERS);
    field.for_window(y, x, rules.radius, |there, turns| {
        if decided[there] == UNDECIDED {
            return;
        }
        let order = field.in_range(i, decided[there] - turns);
        if !offered.contains(&order) {
            offered.push(order);
        }
    });
    if offered.is_empty() || offered.len() > MOST_ORDERS {
        return None;
    }
    let mean = field.mean(y, x, NEXT)?;
    let weights = field.weights(&mean);
    let misfit = |order: i32| field.misfit(&mean, &weights, order);
    let order = *offered
        .iter()
        .min_by(|a, b| misfit(**a).total_cmp(&misfit(**b)))?;
    let best = field.vote_at(&mean, i);
    // Without another order on offer, the votes next to the pixel are the evidence.
    let apart = -2.0 * rules.error_rate.ln();
    let clear = |other: &i32| *other == order || misfit(*other) - misfit(order) >= apart;
    let fits = misfit(order) <= best.misfit + rules.own_doubt;
    (fits && offered.iter().all(clear) && field.allows(i, order, rules.own_doubt)).then_some(order)
}
