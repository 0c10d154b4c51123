"""What a large share of pixels without a point says about a rig and its capture."""

from __future__ import annotations

import numpy as np

from fringeworks.types import Finding, Pixels, PointCloud, Reason, Rig, reason_counts

LARGE_SHARE = 0.05
"""Share of the decoded pixels without a point from which on this is reported. Noise beyond 5 σ and
edges of shadows take less than 1 %."""
SHORT_BASELINE_MM = 5.0
"""Baseline below which a unit other than mm is likely, mm: two lenses side by side are farther
apart, and in metres a baseline is below 2."""
LARGE_EPIPOLAR_PX = 1.0
"""Median epipolar error of the points from which on it is reported, projector px. Calibrations by
other programs leave 0.3 to 0.9 px. Empirical."""
TOLD_PX = 0.1
"""Epipolar error that neither noise nor the rig explain from which on it is reported, projector px;
ripple and blur of a rig's own captures leave less. Empirical."""
EPIPOLAR = "epipolar error"
"""Kind of the finding about epipolar errors."""
WORDS: dict[Reason, tuple[str, tuple[str, ...], str]] = {
    Reason.RAYS_APART: (
        "the rays of camera and projector pass each other (rays apart)",
        (
            "a device was moved or refocused since the calibration",
            "the columns or rows have wrong fringe orders",
            "the light reached the camera by a reflection",
            "the rig's uncertainty is larger than it states",
        ),
        "measure a known plane, calibrate again, or state the epipolar error that the rig causes",
    ),
    Reason.BEYOND_GEOMETRY: (
        "no point lies in front of both devices (beyond geometry)",
        ("the rig belongs to another set-up", "the fringe orders are wrong"),
        "check which rig file and which plan belong to this capture",
    ),
}
"""For every reason that triangulation gives: what was seen, likely causes, what to do."""


def point_findings(points: PointCloud, rig: Rig, height_px: int) -> tuple[Finding, ...]:
    """Return what points say about their rig and capture.

    Parameters
    ----------
    points : PointCloud
    rig : Rig
        With which the points were computed.
    height_px : int
        Rows of the projector that the plan lights.
    """
    return (
        *unit_findings(rig),
        *_unlit_rows(rig, height_px),
        *_dropped(points),
        *_epipolar(points),
    )


def unit_findings(rig: Rig) -> tuple[Finding, ...]:
    """Return a finding for a rig whose baseline is too short to be in mm."""
    if rig.baseline_mm >= SHORT_BASELINE_MM:
        return ()
    seen = (
        f"camera and projector are {rig.baseline_mm:.3g} mm apart: if the rig's file was in "
        "metres, all lengths are 1000 times too small"
    )
    figures = {"baseline_mm": rig.baseline_mm}
    return (Finding("unit", seen, advice="read it with unit_mm = 1000", figures=figures),)


def _unlit_rows(rig: Rig, height_px: int) -> tuple[Finding, ...]:
    """A finding where a plan of this height lights only a part of the rig's projector."""
    if height_px == rig.projector.height_px:
        return ()
    seen = (
        f"the plan lights {height_px} of the projector's {rig.projector.height_px} rows, taken as "
        "its upper part; if it lights another part, points are wrong and rays lie apart"
    )
    return (Finding("projector rows", seen, figures={"height_px": float(height_px)}),)


def _dropped(points: PointCloud) -> tuple[Finding, ...]:
    """A finding for every reason by which triangulation drops a large share of the pixels."""
    counts = reason_counts(points.reason)
    decoded = int(counts[Reason.OK] + sum(counts[reason] for reason in WORDS))
    found = []
    for reason, (what, causes, advice) in WORDS.items():
        pixels = Pixels(int(counts[reason]), decoded)
        if pixels.share > LARGE_SHARE:
            found.append(
                Finding(
                    reason.name.lower().replace("_", " "),
                    f"in {pixels.share:.0%} of the decoded pixels {what}",
                    causes,
                    advice,
                    severity="warning" if counts[Reason.OK] else "error",
                    figures={"share": pixels.share},
                    pixels=pixels,
                )
            )
    return tuple(found)


def _epipolar(points: PointCloud) -> tuple[Finding, ...]:
    """A finding where the points that were kept have a large epipolar error.

    A rig of another program does not state its uncertainty, so the test takes the scatter of the
    capture, which an error that is alike everywhere does not raise.
    """
    said = any(finding.kind == EPIPOLAR for finding in points.findings)
    if points.residual_px is None or said:
        return ()
    error = points.residual_px[np.isfinite(points.residual_px)]
    usual = float(np.median(np.abs(error))) if error.size else 0.0
    return (_epipolar_error(usual, ""),) if usual > LARGE_EPIPOLAR_PX else ()


def misfit_findings(misfit_px: float, unstated_px: float) -> tuple[Finding, ...]:
    """A finding where noise and rig do not explain the epipolar errors of points.

    Parameters
    ----------
    misfit_px : float
        Median of their magnitudes, px.
    unstated_px : float
        What is not explained, px, of which σ holds the effect.
    """
    if unstated_px < TOLD_PX:
        return ()
    more = (
        f"; noise and the rig explain no more than a half of it, and σ holds {unstated_px:.2g} px"
    )
    return (_epipolar_error(misfit_px, more),)


def _epipolar_error(usual_px: float, more: str) -> Finding:
    return Finding(
        EPIPOLAR,
        f"the epipolar error of the points is {usual_px:.2g} px (median): columns and rows of the "
        f"projector disagree by that much{more}",
        (
            "a device was moved or refocused since the calibration or during the capture",
            "the rig is for another set-up, or its lens distortion is wrong",
        ),
        "measure a known plane, or calibrate again",
        figures={"median_px": usual_px},
    )
