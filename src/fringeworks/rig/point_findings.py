"""What a large share of pixels without a point says about a rig and its capture."""

from __future__ import annotations

import numpy as np

from fringeworks.types import PointCloud, Reason, Rig, reason_counts

LARGE_SHARE = 0.05
"""Share of the decoded pixels without a point from which on this is reported. Noise beyond 5 σ and
edges of shadows take less than 1 %."""
SHORT_BASELINE_MM = 5.0
"""Baseline below which a unit other than mm is likely, mm: two lenses side by side are farther
apart, and in metres a baseline is below 2."""
LARGE_EPIPOLAR_PX = 1.0
"""Median epipolar error of the points from which on it is reported, projector px. Calibrations by
other programs leave 0.3 to 0.9 px. Empirical."""
WORDS = {
    Reason.RAYS_APART: (
        "the rays of camera and projector pass each other (rays apart)",
        "a device was moved or refocused since the calibration, the columns or rows have wrong "
        "fringe orders, the light reached the camera by a reflection, or the rig's uncertainty is "
        "larger than it states",
        "measure a known plane, calibrate again, or state the epipolar error that the rig causes",
    ),
    Reason.BEYOND_GEOMETRY: (
        "no point lies in front of both devices (beyond geometry)",
        "the rig belongs to another set-up, or the fringe orders are wrong",
        "check which rig file and which plan belong to this capture",
    ),
}
"""For every reason that triangulation gives: what was seen, likely causes, what to do."""


def point_notes(points: PointCloud) -> tuple[str, ...]:
    """Return a note for every reason by which triangulation drops a large share of the pixels."""
    counts = reason_counts(points.reason)
    decoded = counts[Reason.OK] + sum(counts[reason] for reason in WORDS)
    notes = []
    for reason, (seen, causes, advice) in WORDS.items():
        share = counts[reason] / max(decoded, 1)
        if share > LARGE_SHARE:
            notes.append(f"in {share:.0%} of the decoded pixels {seen}; likely {causes}; {advice}")
    return (*notes, *_epipolar_note(points))


def _epipolar_note(points: PointCloud) -> tuple[str, ...]:
    """A note where the points that were kept have a large epipolar error.

    A rig of another program does not state its uncertainty, so the test takes the scatter of the
    capture, which an error that is alike everywhere does not raise.
    """
    if points.residual_px is None:
        return ()
    error = points.residual_px[np.isfinite(points.residual_px)]
    usual = float(np.median(np.abs(error))) if error.size else 0.0
    if usual <= LARGE_EPIPOLAR_PX:
        return ()
    return (
        f"the epipolar error of the points is {usual:.2g} px (median): columns and rows of the "
        "projector disagree by that much; likely a device was moved or refocused since the "
        "calibration or during the capture, or the rig is for another set-up; measure a known "
        "plane, or calibrate again",
    )


def unit_notes(rig: Rig) -> tuple[str, ...]:
    """Return a note for a rig whose baseline is too short to be in mm."""
    if rig.baseline_mm >= SHORT_BASELINE_MM:
        return ()
    return (
        f"camera and projector are {rig.baseline_mm:.3g} mm apart: if the rig's file was in "
        "metres, all lengths are 1000 times too small; read it with unit_mm = 1000",
    )


def part_notes(rig: Rig, height_px: int) -> tuple[str, ...]:
    """Return a note where a plan of this height lights only a part of the rig's projector."""
    if height_px == rig.projector.height_px:
        return ()
    return (
        f"the plan lights {height_px} of the projector's {rig.projector.height_px} rows, taken as "
        "its upper part; if it lights another part, points are wrong and rays lie apart",
    )
