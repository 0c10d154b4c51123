//! Extrema of a fringe row: alternating, by prominence against the local modulation.

use crate::spline::RowSpline;
use std::collections::VecDeque;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extremum {
    pub position: f64,
    pub value: f64,
    pub is_maximum: bool,
}

/// Longest run of equal samples whose extremum is still looked for on the spline; a longer one is
/// a plateau (quantised flat minimum, saturated maximum) and its middle is taken.
const SHORT_PLATEAU: usize = 2;

/// Largest minus smallest sample within `half` samples of each sample.
fn local_range(y: &[f64], half: usize) -> Vec<f64> {
    let extreme = |sign: f64| -> Vec<f64> {
        let mut window: VecDeque<usize> = VecDeque::new();
        let mut out = Vec::with_capacity(y.len());
        let mut next = 0;
        for i in 0..y.len() {
            while next < y.len() && next <= i + half {
                while window
                    .back()
                    .is_some_and(|j| sign * y[*j] <= sign * y[next])
                {
                    window.pop_back();
                }
                window.push_back(next);
                next += 1;
            }
            while window.front().is_some_and(|j| j + half < i) {
                window.pop_front();
            }
            out.push(y[window[0]]);
        }
        out
    };
    extreme(1.0)
        .iter()
        .zip(extreme(-1.0))
        .map(|(high, low)| high - low)
        .collect()
}

/// The most extreme sample so far, with the first and last place where it was reached.
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

    fn update(&mut self, value: f64, at: usize, sign: f64) {
        if sign * value > sign * self.value {
            *self = Self::new(value, at);
        } else if value == self.value {
            self.last = at;
        }
    }
}

fn refine(row: &RowSpline, found: Candidate, is_maximum: bool) -> Extremum {
    let n = row.y.len();
    let middle = 0.5 * (found.first + found.last) as f64;
    let mut position = middle;
    if found.last - found.first < SHORT_PLATEAU {
        let nearest = (found.first.saturating_sub(1)..=found.last)
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

/// Extrema whose swing to either neighbour exceeds `prominence` × the local range (and `floor`).
///
/// A hysteresis walk: an extremum counts once the row has moved away from it by the threshold, so
/// maxima and minima alternate by construction and ripples below the threshold leave no trace.
pub fn find(row: &RowSpline, period: f64, prominence: f64, floor: f64) -> Vec<Extremum> {
    let y = row.y;
    let range = local_range(y, (0.75 * period).ceil() as usize);
    let mut found = Vec::new();
    // A start that is itself the highest or lowest sample is the edge of the frame, not an extremum
    // of the fringe. (An end never is one: the row has not moved away from it.)
    let mut keep = |candidate: Candidate, is_maximum: bool| {
        if candidate.first > 0 {
            found.push(refine(row, candidate, is_maximum));
        }
    };
    let mut high = Candidate::new(y[0], 0);
    let mut low = high;
    // +1: looking for a maximum, −1: for a minimum, 0: not known yet.
    let mut direction = 0;
    for (i, value) in y.iter().enumerate() {
        let threshold = (prominence * range[i]).max(floor);
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
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::uniform_slopes;

    fn extrema_of(y: &[f64], period: f64) -> Vec<Extremum> {
        let (mut slopes, mut scratch) = (vec![0.0; y.len()], vec![0.0; y.len()]);
        uniform_slopes(y, &mut slopes, &mut scratch);
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
