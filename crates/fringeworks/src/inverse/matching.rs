//! Which extremum of the object row is which extremum of the reference row: fringe order by
//! counting, where the counts agree, and by the cheapest explanation where they do not.

use super::extrema::Extremum;

/// Costs of an explanation, in units of "one period of change between neighbours". A smooth
/// displacement is free. A spurious pair of extrema must cost less than the slip by one period
/// that taking it for real would bring, and so must a pair that is missing (an order jump). Of two
/// explanations that are otherwise equal the one with the smaller displacement wins: the
/// background is the reference plane.
/// Change of displacement between neighbours, in periods, that the scatter of an extremum on a
/// flat or rippled top explains by itself.
const SCATTER: f64 = 0.4;
const ORDER_JUMP: f64 = 0.75;
const UNEXPLAINED: f64 = 0.4;
const SMALL_DISPLACEMENT: f64 = 0.02;
/// A displacement further than this from the expected one, in periods, is of another order …
const OFF_GUIDE: f64 = 0.3;
/// … and costs this much a period: more than any slip.
const GUIDE: f64 = 2.0;
/// Object extrema that may be left unexplained in a row.
const MAX_SKIP: usize = 3;

#[derive(Clone, Copy)]
struct State {
    reference: usize,
    displacement: f64,
    cost: f64,
    previous: Option<(usize, usize)>,
}

/// Whether counting alone explains the row at no cost that another explanation could undercut: as
/// many extrema as the reference has, of the same kinds, each within half a period of its own.
fn one_to_one(
    reference: &[Extremum],
    object: &[Extremum],
    period: f64,
    off_guide: impl Fn(&Extremum, f64) -> f64,
) -> bool {
    let displacements = || {
        reference
            .iter()
            .zip(object)
            .map(|(r, o)| o.position - r.position)
    };
    reference.len() == object.len()
        && reference
            .iter()
            .zip(object)
            .all(|(r, o)| r.is_maximum == o.is_maximum)
        && displacements().all(|u| u.abs() <= 0.5 * period)
        && displacements()
            .zip(object)
            .all(|(u, o)| off_guide(o, u) == 0.0)
        && displacements()
            .zip(displacements().skip(1))
            .all(|(a, b)| (a - b).abs() <= SCATTER * period)
}

/// For every object extremum the index of its reference extremum, or `None`. `guide` holds the
/// expected displacement of every sample, NaN where there is none.
pub fn match_orders(
    reference: &[Extremum],
    object: &[Extremum],
    period: f64,
    max_displacement: f64,
    guide: Option<&[f32]>,
) -> Vec<Option<usize>> {
    let off_guide = |extremum: &Extremum, displacement: f64| -> f64 {
        let Some(guide) = guide else { return 0.0 };
        let expected = guide[(extremum.position.round() as usize).min(guide.len() - 1)] as f64;
        // Comparisons with NaN are false: it costs nothing.
        let off = (displacement - expected).abs() / period;
        if off > OFF_GUIDE {
            GUIDE * off
        } else {
            0.0
        }
    };
    if one_to_one(reference, object, period, off_guide) {
        return (0..object.len()).map(Some).collect();
    }
    let mut table: Vec<Vec<State>> = Vec::with_capacity(object.len());
    for (j, extremum) in object.iter().enumerate() {
        let first =
            reference.partition_point(|r| extremum.position - r.position > max_displacement);
        let mut states = Vec::new();
        for (i, candidate) in reference.iter().enumerate().skip(first) {
            let displacement = extremum.position - candidate.position;
            if displacement < -max_displacement {
                break;
            }
            if candidate.is_maximum != extremum.is_maximum {
                continue;
            }
            let own = SMALL_DISPLACEMENT * displacement.abs() / period
                + off_guide(extremum, displacement);
            let mut best = State {
                reference: i,
                displacement,
                cost: UNEXPLAINED * j as f64 + own,
                previous: None,
            };
            for back in 1..=(MAX_SKIP + 1).min(j) {
                for (k, state) in table[j - back].iter().enumerate() {
                    let jump = if i == state.reference + 1 {
                        0.0
                    } else {
                        ORDER_JUMP
                    };
                    let cost = state.cost
                        + own
                        + ((displacement - state.displacement).abs() / period - SCATTER).max(0.0)
                        + jump
                        + UNEXPLAINED * (back - 1) as f64;
                    if cost < best.cost {
                        best.cost = cost;
                        best.previous = Some((j - back, k));
                    }
                }
            }
            states.push(best);
        }
        table.push(states);
    }
    let mut matched = vec![None; object.len()];
    let mut cursor = table
        .iter()
        .enumerate()
        .flat_map(|(j, states)| {
            let left_over = UNEXPLAINED * (object.len() - 1 - j) as f64;
            states
                .iter()
                .enumerate()
                .map(move |(k, s)| ((j, k), s.cost + left_over))
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
        // The first maximum left the frame.
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
