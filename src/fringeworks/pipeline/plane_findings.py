"""What two frames on a rig say about the stated plane and the fringe orders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fringeworks.pair.order_range import OrderCheck
from fringeworks.pair.plane_evidence import PlaneEvidence
from fringeworks.rig.ray_depth import inverse_depth
from fringeworks.rig.stated_plane import StatedPlane
from fringeworks.types import (
    BoolMap,
    CoordinateMap,
    Decoded,
    Finding,
    FloatMap,
    Pixels,
    PointCloud,
    Rig,
    region_of,
)

KNOWN_SHARE = 0.5
"""Share of the stated standard deviation that is left from which on the fringes have not told the
plane's distance."""
MIN_LINES = 10
"""Fewest lines with such shadows that are reported: shorter ones belong to small marks and dirt."""
LARGE_SHARE = 0.01
"""Share of the measured pixels outside the depth range from which on this is a warning: noise and
rims put fewer there."""


def plane_findings(
    stated: StatedPlane, evidence: PlaneEvidence, common_mm: FloatMap, points: PointCloud
) -> tuple[Finding, ...]:
    """Findings about a stated plane.

    Parameters
    ----------
    stated, evidence : StatedPlane, PlaneEvidence
    common_mm : (h, w) array
        The part of σ that the plane causes, mm.
    points : PointCloud
    """
    modes, sigma = evidence.modes_mm, np.sqrt(np.diag(evidence.covariance))
    known = np.isfinite(common_mm) & np.isfinite(points.noise_mm)
    common = float(np.median(common_mm[known])) if known.any() else 0.0
    noise = float(np.median(points.noise_mm[known])) if known.any() else 0.0
    figures = {
        "tilt_deg": stated.tilt_deg(modes),
        "tilt_sigma_deg": stated.tilt_deg(sigma),
        "offset_mm": float(modes[0]),
        "offset_sigma_mm": float(sigma[0]),
        "bow_mm": float(np.linalg.norm(modes[3:])),
        "sigma_mm": common,
    }
    found = []
    if evidence.contradicted or (evidence.moved and float(np.linalg.norm(modes)) > 3.0 * noise):
        found.append(_moved(evidence, figures))
    if sigma[0] > KNOWN_SHARE * evidence.sigma_mm and common > noise:
        found.append(
            Finding(
                "plane distance",
                f"the fringes do not tell {_hidden(evidence)} of the stated plane: σ of the points "
                f"has a part of {common:.2g} mm that all of them share, from the plane's own σ of "
                f"{evidence.sigma_mm:.2g} mm; a plane that is off by more is not noticed, and "
                "displaces the points by as much",
                advice="state the plane's σ (plane_sigma_mm), or the pattern (period_px and "
                "bright_px), or decode the plane",
                figures=figures,
                severity="note",
            )
        )
    return tuple(found)


def _hidden(evidence: PlaneEvidence) -> str:
    """What of the plane only its statement tells. Without the pattern's period, a tilt about the
    fringes looks like another period."""
    largest = np.sqrt(np.linalg.eigvalsh(evidence.covariance[1:3, 1:3])[-1])
    tilt = largest > KNOWN_SHARE * evidence.sigma_mm
    return "the distance, and one tilt," if tilt else "the distance"


def _moved(evidence: PlaneEvidence, figures: dict[str, float]) -> Finding:
    """The fringes of the reference support another plane."""
    differs = "contradict the stated plane" if evidence.contradicted else "correct the stated plane"
    return Finding(
        "reference plane",
        f"the fringes of the reference {differs}: they support one that is turned by "
        f"{figures['tilt_deg']:.2f} ± {figures['tilt_sigma_deg']:.2f}°, displaced by "
        f"{figures['offset_mm']:+.2f} ± {figures['offset_sigma_mm']:.2f} mm in the middle of the "
        f"frame and bent by {figures['bow_mm']:.2f} mm; it is used, with its σ",
        causes=(
            "the plane was not stated exactly",
            "the plane or the rig was moved since",
            "the sheet is not flat",
        ),
        advice="measure the plane with the rig, or decode it; σ of the points covers what the "
        "fringes do not tell",
        figures=figures,
    )


def order_findings(
    rig: Rig,
    known: CoordinateMap,
    period_px: float | None,
    shadows: BoolMap,
    orders: OrderCheck | None,
) -> tuple[Finding, ...]:
    """Findings about fringe orders.

    Parameters
    ----------
    rig : Rig
    known : CoordinateMap
        Of the reference plane.
    period_px : float or None
        Period of the fringes in the projector, px.
    shadows : (h, w) bool array
        Shadows that are wider by whole periods than the steps beside them.
    orders : OrderCheck or None
        What a range of depths said; None without one.
    """
    height = None if period_px is None else _period_mm(rig, known, period_px)
    step = "" if height is None else f" ({height:.2g} mm in the middle of the plane)"
    figures = {} if height is None else {"period_mm": height}
    found = [] if orders is None else [_ranged(orders, known, figures)]
    rows = np.count_nonzero(shadows.any(axis=1 if known.axis == "x" else 0))
    if rows >= MIN_LINES:
        found.append(
            Finding(
                "whole periods",
                f"shadows in {rows} lines of the frame are wider than the steps beside them by "
                f"whole fringe periods{step}: a surface beside them may be off by that",
                causes=("a step of a whole period or more", "dark paint that looks like a shadow"),
                advice="give depth_mm shorter than a period, or fringes of another period",
                figures=figures,
                pixels=Pixels(int(shadows.sum()), shadows.size, region_of(shadows)),
            )
        )
    elif orders is None or orders.open.any():
        found.append(
            Finding(
                "whole periods",
                f"steps that differ by a whole fringe period{step} cannot be distinguished: the "
                "orders are those that continue the rim of the frame",
                advice="give a depth range (depth_mm) shorter than a period where the object has "
                "such steps",
                figures=figures,
                severity="note",
            )
        )
    return tuple(found)


def common_order_finding(
    decoded: Decoded, order: int, spread: float
) -> tuple[Decoded, tuple[Finding, ...]]:
    """Say which whole periods a depth range gives to an object that fills the frame.

    Parameters
    ----------
    decoded : Decoded
        With the findings of the pair; those about its zero stay where the range leaves orders open.
    order : int
        Whole periods that were added.
    spread : float
        Standard deviation of these.
    """
    figures = {"periods": float(order), "sigma_periods": spread}
    if spread > 0.0:
        seen = (
            "the object fills the frame, and the depth range is longer than a period: the whole "
            f"periods are {order:+d} ± {spread:.1f}, which is part of σ"
        )
        advice = "give a depth range (depth_mm) shorter than a period"
        return decoded, (Finding("whole periods", seen, advice=advice, figures=figures),)
    seen = (
        "the object fills the frame: the depth range tells the whole periods of the displacement, "
        f"{order:+d}; a camera that moved between the frames would not be noticed"
    )
    kept = tuple(f for f in decoded.findings if f.kind not in ("no background", "moved frame"))
    finding = Finding("whole periods", seen, figures=figures, severity="note")
    return replace(decoded, findings=kept), (finding,)


def _ranged(orders: OrderCheck, known: CoordinateMap, figures: dict[str, float]) -> Finding:
    """What the depth range did."""
    total = known.coordinate_px.size
    moved, lost = (float(v.mean()) for v in (orders.moved, orders.lost))
    return Finding(
        "depth range",
        f"the depth range moved {100 * moved:.1f} % of the pixels by whole periods and removed "
        f"{100 * lost:.1f} %",
        causes=("steps higher than half a period", "a range that does not hold the scene"),
        figures={**figures, "moved_share": moved, "removed_share": lost},
        severity="warning" if lost > LARGE_SHARE else "note",
        pixels=Pixels(int((orders.moved | orders.lost).sum()), total, region_of(orders.moved)),
    )


def _period_mm(rig: Rig, known: CoordinateMap, period_px: float) -> float | None:
    """Depth of one period of the fringes in the middle of the plane, mm."""
    rows, columns = np.nonzero(np.isfinite(known.coordinate_px))
    if not rows.size:
        return None
    middle = rows.size // 2
    place = np.array([[columns[middle], rows[middle]]], np.float64)
    q = float(known.coordinate_px[rows[middle], columns[middle]])
    goals = np.array([q, q + period_px, q - period_px])
    with np.errstate(all="ignore"):
        depth = 1.0 / inverse_depth(rig, np.repeat(place, 3, axis=0), goals, known.axis)
    steps = np.abs(depth[1:] - depth[0])
    steps = steps[np.isfinite(steps) & (depth[1:] > 0)]
    return float(steps.min()) if steps.size else None
