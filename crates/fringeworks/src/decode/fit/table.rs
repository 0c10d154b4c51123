//! Phase errors of a response, subtracted from the fitted phase (theory §6).

use super::Fitted;
use crate::decode::BLOCK_PIXELS;
use crate::{Error, check_length};

/// Bins of a table of phase errors, equal steps over a turn.
///
/// Must be the number of the Python side (`fringeworks.signal.response`). A response
/// has twelve harmonics; linear interpolation between 256 bins is wrong by 1 % of the highest.
pub const TABLE_BINS: usize = 256;

/// Phase errors of a response, turns, at the middles of equal bins from −½ on: one row of
/// [`TABLE_BINS`] for each brightness A + B (rising, counts). Empty for none.
#[derive(Clone, Default)]
pub struct Table {
    /// Rows of phase errors, turns.
    pub turns: Vec<f32>,
    /// Brightness A + B of every row, counts.
    pub brightness: Vec<f32>,
}

impl Table {
    pub(super) fn check(&self) -> Result<(), Error> {
        let rows = self.brightness.len();
        check_length("table", self.turns.len(), rows * TABLE_BINS)
    }
}

/// Subtract the table's error, by linear interpolation in phase and brightness.
///
/// The true phase is t − e(t), so that noise of t counts 1 − e'(t) times.
#[inline(always)]
pub fn correct(table: &Table, out: &mut Fitted) {
    let rows = &table.brightness;
    for i in 0..BLOCK_PIXELS {
        let t = out.turns[i];
        if t.is_nan() {
            continue;
        }
        let brightness = out.background[i] + out.power[i].sqrt();
        let above = rows.iter().take_while(|&&row| row < brightness).count();
        let (low, high) = (above.saturating_sub(1), above.min(rows.len() - 1));
        let width = rows[high] - rows[low];
        let part = if width > 0.0 {
            (brightness - rows[low]) / width
        } else {
            0.0
        };
        let at = (t + 0.5) * TABLE_BINS as f32 - 0.5;
        let left = at.floor();
        let share = at - left;
        let k = (left as i32).rem_euclid(TABLE_BINS as i32) as usize;
        let error = |row: usize| {
            let row = &table.turns[row * TABLE_BINS..(row + 1) * TABLE_BINS];
            let step = row[(k + 1) % TABLE_BINS] - row[k];
            [row[k] + share * step, step * TABLE_BINS as f32]
        };
        let (a, b) = (error(low), error(high));
        let [error, slope] = std::array::from_fn(|j| a[j] + part * (b[j] - a[j]));
        out.turns[i] = t - error;
        out.stretch[i] = (1.0 - slope) * (1.0 - slope);
    }
}
