//! Matching of object extrema with reference extrema: fringe orders.
//!
//! Counting decides where the counts agree, and the cheapest explanation by dynamic programming
//! where they do not (theory §4).
//!
//! Costs are in periods of change of the displacement between neighbouring extrema. A smooth
//! displacement costs nothing. A spurious pair of extrema must cost less than the slip by one period
//! that taking it for real would bring, and so must a missing pair (an order jump). The numbers are
//! empirical: they were chosen on simulated steps and noise.

use super::extrema::Extremum;

/// Free change of displacement between neighbouring extrema, periods.
///
/// Noise scatters an extremum on a flat or rippled top by about this much.
const SCATTER: f64 = 0.4;

/// Cost of a jump of the fringe order between neighbouring extrema, periods.
const ORDER_JUMP: f64 = 0.75;

/// Cost of an object extremum without a partner, periods.
const UNEXPLAINED: f64 = 0.4;

/// Cost of a displacement of one period: of two otherwise equal explanations the smaller displacement
/// wins, because the background is the reference plane.
const SMALL_DISPLACEMENT: f64 = 0.02;

/// Distance from the guide, periods, beyond which a displacement is of another order: between noise
/// and half a period.
const OFF_GUIDE: f64 = 0.3;

/// Cost per period of a displacement off the guide: more than any slip.
const GUIDE_COST: f64 = 2.0;

/// Successive object extrema that may remain without a partner; bounds the cost of the search.
const MAX_SKIPPED: usize = 3;

/// Largest displacement, periods, that counting alone may explain: beyond, another order is nearer.
const COUNTED_PERIODS: f64 = 0.5;

/// One possible partner of an object extremum, with the cheapest explanation up to it.
#[derive(Clone, Copy)]
struct State {
    reference: usize,
    displacement: f64,
    cost: f64,
    /// Object extremum and state that the explanation continues.
    previous: Option<(usize, usize)>,
}

/// The rows to match, and what their displacement is expected to be.
struct Matcher<'a> {
    reference: &'a [Extremum],
    object: &'a [Extremum],
    period: f64,
    max_displacement: f64,
    guide: Option<&'a [f32]>,
}

/// For every object extremum the index of its reference extremum, or `None`.
///
/// `guide` holds the expected displacement of every sample, px, NaN where there is none.
pub fn match_orders(
    reference: &[Extremum],
    object: &[Extremum],
    period: f64,
    max_displacement: f64,
    guide: Option<&[f32]>,
) -> Vec<Option<usize>> {
    let matcher = Matcher {
        reference,
        object,
        period,
        max_displacement,
        guide,
    };
    if matcher.counting_suffices() {
        return (0..object.len()).map(Some).collect();
    }
    let mut table: Vec<Vec<State>> = Vec::with_capacity(object.len());
    for j in 0..object.len() {
        let states = matcher.states(j, &table);
        table.push(states);
    }
    cheapest_path(&table)
}

impl Matcher<'_> {
    /// Cost of a displacement at an object extremum that is far from the guide.
    fn off_guide(&self, extremum: &Extremum, displacement: f64) -> f64 {
        let Some(guide) = self.guide else { return 0.0 };
        let expected = guide[(extremum.position.round() as usize).min(guide.len() - 1)] as f64;
        // Comparisons with NaN are false: an unknown displacement costs nothing.
        let off = (displacement - expected).abs() / self.period;
        if off > OFF_GUIDE {
            GUIDE_COST * off
        } else {
            0.0
        }
    }

    /// Whether counting explains the row at no cost: as many extrema as the reference has, of the
    /// same kinds, each within half a period of its partner.
    fn counting_suffices(&self) -> bool {
        let pairs = || self.reference.iter().zip(self.object);
        let displacements = || pairs().map(|(r, o)| o.position - r.position);
        self.reference.len() == self.object.len()
            && pairs().all(|(r, o)| r.is_maximum == o.is_maximum)
            && displacements().all(|u| u.abs() <= COUNTED_PERIODS * self.period)
            && displacements()
                .zip(self.object)
                .all(|(u, o)| self.off_guide(o, u) == 0.0)
            && displacements()
                .zip(displacements().skip(1))
                .all(|(a, b)| (a - b).abs() <= SCATTER * self.period)
    }

    /// The possible partners of object extremum `j`; `table` holds those of the extrema before.
    fn states(&self, j: usize, table: &[Vec<State>]) -> Vec<State> {
        let extremum = &self.object[j];
        let first = self
            .reference
            .partition_point(|r| extremum.position - r.position > self.max_displacement);
        let mut states = Vec::new();
        for (i, candidate) in self.reference.iter().enumerate().skip(first) {
            let displacement = extremum.position - candidate.position;
            if displacement < -self.max_displacement {
                break;
            }
            if candidate.is_maximum == extremum.is_maximum {
                let unary = SMALL_DISPLACEMENT * displacement.abs() / self.period
                    + self.off_guide(extremum, displacement);
                states.push(self.cheapest_state(j, i, displacement, unary, table));
            }
        }
        states
    }

    /// The cheapest explanation that ends with reference extremum `i` at object extremum `j`;
    /// `unary` is the cost of this pair alone.
    fn cheapest_state(
        &self,
        j: usize,
        i: usize,
        displacement: f64,
        unary: f64,
        table: &[Vec<State>],
    ) -> State {
        let mut best = State {
            reference: i,
            displacement,
            cost: UNEXPLAINED * j as f64 + unary,
            previous: None,
        };
        for back in 1..=(MAX_SKIPPED + 1).min(j) {
            for (k, state) in table[j - back].iter().enumerate() {
                let jump = if i == state.reference + 1 {
                    0.0
                } else {
                    ORDER_JUMP
                };
                let change = (displacement - state.displacement).abs() / self.period;
                let cost = state.cost
                    + unary
                    + (change - SCATTER).max(0.0)
                    + jump
                    + UNEXPLAINED * (back - 1) as f64;
                if cost < best.cost {
                    best.cost = cost;
                    best.previous = Some((j - back, k));
                }
            }
        }
        best
    }
}

/// Partners along the cheapest explanation of the whole row.
fn cheapest_path(table: &[Vec<State>]) -> Vec<Option<usize>> {
    let n = table.len();
    let mut matched = vec![None; n];
    let mut cursor = table
        .iter()
        .enumerate()
        .flat_map(|(j, states)| {
            let unexplained = UNEXPLAINED * (n - 1 - j) as f64;
            states
                .iter()
                .enumerate()
                .map(move |(k, s)| ((j, k), s.cost + unexplained))
        })
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(at, _)| at);
    while let Some((j, k)) = cursor {
        matched[j] = Some(table[j][k].reference);
        cursor = table[j][k].previous;
    }
    matched
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(positions: &[f64], first_is_maximum: bool) -> Vec<Extremum> {
        positions
            .iter()
            .enumerate()
            .map(|(k, p)| Extremum {
                position: *p,
                value: 0.0,
                is_maximum: (k % 2 == 0) == first_is_maximum,
            })
            .collect()
    }

    #[test]
    fn displaced_row_keeps_its_orders() {
        let reference = row(&[10., 20., 30., 40., 50., 60., 70., 80.], true);
        let object = row(&[10., 20., 34., 48., 60., 66., 71., 80.], true);
        let matched = match_orders(&reference, &object, 20.0, 60.0, None);
        assert_eq!(matched, (0..8).map(Some).collect::<Vec<_>>());
    }

    #[test]
    fn counts_may_differ() {
        let reference = row(&[10., 20., 30., 40., 50., 60., 70., 80.], true);
        // The first maximum lies outside the frame.
        let object = row(&[22., 33., 44., 53., 61., 70., 80.], false);
        let matched = match_orders(&reference, &object, 20.0, 60.0, None);
        assert_eq!(matched, (1..8).map(Some).collect::<Vec<_>>());
        // A spurious pair of extrema on a steep flank.
        let object = row(&[10., 20., 30., 40., 42., 44., 50., 60., 70., 80.], true);
        let matched = match_orders(&reference, &object, 20.0, 60.0, None);
        assert_eq!(matched.iter().flatten().count(), 8);
        assert_eq!(matched.last(), Some(&Some(7)));
    }
}
