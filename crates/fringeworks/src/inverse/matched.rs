//! Parts of the object row, each matched with a part of the reference.

use super::extrema::Extremum;
use crate::spline::RowSpline;
use std::ops::RangeInclusive;

/// A part of the object row that belongs to one part of the reference.
pub struct MatchedPart {
    /// First and last position on the object row, px.
    from: f64,
    to: f64,
    /// Index of the reference's part.
    pub part: usize,
    /// Object intensity = offset + modulation ratio × reference intensity.
    pub offset: f64,
    pub modulation_ratio: f64,
}

impl MatchedPart {
    /// The pixels of the part in a row of `width` px.
    pub fn pixels(&self, width: usize) -> RangeInclusive<usize> {
        let first = self.from.ceil().max(0.0) as usize;
        let last = (self.to.floor() as usize).min(width - 1);
        first..=last
    }
}

/// Cut the object row at its matched extrema. Parts whose order is not certain are left out.
pub fn matched_parts(
    d: &RowSpline,
    d_extrema: &[Extremum],
    s_extrema: &[Extremum],
    orders: &[Option<usize>],
    albedo_tolerance: f64,
) -> Vec<MatchedPart> {
    let matched: Vec<(&Extremum, usize)> = d_extrema
        .iter()
        .zip(orders)
        .filter_map(|(e, order)| order.map(|i| (e, i)))
        .collect();
    let mut parts: Vec<MatchedPart> = matched
        .windows(2)
        .filter(|w| w[1].1 == w[0].1 + 1)
        .map(|w| {
            let ((from, i), (to, k)) = (w[0], w[1]);
            between(
                from,
                to,
                &s_extrema[i],
                &s_extrema[k],
                i + 1,
                albedo_tolerance,
            )
        })
        .collect();
    let ends = end_parts(&matched, &parts, (d.y.len() - 1) as f64);
    parts.extend(ends);
    parts
}

/// The part between two extrema of the object, with its albedo where that differs from 1.
fn between(
    from: &Extremum,
    to: &Extremum,
    s_from: &Extremum,
    s_to: &Extremum,
    part: usize,
    albedo_tolerance: f64,
) -> MatchedPart {
    let (s_from, s_to) = (s_from.value, s_to.value);
    let range = s_to - s_from;
    let difference = (from.value - s_from).abs().max((to.value - s_to).abs());
    let (offset, modulation_ratio) = if difference > albedo_tolerance * range.abs() {
        let ratio = (to.value - from.value) / range;
        (from.value - ratio * s_from, ratio)
    } else {
        (0.0, 1.0)
    };
    MatchedPart {
        from: from.position,
        to: to.position,
        part,
        offset,
        modulation_ratio,
    }
}

/// The parts before the first and behind the last matched extremum.
///
/// They have one extremum only, so they take the albedo of their neighbour.
fn end_parts(matched: &[(&Extremum, usize)], parts: &[MatchedPart], end: f64) -> Vec<MatchedPart> {
    let mut ends = Vec::new();
    if let (Some((e, order)), Some(next)) = (matched.first(), parts.first()) {
        ends.push(MatchedPart {
            from: 0.0,
            to: e.position,
            part: *order,
            ..*next
        });
    }
    if let (Some((e, order)), Some(before)) = (matched.last(), parts.last()) {
        ends.push(MatchedPart {
            from: e.position,
            to: end,
            part: order + 1,
            ..*before
        });
    }
    ends
}
