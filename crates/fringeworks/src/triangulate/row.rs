//! One row of the frame, segment by segment, compiled for several instruction sets.

use super::depth::{linearise, newton_step, start, Work};
use super::points::{finish, Context, SegmentPoints};
use super::prepare::Triangulation;
use super::{Axis, Limits, Points, Values, SEGMENT_PIXELS};
use crate::reason;

/// A row to triangulate; the maps of axes and output hold that row only.
pub struct Row<'a> {
    pub rig: &'a Triangulation,
    pub limits: &'a Limits,
    pub index: usize,
    pub x: Option<Axis<'a>>,
    pub y: Option<Axis<'a>>,
    pub out: Points<'a>,
}

/// Decoded maps of one segment; the coordinate is NaN where it was not measured.
pub struct Decoded {
    pub coordinate: Values,
    pub sigma: Values,
    reason: [u8; SEGMENT_PIXELS],
}

impl Decoded {
    const fn new() -> Self {
        Self {
            coordinate: [f32::NAN; SEGMENT_PIXELS],
            sigma: [1.0; SEGMENT_PIXELS],
            reason: [reason::OK; SEGMENT_PIXELS],
        }
    }

    #[inline(always)]
    fn load(&mut self, axis: Axis<'_>, start: usize, n: usize) {
        let range = start..start + n;
        if n < SEGMENT_PIXELS {
            *self = Self::new();
        }
        self.sigma[..n].copy_from_slice(&axis.sigma[range.clone()]);
        self.reason[..n].copy_from_slice(&axis.reason[range.clone()]);
        self.coordinate[..n].copy_from_slice(&axis.coordinate[range]);
        for i in 0..SEGMENT_PIXELS {
            if self.reason[i] != reason::OK {
                self.coordinate[i] = f32::NAN;
            }
        }
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
    match (row.x.is_some(), row.y.is_some()) {
        (true, true) => segments::<true, true, FMA>(row),
        (true, false) => segments::<true, false, FMA>(row),
        _ => segments::<false, true, FMA>(row),
    }
}

#[inline(always)]
fn segments<const X: bool, const Y: bool, const FMA: bool>(mut row: Row<'_>) {
    let width = row.rig.shape().1;
    let projector = &row.rig.projector;
    let spread_variable = &row.rig.spread_variable;
    let (mut points, mut work) = (SegmentPoints::new(), Work::new());
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
        start::<X, Y, FMA>(&segment.rays, projector, (&along_x, &along_y), &mut work);
        for _ in 0..projector.newton_steps {
            newton_step::<X, Y, FMA>(projector, &mut work);
        }
        if projector.newton_steps == 0 {
            linearise::<FMA>(projector, &mut work);
        }
        let context = Context {
            projector,
            spread: &segment.spread,
            spread_variable,
            spread_axis: if spread_variable.along_x {
                &along_x
            } else {
                &along_y
            },
            limits: row.limits,
        };
        finish::<X, Y, FMA>(&context, &work, &mut points);
        let reasons = reasons::<X, Y>(&along_x, &along_y, &points);
        store::<X, Y>(&mut row.out, &points, &reasons, first, n);
    }
}

/// Reason of every pixel: that of the columns first, then of the rows, then of triangulation.
#[inline(always)]
fn reasons<const X: bool, const Y: bool>(
    along_x: &Decoded,
    along_y: &Decoded,
    points: &SegmentPoints,
) -> [u8; SEGMENT_PIXELS] {
    let mut reasons = [0u8; SEGMENT_PIXELS];
    for i in 0..SEGMENT_PIXELS {
        let columns = if X { along_x.reason[i] } else { reason::OK };
        let rows = if Y { along_y.reason[i] } else { reason::OK };
        let decoded = if columns != reason::OK { columns } else { rows };
        let triangulated = points.reason[i] as u8;
        reasons[i] = if decoded != reason::OK {
            decoded
        } else {
            triangulated
        };
    }
    reasons
}

/// Copy the first `n` pixels of a segment into the row's maps.
#[inline(always)]
fn store<const X: bool, const Y: bool>(
    out: &mut Points<'_>,
    points: &SegmentPoints,
    reasons: &[u8; SEGMENT_PIXELS],
    first: usize,
    n: usize,
) {
    let range = first..first + n;
    out.reason[range.clone()].copy_from_slice(&reasons[..n]);
    out.sigma[range.clone()].copy_from_slice(&points.sigma[..n]);
    out.noise[range.clone()].copy_from_slice(&points.noise[..n]);
    if X && Y {
        out.residual[range].copy_from_slice(&points.residual[..n]);
    }
    let mut xyz = [0.0f32; 3 * SEGMENT_PIXELS];
    for i in 0..SEGMENT_PIXELS {
        xyz[3 * i] = points.x[i];
        xyz[3 * i + 1] = points.y[i];
        xyz[3 * i + 2] = points.z[i];
    }
    out.xyz[3 * first..3 * (first + n)].copy_from_slice(&xyz[..3 * n]);
}
