"""What is wrong with a calibration, in words: causes with figures, worst first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import spatial

from fringeworks.rig.calibration.calibrate import Calibration, tilts_deg, unmoved
from fringeworks.types import Axis, FloatMap

USUAL_POSES = 10
TILT_DEG = 20.0
"""Largest angle between boards below which focal lengths are weakly determined."""
COVERED = 0.35
"""Share of a frame that corners should span."""
ODD_POSE = 2.5
"""A pose stands out whose residual is this many times the median of all."""
RIPPLE = 10.0
"""Standard deviations, and ..."""
RIPPLE_PX = 0.03
"""... projector px beyond which coordinates follow the fringes."""
BENT = 6.0
"""Standard deviations, and ..."""
BENT_SHARE = 1e-4
"""... share of the board's size beyond which it is not flat."""
WEAK_FOCAL = 0.003
"""Relative standard deviation of a focal length that is worth a word."""


@dataclass(frozen=True)
class Finding:
    """One thing that makes a calibration worse than it could be."""

    cause: str
    """A short name: pose, corners, coverage, ripple, board, poses, tilt, weak, skipped."""
    message: str


def pose_figures(calibration: Calibration) -> list[dict[str, Any]]:
    """Per pose: name, corners used and found, residuals of both devices and of the prediction."""
    adjusted = calibration.adjusted
    rows = []
    for k, observation in enumerate(calibration.observations):
        used = adjusted.used[k]
        rows.append(
            {
                "pose": observation.name,
                "corners": int(used.sum()),
                "corners_found": len(observation.view.index),
                "camera_rms_px": _rms(adjusted.camera_residual_px[k], used),
                "projector_rms_px": _rms(adjusted.projector_residual_px[k], used),
                "camera_rms_all_px": _rms(adjusted.camera_residual_px[k]),
                "projector_rms_all_px": _rms(adjusted.projector_residual_px[k]),
                "predicted_rms_px": calibration.predicted_px[k]
                if calibration.predicted_px
                else None,
                "phase_outliers": observation.found.outliers,
            }
        )
    return rows


def _rms(residual: FloatMap, used: Any = slice(None)) -> float:
    part = residual[used]
    return float(np.sqrt(np.mean(np.sum(part**2, axis=1)))) if len(part) else float("nan")


def coverage(calibration: Calibration) -> tuple[float, float]:
    """Share of the camera's and of the projector's frame that corners span, 0…1."""
    first = calibration.observations[0]
    shares = []
    for size, pixels in (
        (first.camera_size, [o.view.pixels for o in calibration.observations]),
        (first.projector_size, [o.found.projector_px for o in calibration.observations]),
    ):
        every = np.concatenate(pixels)
        every = every[np.isfinite(every).all(axis=1)]
        hull = spatial.ConvexHull(every)
        # In the plane, a hull's volume is its area.
        shares.append(float(hull.volume / (size[0] * size[1])))
    return shares[0], shares[1]


def diagnose(calibration: Calibration) -> list[Finding]:
    """Causes of a bad result, the most likely first; empty for a good one."""
    found = [
        *_odd_poses(calibration),
        *_ripple(calibration),
        *_bent(calibration),
        *_weak(calibration),
        *_left_out(calibration),
    ]
    found += [Finding("skipped", f"not used: {reason}") for reason in calibration.skipped.values()]
    return found


def _odd_poses(calibration: Calibration) -> list[Finding]:
    found = []
    rows = pose_figures(calibration)
    for device in ("camera", "projector"):
        values = np.array([row[f"{device}_rms_all_px"] for row in rows])
        usual = float(np.median(values))
        for row, value in zip(rows, values, strict=True):
            if value > ODD_POSE * usual:
                found.append(
                    Finding(
                        "pose",
                        f"{row['pose']}: the {device}'s residual is {value:.3f} px where "
                        f"{usual:.3f} px is usual; was the board moved or blurred, or hidden?",
                    )
                )
    return found


def _ripple(calibration: Calibration) -> list[Finding]:
    found = []
    axes: tuple[Axis, ...] = ("x", "y")
    for axis in axes:
        every = [o.found.ripple for o in calibration.observations]
        values = [ripple[axis] for ripple in every if axis in ripple]
        if not values:
            continue
        amplitude = float(np.median([v.amplitude_px for v in values]))
        sigma = float(np.median([v.sigma_px for v in values]))
        if amplitude > RIPPLE_PX and amplitude > RIPPLE * sigma:
            found.append(
                Finding(
                    "ripple",
                    f"coordinates along {axis} follow the fringes by {amplitude:.3f} px: the "
                    "projector's response (γ) is not corrected, or light is clipped",
                )
            )
    return found


def _bent(calibration: Calibration) -> list[Finding]:
    bow, sigma = calibration.bow_mm, calibration.bow_sigma_mm
    size = float(np.ptp(calibration.board.points_mm[:, :2], axis=0).max())
    worst = int(np.argmax(np.abs(bow) / sigma))
    if abs(bow[worst]) > BENT * sigma[worst] and np.abs(bow).max() > BENT_SHARE * size:
        return [
            Finding(
                "board",
                f"the board is not flat: by {np.abs(bow).max():.3f} mm ± {sigma[worst]:.3f} mm "
                "half its size from its middle; its poses and all lengths suffer from it",
            )
        ]
    return []


def _weak(calibration: Calibration) -> list[Finding]:
    found = []
    n = len(calibration.observations)
    tilt = float(tilts_deg(calibration.adjusted.poses).max())
    if tilt < TILT_DEG:
        found.append(
            Finding(
                "tilt",
                f"boards are turned against each other by {tilt:.0f}° at most: {TILT_DEG:.0f}° or "
                "more determine focal lengths well",
            )
        )
    if n < USUAL_POSES:
        found.append(Finding("poses", f"{n} poses: {USUAL_POSES} or more are usual"))
    for group in unmoved(calibration.observations, calibration.board):
        found.append(
            Finding("poses", f"the board did not move between {' and '.join(group)}: one pose")
        )
    for name, share in zip(("camera", "projector"), coverage(calibration), strict=True):
        if share < COVERED:
            found.append(
                Finding(
                    "coverage",
                    f"corners span {share:.0%} of the {name}'s frame: distortion outside is a "
                    "guess",
                )
            )
    rig = calibration.rig
    assert rig.covariance is not None
    sigma = np.sqrt(np.diag(rig.covariance))
    for name, device, start in (("camera", rig.camera, 0), ("projector", rig.projector, 9)):
        relative = float(sigma[start] / device.focal_px[0])
        if relative > WEAK_FOCAL:
            found.append(
                Finding(
                    "weak",
                    f"the {name}'s focal length is known to {relative:.2%} only: poses nearer, "
                    "further and more tilted would tell more",
                )
            )
    return found


def _left_out(calibration: Calibration) -> list[Finding]:
    found = []
    columns = calibration.board.grid[0]
    for observation, used in zip(calibration.observations, calibration.adjusted.used, strict=True):
        lit = np.isfinite(observation.found.projector_px).all(axis=1)
        bad = observation.view.index[lit][~used]
        if len(bad):
            places = ", ".join(f"{k % columns}/{k // columns}" for k in bad[:8])
            more = f" and {len(bad) - 8} more" if len(bad) > 8 else ""
            found.append(
                Finding(
                    "corners",
                    f"{observation.name}: left out as {'outliers' if len(bad) > 1 else 'outlier'}: "
                    f"{len(bad)} (column/row {places}{more})",
                )
            )
    return found
