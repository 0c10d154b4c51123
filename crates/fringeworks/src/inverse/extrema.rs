//! Extrema of a fringe row, alternating, chosen in the band of the carrier by their prominence.

use super::band::Band;
use crate::spline::RowSpline;

/// A maximum or minimum of a fringe row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extremum {
    /// Sub-pixel position, px.
    pub position: f64,
    /// Value of the row's spline there, counts.
    pub value: f64,
    /// Whether it is a maximum.
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

/// How far from an extremum of the smoothed row that of the row itself may lie, periods: half a
/// fringe's rise.
const SEARCH_PERIODS: f64 = 0.25;

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

/// Extrema of samples whose swing to either neighbour exceeds `prominence` × the local range, and
/// `floor`; the flag is true for maxima.
///
/// The samples are followed with hysteresis: an extremum counts once they have moved away from it by
/// the threshold. Maxima and minima alternate by construction, and ripples below the threshold are
/// ignored.
fn prominent(y: &[f64], period: f64, prominence: f64, floor: f64) -> Vec<(Candidate, bool)> {
    let (block, range) = local_range(y, (RANGE_PERIODS * period).ceil() as usize);
    let mut extrema = Vec::new();
    // An extremum at the first sample is the edge of the frame, not an extremum of the fringe. The
    // last sample never counts, because the row does not move away from it.
    let mut keep = |candidate: Candidate, is_maximum: bool| {
        if candidate.first > 0 {
            extrema.push((candidate, is_maximum));
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

/// The row's own extremum near each one of the smoothed row.
///
/// It is searched within a quarter period, and no further than half way to the neighbours.
fn on_row(row: &RowSpline, smoothed: &[(Candidate, bool)], period: f64) -> Vec<Extremum> {
    let last = row.y.len() - 1;
    let reach = (SEARCH_PERIODS * period).ceil() as usize;
    let middle = |k: usize| (smoothed[k].0.first + smoothed[k].0.last) / 2;
    let mut extrema: Vec<Extremum> = Vec::with_capacity(smoothed.len());
    for (k, (candidate, is_maximum)) in smoothed.iter().enumerate() {
        let mut from = candidate.first.saturating_sub(reach);
        let mut to = (candidate.last + reach).min(last);
        if k > 0 {
            from = from.max((middle(k - 1) + middle(k)).div_ceil(2));
        }
        if k + 1 < smoothed.len() {
            to = to.min((middle(k) + middle(k + 1)) / 2);
        }
        let sign = if *is_maximum { 1.0 } else { -1.0 };
        let mut found = Candidate::new(row.y[from], from);
        for (i, value) in row.y.iter().enumerate().take(to + 1).skip(from + 1) {
            found.update(*value, i, sign);
        }
        // The row goes on beyond its end: the extremum lies outside.
        if found.first == 0 || found.last == last {
            continue;
        }
        let extremum = refine(row, found, *is_maximum);
        // Without a swing between them, both are noise; without both, maxima and minima alternate.
        match extrema.last() {
            Some(before) if sign * (extremum.value - before.value) <= 0.0 => {
                extrema.pop();
            }
            _ => extrema.push(extremum),
        }
    }
    extrema
}

/// Finds the extrema of the fringes of rows.
///
/// They are chosen on the smoothed row (see [`Band`]), so that ripples finer than fringes do not
/// count however prominent they are, and then placed on the row itself.
pub struct Finder {
    band: Band,
    period: f64,
    prominence: f64,
    floor: f64,
}

impl Finder {
    /// `floor` is the least swing in a row that is not smoothed, counts.
    pub fn new(period: f64, prominence: f64, floor: f64) -> Self {
        let band = Band::new(period);
        Self {
            period,
            prominence,
            floor: floor * band.noise_share(),
            band,
        }
    }

    pub fn find(&mut self, row: &RowSpline) -> Vec<Extremum> {
        let step = self.band.step;
        let smoothed = self.band.smooth(row.y);
        let mut chosen = prominent(
            smoothed,
            self.period / step as f64,
            self.prominence,
            self.floor,
        );
        for (candidate, _) in &mut chosen {
            candidate.first *= step;
            candidate.last = candidate.last * step + step - 1;
        }
        on_row(row, &chosen, self.period)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::{uniform_pivots, uniform_slopes};

    fn extrema_of(y: &[f64], period: f64) -> Vec<Extremum> {
        let mut slopes = vec![0.0; y.len()];
        uniform_slopes([y], [&mut slopes], &uniform_pivots(y.len()));
        Finder::new(period, 0.3, 0.0).find(&RowSpline { y, slopes: &slopes })
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
