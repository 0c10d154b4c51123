"""What a watched rig has done, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fringeworks.rig.drift_learning import Said
from fringeworks.rig.scan_evidence import FOCUS_SHARE, ROTATION_DEG, TRANSLATION_MM
from fringeworks.types import Finding, FloatMap

GROUPS = {
    "rotation": (slice(0, 3), ROTATION_DEG, "°"),
    "translation across the baseline": (slice(3, 5), TRANSLATION_MM, " mm"),
    "camera focus": (slice(5, 6), 100.0 * FOCUS_SHARE, " %"),
    "projector focus": (slice(6, 7), 100.0 * FOCUS_SHARE, " %"),
}
"""Causes of a drift: their modes, and the size of a unit in the unit that is told."""
EXPLAINED = 0.9
"""Share of the evidence for a drift from which on one cause explains it."""
REST = (
    "a device, its mount or the plate between them was knocked",
    "temperature has moved it",
    "a lens was refocused",
)
"""Causes of a rig that has moved."""


def likely_causes(units: FloatMap, said: Said) -> tuple[str, ...]:
    """Name the causes each of which alone explains a change.

    Parameters
    ----------
    units : (r, 7) array
        Units of all modes, in the coordinates of the evidence.
    said : Said
        Evidence on the change.
    """

    def explained(columns: slice) -> tuple[float, FloatMap]:
        own = units[:, columns]
        push = own.T @ said.score
        change = np.linalg.lstsq(own.T @ said.information @ own, push, rcond=None)[0]
        return float(push @ change), change

    whole, _ = explained(slice(0, units.shape[1]))
    found = []
    for name, (columns, unit, suffix) in GROUPS.items():
        square, change = explained(columns)
        if square > EXPLAINED * whole:
            size = unit * float(np.linalg.norm(change))
            found.append((-square, f"{name} by about {size:.2g}{suffix}"))
    return tuple(text for _, text in sorted(found))


def moved_finding(name: str, since: int, excess: float, causes: Sequence[str]) -> Finding:
    """A rig that has moved."""
    return Finding(
        "rig moved",
        f"{name}: the epipolar errors of the last {since} scans differ from those that the rig was "
        f"learnt from, by {excess:.1f} times the limit",
        tuple(causes) or REST,
        "check it with a board (rig check --adjust), or calibrate again, and begin a new log",
        figures={"scans": float(since), "excess": excess},
        severity="error",
    )


def suspect_finding(name: str, excess: float) -> Finding:
    """A scan that differs from the others."""
    return Finding(
        "scan differs",
        f"{name}: its epipolar errors differ from those that the rig was learnt from, by "
        f"{excess:.1f} times the limit; the next scan decides",
        ("something moved during this scan", "the rig was knocked before it"),
        "scan again",
        figures={"excess": excess},
    )


def unusual_findings(names: Sequence[str]) -> tuple[Finding, ...]:
    """First scans that the rig was not learnt from."""
    if not names:
        return ()
    return (
        Finding(
            "scan differs",
            f"{', '.join(names)}: differs from the other first scans; the rig is learnt without it",
            ("something moved during this scan",),
            figures={"scans": float(len(names))},
        ),
    )


def learning_finding(known: int, baseline: int) -> Finding:
    """A watch that has begun."""
    return Finding(
        "learning",
        f"the rig is learnt from {baseline} scans, of which {known} are there; no drift is looked "
        "for before",
        figures={"scans": float(known), "baseline": float(baseline)},
        severity="note",
    )


def blind_finding(noticeable: Mapping[str, float]) -> Finding:
    """What the scans of this rig do not show."""
    along = "translation along the baseline"
    seen = [
        f"{name.split(',')[0]} {size:.2g} {name.split(', ')[1]}"
        for name, size in noticeable.items()
        if np.isfinite(size)
    ]
    told = ", ".join(seen) if seen else "none"
    return Finding(
        "noticeable",
        f"changes that are found within three scans, in 9 of 10 cases: {told}; a {along} is never "
        "seen, as the rays still meet: it changes the scale of the points",
        advice="a board or a part of known length shows the scale",
        severity="note",
    )
