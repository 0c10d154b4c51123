//! One row of the frame, segment by segment, compiled for several instruction sets.

use super::lens::MAX_NEWTON_STEPS;
use super::points::{Constants, SegmentPoints, points};
use super::prepare::Triangulation;
use super::{Axis, Limits, Points, SEGMENT_PIXELS, Values};
use crate::Reason;

/// A row to triangulate; the maps of axes and output hold that row only.
pub struct Row<'a> {
    pub rig: &'a Triangulation,
    pub limits: &'a Limits,
    pub index: usize,
    pub x: Option<Axis<'a>>,
    pub y: Option<Axis<'a>>,
    pub out: Points<'a>,
}

/// Decoded maps of one segment.
#[repr(align(64))]
pub struct Decoded {
    pub coordinate: Values,
    pub sigma: Values,
    pub reason: [u8; SEGMENT_PIXELS],
}

impl Decoded {
    const fn new() -> Self {
        Self {
            coordinate: [f32::NAN; SEGMENT_PIXELS],
            sigma: [1.0; SEGMENT_PIXELS],
            reason: [Reason::Ok as u8; SEGMENT_PIXELS],
        }
    }

    #[inline(always)]
    fn load(&mut self, axis: Axis<'_>, start: usize, n: usize) {
        if n < SEGMENT_PIXELS {
            *self = Self::new();
        }
        copy::<SEGMENT_PIXELS, _>(&mut self.sigma, &axis.sigma[start..start + n]);
        copy::<SEGMENT_PIXELS, _>(&mut self.reason, &axis.reason[start..start + n]);
        copy::<SEGMENT_PIXELS, _>(&mut self.coordinate, &axis.coordinate[start..start + n]);
    }
}

/// Copy the shorter of two slices, of `N` values at most. `N` values are a few registers; only the end
/// of a row is worth a call of the system's function.
#[inline(always)]
fn copy<const N: usize, T: Copy>(to: &mut [T], from: &[T]) {
    let n = to.len().min(from.len());
    match (to.first_chunk_mut(), from.first_chunk()) {
        (Some(to), Some(from)) if n == N => {
            let (to, from): (&mut [T; N], &[T; N]) = (to, from);
            *to = *from;
        }
        _ => to[..n].copy_from_slice(&from[..n]),
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+fma",
    "x86_64+avx2+fma"
))]
pub fn triangulate_row(row: Row<'_>) {
    if multiversion::target::target_cfg_f!(target_feature = "fma") {
        with_axes::<true>(row);
    } else {
        with_axes::<false>(row);
    }
}

#[inline(always)]
fn with_axes<const FMA: bool>(row: Row<'_>) {
    let main_x = row.rig.spread_variable.along_x;
    match (row.x.is_some(), row.y.is_some(), main_x) {
        (true, true, true) => with_steps::<true, true, true, FMA>(row),
        (true, true, false) => with_steps::<true, true, false, FMA>(row),
        (true, false, _) => with_steps::<true, false, true, FMA>(row),
        _ => with_steps::<false, true, false, FMA>(row),
    }
}

/// One step is enough for nearly all lenses; more than needed do no harm.
#[inline(always)]
fn with_steps<const X: bool, const Y: bool, const MAIN_X: bool, const FMA: bool>(row: Row<'_>) {
    match row.rig.projector.newton_steps {
        1 => segments::<X, Y, MAIN_X, 1, FMA>(row),
        2 => segments::<X, Y, MAIN_X, 2, FMA>(row),
        _ => segments::<X, Y, MAIN_X, MAX_NEWTON_STEPS, FMA>(row),
    }
}

#[inline(always)]
fn segments<
    const X: bool,
    const Y: bool,
    const MAIN_X: bool,
    const STEPS: usize,
    const FMA: bool,
>(
    mut row: Row<'_>,
) {
    let width = row.rig.shape().1;
    let constants = Constants::new(row.rig, row.limits);
    let mut found = SegmentPoints::new();
    let (mut along_x, mut along_y) = (Decoded::new(), Decoded::new());
    for (k, segment) in row.rig.segments_of(row.index).iter().enumerate() {
        let first = k * SEGMENT_PIXELS;
        let n = SEGMENT_PIXELS.min(width - first);
        if let (true, Some(axis)) = (X, row.x) {
            along_x.load(axis, first, n);
        }
        if let (true, Some(axis)) = (Y, row.y) {
            along_y.load(axis, first, n);
        }
        let axes = (&along_x, &along_y);
        points::<X, Y, MAIN_X, STEPS, FMA>(&constants, segment, axes, &mut found);
        store::<X, Y>(&mut row.out, &found, first, n);
    }
}

/// Copy the first `n` pixels of a segment into the row's maps.
#[inline(always)]
fn store<const X: bool, const Y: bool>(
    out: &mut Points<'_>,
    points: &SegmentPoints,
    first: usize,
    n: usize,
) {
    let range = first..first + n;
    copy::<SEGMENT_PIXELS, _>(&mut out.reason[range.clone()], &points.reason);
    copy::<SEGMENT_PIXELS, _>(&mut out.sigma[range.clone()], &points.sigma);
    copy::<SEGMENT_PIXELS, _>(&mut out.noise[range.clone()], &points.noise);
    if X && Y {
        copy::<SEGMENT_PIXELS, _>(&mut out.residual[range], &points.residual);
    }
    let mut xyz = [0.0; 3 * SEGMENT_PIXELS];
    for i in 0..SEGMENT_PIXELS {
        xyz[3 * i] = points.x[i];
        xyz[3 * i + 1] = points.y[i];
        xyz[3 * i + 2] = points.z[i];
    }
    copy::<{ 3 * SEGMENT_PIXELS }, _>(&mut out.xyz[3 * first..3 * (first + n)], &xyz);
}
