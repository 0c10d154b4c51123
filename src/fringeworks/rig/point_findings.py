"""What a large share of pixels without a point says about a rig and its capture."""

from __future__ import annotations

import numpy as np

from fringeworks.types import PointCloud, Reason, Rig

LARGE_SHARE = 0.05
"""Share of the decoded pixels without a point from which on this is reported. Noise beyond 5 σ and
edges of shadows take less than 1 %."""
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
    counts = np.bincount(points.reason.ravel(), minlength=len(Reason))
    decoded = counts[Reason.OK] + sum(counts[reason] for reason in WORDS)
    notes = []
    for reason, (seen, causes, advice) in WORDS.items():
        share = counts[reason] / max(decoded, 1)
        if share > LARGE_SHARE:
            notes.append(f"in {share:.0%} of the decoded pixels {seen}; likely {causes}; {advice}")
    return tuple(notes)


def part_notes(rig: Rig, height_px: int) -> tuple[str, ...]:
    """Return a note where a plan of this height lights only a part of the rig's projector."""
    if height_px == rig.projector.height_px:
        return ()
    return (
        f"the plan lights {height_px} of the projector's {rig.projector.height_px} rows, taken as "
        "its upper part; if it lights another part, points are wrong and rays lie apart",
    )
