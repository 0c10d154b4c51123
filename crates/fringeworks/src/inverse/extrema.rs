//! Extrema of a fringe row, alternating, chosen by prominence against the local modulation.

use crate::spline::RowSpline;

/// A maximum or minimum of a fringe row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extremum {
    /// Sub-pixel position, px.
    pub position: f64,
    /// Value of the row's spline there, counts.
    pub value: f64,
    pub is_maximum: bool,
}

/// Longest run of equal samples whose extremum is searched on the spline.
///
/// A longer run is a plateau (a quantised flat minimum or a saturated maximum), whose middle is
/// taken.
const SHORT_PLATEAU: usize = 2;

/// Blocks per half window of the local range.
///
/// The range is computed per block, so a window is right to an eighth of its half width, at a cost
/// that does not grow with the window.
const RANGE_BLOCKS: usize = 8;

/// Half the window of the local range, in periods.
///
/// The window of one and a half periods holds a maximum and a minimum wherever it lies.
const RANGE_PERIODS: f64 = 0.75;

/// The length of a block of samples, and for each block the range (largest minus smallest sample)
/// within about `half` samples of it.
fn local_range(y: &[f64], half: usize) -> (usize, Vec<f64>) {
    let block = half.div_ceil(RANGE_BLOCKS);
    let extremes: Vec<(f64, f64)> = y
        .chunks(block)
        .map(|c| {
            c.iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
                    (low.min(*v), high.max(*v))
                })
        })
        .collect();
    let ranges = (0..extremes.len())
        .map(|k| {
            let around = &extremes
                [k.saturating_sub(RANGE_BLOCKS)..(k + RANGE_BLOCKS + 1).min(extremes.len())];
            let low = around.iter().map(|e| e.0).fold(f64::INFINITY, f64::min);
            let high = around.iter().map(|e| e.1).fold(f64::NEG_INFINITY, f64::max);
            high - low
        })
        .collect();
    (block, ranges)
}

/// The most extreme sample so far, with the first and last index where it was reached.
#[derive(Clone, Copy)]
struct Candidate {
    value: f64,
    first: usize,
    last: usize,
}

impl Candidate {
    fn new(value: f64, at: usize) -> Self {
        Self {
            value,
            first: at,
            last: at,
        }
    }

    /// Take a sample into account; `sign` is 1 for maxima and −1 for minima.
    fn update(&mut self, value: f64, at: usize, sign: f64) {
        if sign * value > sign * self.value {
            *self = Self::new(value, at);
        } else if value == self.value {
            self.last = at;
        }
    }
}

/// Position of an extremum on the row's spline, or the middle of its plateau.
fn refine(row: &RowSpline, candidate: Candidate, is_maximum: bool) -> Extremum {
    let n = row.y.len();
    let middle = 0.5 * (candidate.first + candidate.last) as f64;
    let mut position = middle;
    if candidate.last - candidate.first < SHORT_PLATEAU {
        let nearest = (candidate.first.saturating_sub(1)..=candidate.last)
            .filter(|k| k + 1 < n)
            .flat_map(|k| row.stationary_points(k))
            .min_by(|a, b| (a - middle).abs().total_cmp(&(b - middle).abs()));
        if let Some(root) = nearest {
            position = root;
        }
    }
    Extremum {
        position,
        value: row.at(position).0,
        is_maximum,
    }
}

/// Extrema whose swing to either neighbour exceeds `prominence` × the local range, and `floor`.
///
/// The row is followed with hysteresis: an extremum counts once the row has moved away from it by
/// the threshold. Maxima and minima alternate by construction, and ripples below the threshold are
/// ignored.
pub fn find(row: &RowSpline, period: f64, prominence: f64, floor: f64) -> Vec<Extremum> {
    let y = row.y;
    let (block, range) = local_range(y, (RANGE_PERIODS * period).ceil() as usize);
    let mut extrema = Vec::new();
    // An extremum at the first sample is the edge of the frame, not an extremum of the fringe. The
    // last sample never counts, because the row does not move away from it.
    let mut keep = |candidate: Candidate, is_maximum: bool| {
        if candidate.first > 0 {
            extrema.push(refine(row, candidate, is_maximum));
        }
    };
    let mut high = Candidate::new(y[0], 0);
    let mut low = high;
    // +1: searching a maximum, −1: a minimum, 0: not known yet.
    let mut direction = 0;
    for (i, value) in y.iter().enumerate() {
        let threshold = (prominence * range[i / block]).max(floor);
        high.update(*value, i, 1.0);
        low.update(*value, i, -1.0);
        if direction >= 0 && high.value - value > threshold {
            keep(high, true);
            direction = -1;
            low = Candidate::new(*value, i);
            high = low;
        } else if direction <= 0 && value - low.value > threshold {
            keep(low, false);
            direction = 1;
            high = Candidate::new(*value, i);
            low = high;
        }
        if direction < 0 {
            high = Candidate::new(*value, i);
        } else if direction > 0 {
            low = Candidate::new(*value, i);
        }
    }
    extrema
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::{uniform_pivots, uniform_slopes};

    fn extrema_of(y: &[f64], period: f64) -> Vec<Extremum> {
        let mut slopes = vec![0.0; y.len()];
        uniform_slopes(y, &mut slopes, &uniform_pivots(y.len()));
        find(&RowSpline { y, slopes: &slopes }, period, 0.3, 0.0)
    }

    #[test]
    fn cosine_with_offset_start() {
        let y: Vec<f64> = (0..200)
            .map(|i| (std::f64::consts::TAU * (i as f64 - 7.25) / 50.0).cos())
            .collect();
        let found = extrema_of(&y, 50.0);
        assert_eq!(found.len(), 8);
        for (k, e) in found.iter().enumerate() {
            assert!(
                (e.position - (7.25 + 25.0 * k as f64)).abs() < 5e-4,
                "{e:?}"
            );
            assert_eq!(e.is_maximum, k % 2 == 0);
        }
    }

    #[test]
    fn plateau_gives_its_middle_and_ripple_gives_nothing() {
        let mut y: Vec<f64> = (0..100)
            .map(|i| {
                (std::f64::consts::TAU * i as f64 / 50.0)
                    .sin()
                    .clamp(-0.5, 0.5)
            })
            .collect();
        for (i, v) in y.iter_mut().enumerate() {
            if i % 2 == 0 && v.abs() < 0.4 {
                *v += 0.05;
            }
        }
        let found = extrema_of(&y, 50.0);
        let positions: Vec<f64> = found.iter().map(|e| e.position).collect();
        assert_eq!(positions, [12.5, 37.5, 62.5, 87.5]);
    }
}
