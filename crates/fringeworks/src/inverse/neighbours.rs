//! Rows are matched one by one; a row whose order slipped gives itself away beside its neighbours.

use super::Field;
use crate::reason;
use rayon::prelude::*;

/// Rows above and below that have a say.
const REACH: usize = 3;
/// Displacements further apart than this, in periods, are of different orders.
const SLIP: f64 = 0.6;

/// Clear the pixels whose order no majority of the rows around them shares.
///
/// A surface's own edge along the rows passes: on either side of it at least half of the rows
/// are of the same surface.
pub fn mark_slipped_orders(field: &mut Field, width: usize, period: f64) {
    let height = field.displacement.len() / width;
    if height < 2 * REACH + 1 {
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
                let own = &before[y * width..(y + 1) * width];
                let first = y.saturating_sub(REACH).min(height - 2 * REACH - 1);
                for row in first..=first + 2 * REACH {
                    let other = &before[row * width..(row + 1) * width];
                    for x in 0..width {
                        // Comparisons with NaN are false: it is neither known nor near.
                        known[x] += other[x].is_finite() as u8;
                        near[x] += ((other[x] - own[x]).abs() <= SLIP * period) as u8;
                    }
                }
                (0..width)
                    .filter(|x| own[*x].is_finite() && 2 * near[*x] <= known[*x])
                    .map(|x| y * width + x)
                    .collect()
            },
        )
        .collect();
    for i in slipped.into_iter().flatten() {
        field.displacement[i] = f64::NAN;
        field.sigma[i] = f32::NAN;
        field.gain[i] = f32::NAN;
        field.reason[i] = reason::ORDER_AMBIGUOUS;
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
            gain: vec![1.0; height * width],
            reason: vec![reason::OK; height * width],
            displacement,
        };
        mark_slipped_orders(&mut field, width, 20.0);
        for (i, value) in field.displacement.iter().enumerate() {
            assert_eq!(value.is_nan(), i / width == 5, "row {}", i / width);
            assert_eq!(field.reason[i] == reason::OK, i / width != 5);
        }
    }
}
