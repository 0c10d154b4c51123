//! Check of each row's fringe orders against the rows around it.
//!
//! Rows are matched one by one. A row whose order slipped differs from its neighbours by a period.

use super::Field;
use crate::Reason;
use rayon::prelude::*;

/// Rows above and below a row that it is compared with.
///
/// Seven rows form a majority that a single slipped row cannot break, and still fit a small object.
/// An empirical choice.
const NEIGHBOUR_ROWS: usize = 3;

/// Difference of displacements, in periods, beyond which they are of different orders.
///
/// A slip is a whole period. 0.6 allows for the surface's slope over three rows and for noise.
const SLIP_PERIODS: f64 = 0.6;

/// Clear the pixels whose order is not shared by a majority of the rows around them.
///
/// An edge of the surface along the rows is kept: on either side of it, more than half of the rows
/// belong to the same surface.
pub fn mark_slipped_orders(field: &mut Field, width: usize, period: f64) {
    let height = field.displacement.len() / width;
    if height < 2 * NEIGHBOUR_ROWS + 1 {
        return;
    }
    let before = &field.displacement;
    let slipped: Vec<Vec<usize>> = (0..height)
        .into_par_iter()
        .map_init(
            || (vec![0u8; width], vec![0u8; width]),
            |(near, known), y| {
                near.fill(0);
                known.fill(0);
                let here = &before[y * width..(y + 1) * width];
                let first = y
                    .saturating_sub(NEIGHBOUR_ROWS)
                    .min(height - 2 * NEIGHBOUR_ROWS - 1);
                for row in first..=first + 2 * NEIGHBOUR_ROWS {
                    let other = &before[row * width..(row + 1) * width];
                    for x in 0..width {
                        // Comparisons with NaN are false: it is neither known nor near.
                        known[x] += other[x].is_finite() as u8;
                        near[x] += ((other[x] - here[x]).abs() <= SLIP_PERIODS * period) as u8;
                    }
                }
                (0..width)
                    .filter(|x| here[*x].is_finite() && 2 * near[*x] <= known[*x])
                    .map(|x| y * width + x)
                    .collect()
            },
        )
        .collect();
    for i in slipped.into_iter().flatten() {
        field.displacement[i] = f64::NAN;
        field.sigma[i] = f32::NAN;
        field.modulation_ratio[i] = f32::NAN;
        field.reason[i] = Reason::OrderAmbiguous;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slipped_row_is_cleared_and_an_edge_is_kept() {
        let (height, width) = (20, 8);
        let mut displacement = vec![0.0; height * width];
        // A step of the surface along the rows, and one row that slipped by a period.
        displacement[12 * width..].fill(15.0);
        displacement[5 * width..6 * width].fill(20.0);
        let mut field = Field {
            sigma: vec![1.0; height * width],
            modulation_ratio: vec![1.0; height * width],
            reason: vec![Reason::Ok; height * width],
            displacement,
        };
        mark_slipped_orders(&mut field, width, 20.0);
        for (i, value) in field.displacement.iter().enumerate() {
            assert_eq!(value.is_nan(), i / width == 5, "row {}", i / width);
            assert_eq!(field.reason[i] == Reason::Ok, i / width != 5);
        }
    }
}
