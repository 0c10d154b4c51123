//! Orders of pixels whose window fits none, from the votes next to them.

use super::field::Field;
use super::{Rules, UNDECIDED};
use rayon::prelude::*;

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

/// The order of an undecided pixel: one that its next neighbours vote for, that its own phases allow,
/// and that a decided pixel of its window continues.
fn continued(field: &Field, decided: &[i32], i: usize, rules: &Rules) -> Option<i32> {
    let (y, x) = (i / field.width(), i % field.width());
    if field.is_borrowed(y, x) {
        return None;
    }
    let near = field.mean(y, x, rules.near_radius())?;
    let vote = field.vote_at(&near, i);
    if vote.others > rules.near_error_rate || !field.is_even(&near) {
        return None;
    }
    let mut offered = false;
    field.for_window(y, x, rules.radius, |there, turns| {
        let known = decided[there] != UNDECIDED;
        offered |= known && field.in_range(i, decided[there] - turns) == vote.order;
    });
    (offered && field.allows(i, vote.order, rules.own_doubt)).then_some(vote.order)
}
