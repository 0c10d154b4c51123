//! Orders of pixels whose window fits none, from the votes next to them.

use super::ballot::{Needs, Worker};
use super::field::Field;
use super::{BAND_ROWS, Rules, UNDECIDED, bands};
use rayon::prelude::*;

/// Orders of all pixels, with those that spread from decided ones: an undecided pixel gets the one that
/// its next neighbours vote for, that its own phases allow, and that a decided pixel of its window
/// continues.
pub fn orders(field: &Field, decided: &[i32], rules: &Rules) -> Vec<i32> {
    let mut orders = decided.to_vec();
    let bands = bands(field).zip(orders.par_chunks_mut((BAND_ROWS * field.width()).max(1)));
    let needs = Needs {
        error_rate: rules.near_error_rate,
        misfit: f32::INFINITY,
        doubt: rules.own_doubt,
    };
    bands.for_each_init(Worker::default, |worker, (rows, orders)| {
        let start = rows.start * field.width();
        let undecided = |(k, &order)| order == UNDECIDED && field.is_lit(start + k);
        let asked: Vec<bool> = orders.iter().enumerate().map(undecided).collect();
        if !asked.contains(&true) {
            return;
        }
        worker.band.fill(field, rows.clone(), rules.near_radius());
        let mut voted = vec![];
        let radius = rules.near_radius();
        worker.poll(field, rows, radius, &asked, &needs, |i, order| {
            voted.push((i, order))
        });
        for (i, order) in voted {
            let at = (i / field.width(), i % field.width());
            let slope = worker.band.slope_at(at.0, at.1);
            let mut offered = false;
            field.for_window(at, slope, rules.radius, |there, turns| {
                let known = decided[there] != UNDECIDED;
                offered |= known && field.in_range(i, decided[there] - turns) == order;
            });
            if offered {
                orders[i - start] = order;
            }
        }
    });
    orders
}
