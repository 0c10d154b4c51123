"""Diagnosis of a calibration: what is wrong, the likely cause, and what to do, in plain words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import scipy

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.calibrate import Calibration, Observation, unmoved
from fringeworks.rig.calibration.parameters import DEVICE_SIZE
from fringeworks.rig.calibration.poses import tilts_deg
from fringeworks.types import Axis, Finding, FloatMap
from fringeworks.types.numbers import number

USUAL_POSES = 10
"""Number of poses from which on a calibration is not called short of poses: the usual advice for
calibration with flat boards; with 8 to 12 the virtual rig meets its limits (docs)."""
USUAL_TILT_DEG = 20.0
"""Largest angle between two boards below which focal lengths are reported as weakly determined,
degrees. Boards tilted by the recommended 15° to all sides differ by 30°. See ``MIN_TILT_DEG`` for
how the uncertainty grows with smaller angles."""
MIN_COVERAGE = 0.35
"""Share of a frame that corners should span, 0…1. Further out, lens distortion is extrapolated.
Empirical: the boards of the virtual rig span 50 % of the camera's frame and 34 % of the
projector's."""
ODD_POSE_RATIO = 2.5
"""A pose is reported if its residual is this many times the median of all poses. Poses of one good
series differ by less than a factor of two; a board that was moved gives ten and more. Empirical."""
RIPPLE_SIGMAS = 10.0
"""Smallest ripple that is reported, in standard deviations of what noise alone gives: certain."""
RIPPLE_PX = 0.03
"""Smallest ripple that is reported, projector px: less is below the scatter of corners."""
BENT_SIGMAS = 6.0
"""Smallest deviation of the board from flat that is reported, in standard deviations."""
BENT_SHARE = 1e-4
"""Smallest deviation of the board from flat that is reported, over the board's size: 0.02 mm on a
board of 200 mm, flatter than printed boards are."""
WEAK_FOCAL = 0.003
"""Relative standard deviation of a focal length above which it is reported as badly known:
distances of 500 mm are then uncertain by about 1.5 mm. Tilts of 20° or more give 0.0003 or less."""
LARGE_INFLATION = 2.0
"""Factor on the standard deviations from which on disagreeing poses are reported. Independent
errors of corners give 0.9 to 1.3 with three to eight poses."""
MIN_READ_SHARE = 0.5
"""Share of a pose's corners with projector coordinates below which that is reported, 0…1: most are
missing. A board that reaches out of the projector's light loses a row or two."""
LISTED_CORNERS = 8
"""Largest number of corners that one finding lists by column and row; a line holds no more."""

SMALL_PITCH_MM = 5.0
"""Squares below which a unit other than mm is likely, mm: boards have squares of 5 to 60 mm, and in
cm these are 0.5 to 6."""
SMALL_DISTANCE_MM = 150.0
"""Distance of the board below which it is, mm: scanners stand 200 to 2000 mm away. Boards of small
squares that are farther away are small boards."""
PITCH_IN_METRES = 0.1
"""Squares below which the unit was metres: in cm they would be of less than 1 mm."""


def pose_figures(calibration: Calibration) -> list[dict[str, Any]]:
    """Return the numerical results of every pose, ready for JSON.

    Returns
    -------
    One dictionary per pose:

    - ``pose``: its name
    - ``corners``, ``corners_found``: number of corners used, and found in the photograph
    - ``camera_rms_px``, ``projector_rms_px``: root mean square residuals of the used corners, px
    - ``camera_rms_all_px``, ``projector_rms_all_px``: the same, outliers included
    - ``predicted_rms_px``: see ``Calibration.predicted_px``; None where there is no prediction
    - ``phase_outliers``: share of the decoded pixels that do not lie on a smooth surface, 0…1
    """
    adjusted = calibration.adjusted
    predicted = calibration.predicted_px
    rows = []
    for k, observation in enumerate(calibration.observations):
        used = adjusted.used[k]
        rows.append(
            {
                "pose": observation.name,
                "corners": int(used.sum()),
                "corners_found": len(observation.view.index),
                "camera_rms_px": _rms(adjusted.camera_residual_px[k][used]),
                "projector_rms_px": _rms(adjusted.projector_residual_px[k][used]),
                "camera_rms_all_px": _rms(adjusted.camera_residual_px[k]),
                "projector_rms_all_px": _rms(adjusted.projector_residual_px[k]),
                "predicted_rms_px": predicted[k] if predicted else None,
                "phase_outliers": observation.found.outliers,
            }
        )
    return rows


def _rms(residual: FloatMap) -> float:
    if not len(residual):
        return float("nan")
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


def coverage(calibration: Calibration) -> tuple[float, float]:
    """Return the share of the camera's and the projector's frame that corners span, 0…1."""
    first = calibration.observations[0]
    shares = []
    for size, pixels in (
        (first.camera_size, [o.view.pixels for o in calibration.observations]),
        (first.projector_size, [o.found.projector_px for o in calibration.observations]),
    ):
        corners = np.concatenate(pixels)
        corners = corners[np.isfinite(corners).all(axis=1)]
        hull = scipy.spatial.ConvexHull(corners)
        # In two dimensions SciPy calls the area of a hull its volume.
        shares.append(float(hull.volume / (size[0] * size[1])))
    return shares[0], shares[1]


def diagnose(calibration: Calibration) -> list[Finding]:
    """Find what makes a calibration worse than it could be.

    Parameters
    ----------
    calibration : Calibration

    Returns
    -------
    list of Finding, the most important first; empty for a calibration without fault. Their kinds
    are unit, pose, ripple, board, tilt, poses, coverage, weak, field, structure, disagreement,
    convergence, corners and skipped.
    """
    return [
        *unit_findings(calibration.board, calibration.adjusted.poses),
        *_odd_poses(calibration),
        *ripple_findings(calibration.observations),
        *_bent_board(calibration),
        *_low_tilt(calibration),
        *_few_poses(calibration),
        *_low_coverage(calibration),
        *_weak_focal_lengths(calibration),
        *_fields(calibration),
        *_structure(calibration),
        *_poses_that_disagree(calibration),
        *few_corners(calibration.observations),
        *_outlying_corners(calibration),
        *skipped_poses(calibration.skipped),
    ]


def unit_findings(board: Board, poses: Sequence[FloatMap]) -> list[Finding]:
    """Return a finding for a board whose sizes and distances are too small to be in mm.

    Parameters
    ----------
    board : Board
    poses : sequence of (4, 4) arrays
        From the board's coordinates to the camera's.
    """
    distance = float(np.median([T[2, 3] for T in poses]))
    if board.pitch_mm >= SMALL_PITCH_MM or distance >= SMALL_DISTANCE_MM:
        return []
    in_metres = board.pitch_mm < PITCH_IN_METRES
    unit, times = ("metres", 1000.0) if in_metres else ("cm or inches", 10.0)
    factor = "1000" if in_metres else "10 or 25.4"
    seen = (
        f"the board has a pitch of {number(board.pitch_mm)} mm and was {number(distance)} mm away: "
        f"if its size was given in {unit}, all lengths are {factor} times too small"
    )
    figures = {"pitch_mm": board.pitch_mm, "distance_mm": distance}
    advice = f"give the board's size in mm, such as {number(times * board.pitch_mm)}"
    return [Finding("unit", seen, advice=advice, figures=figures)]


def _odd_poses(calibration: Calibration) -> list[Finding]:
    findings = []
    rows = pose_figures(calibration)
    for device in ("camera", "projector"):
        values = np.array([row[f"{device}_rms_all_px"] for row in rows])
        usual = float(np.median(values))
        for row, value in zip(rows, values, strict=True):
            if value > ODD_POSE_RATIO * usual:
                seen = (
                    f"{row['pose']}: the {device}'s residual is {value:.3f} px, in most poses it "
                    f"is {usual:.3f} px"
                )
                causes = ("the board was moved, blurred or partly hidden",)
                advice = "photograph this pose again, or leave it out"
                figures = {"residual_px": float(value), "usual_px": usual}
                findings.append(Finding("pose", seen, causes, advice, figures=figures))
    return findings


def ripple_findings(observations: Sequence[Observation]) -> list[Finding]:
    """Report coordinates that have an error which repeats with the fringes."""
    findings = []
    axes: tuple[Axis, ...] = ("x", "y")
    for axis in axes:
        all_poses = [o.found.ripple for o in observations]
        ripples = [ripple[axis] for ripple in all_poses if axis in ripple]
        if not ripples:
            continue
        amplitude = float(np.median([r.amplitude_px for r in ripples]))
        sigma = float(np.median([r.sigma_px for r in ripples]))
        if amplitude > RIPPLE_PX and amplitude > RIPPLE_SIGMAS * sigma:
            seen = (
                f"coordinates along {axis} have an error of ±{amplitude:.3f} px that repeats with "
                "the fringes"
            )
            causes = ("the projector's response (γ) is not corrected", "frames are saturated")
            advice = "measure and correct the response, lower the exposure, or use more phase steps"
            figures = {"amplitude_px": amplitude, "sigma_px": sigma}
            findings.append(Finding("ripple", seen, causes, advice, axis, (), figures))
    return findings


def _bent_board(calibration: Calibration) -> list[Finding]:
    bow, sigma = calibration.bow_mm, calibration.bow_sigma_mm
    size = float(np.ptp(calibration.board.points_mm[:, :2], axis=0).max())
    worst = int(np.argmax(np.abs(bow) / sigma))
    largest = float(np.abs(bow).max())
    if not (abs(bow[worst]) > BENT_SIGMAS * sigma[worst] and largest > BENT_SHARE * size):
        return []
    seen = (
        f"the board is not flat: half its size from its middle it deviates by {largest:.3f} mm ± "
        f"{sigma[worst]:.3f} mm from a plane; this makes poses and all lengths wrong"
    )
    advice = "use a stiffer board, or glue the pattern onto a flat plate"
    figures = {"largest_mm": largest, "sigma_mm": float(sigma[worst])}
    return [Finding("board", seen, advice=advice, figures=figures)]


def _low_tilt(calibration: Calibration) -> list[Finding]:
    tilt = float(tilts_deg(calibration.adjusted.poses).max())
    if tilt >= USUAL_TILT_DEG:
        return []
    seen = (
        f"the boards are tilted against each other by {tilt:.0f}° at most, so focal lengths are "
        "weakly determined"
    )
    advice = (
        f"tilt the board by 15° to 35° to all sides, so that poses differ by "
        f"{USUAL_TILT_DEG:.0f}° or more"
    )
    return [Finding("tilt", seen, advice=advice, figures={"tilt_deg": tilt})]


def _few_poses(calibration: Calibration) -> list[Finding]:
    findings = []
    n = len(calibration.observations)
    if n < USUAL_POSES:
        seen = f"{n} poses are few: {USUAL_POSES} or more are usual"
        figures = {"poses": float(n)}
        findings.append(Finding("poses", seen, advice="photograph more", figures=figures))
    for names in unmoved(calibration.observations, calibration.board):
        seen = f"the board did not move between {' and '.join(names)}: they count as one pose"
        advice = "move the board between photographs"
        findings.append(Finding("poses", seen, advice=advice))
    return findings


def _low_coverage(calibration: Calibration) -> list[Finding]:
    findings = []
    for name, share in zip(("camera", "projector"), coverage(calibration), strict=True):
        if share < MIN_COVERAGE:
            seen = (
                f"corners span {share:.0%} of the {name}'s frame: lens distortion is extrapolated "
                "outside"
            )
            advice = "move the board into the corners of the frame"
            findings.append(Finding("coverage", seen, advice=advice, figures={"share": share}))
    return findings


def _weak_focal_lengths(calibration: Calibration) -> list[Finding]:
    findings = []
    rig = calibration.rig
    assert rig.covariance is not None
    sigma = np.sqrt(np.diag(rig.covariance))
    for k, (name, device) in enumerate((("camera", rig.camera), ("projector", rig.projector))):
        relative = float(sigma[DEVICE_SIZE * k] / device.focal_px[0])
        if relative > WEAK_FOCAL:
            seen = f"the {name}'s focal length is only known to {relative:.2%}"
            causes = ("the poses are too similar",)
            advice = "add poses that are nearer, further away and tilted more"
            figures = {"relative_sigma": relative}
            findings.append(Finding("weak", seen, causes, advice, figures=figures))
    return findings


def _fields(calibration: Calibration) -> list[Finding]:
    findings = []
    names = ("camera", "projector")
    sizes = zip(names, calibration.field_px, calibration.field_sigma_px, strict=True)
    for name, rms, sigma in sizes:
        if rms > 0.0:
            seen = (
                f"the {name} deviates from the model of its lens by {rms:.3f} px, depending on the "
                f"place in its frame; the rig corrects this, up to {sigma:.3f} px where the board "
                "has been, and less well elsewhere"
            )
            causes = (
                "keystone correction or scaling of the image",
                "a lens, mirror or window with local distortion",
            )
            advice = (
                "move the board over the whole field that is measured, and switch off corrections "
                "of the image that can be switched off"
            )
            figures = {"field_px": rms, "field_sigma_px": sigma}
            findings.append(Finding("field", seen, causes, advice, figures=figures))
    return findings


def _structure(calibration: Calibration) -> list[Finding]:
    findings = []
    scatter = np.median(calibration.adjusted.scatter_px, axis=0)
    names = ("camera", "projector")
    for name, rms, usual in zip(names, calibration.structure_px, scatter, strict=True):
        if rms > 0.0:
            seen = (
                f"the {name} has errors of {rms:.3f} px that depend on the place in its frame and "
                f"that the model of its lens does not hold (corners scatter by {usual:.3f} px); "
                "forms and sizes are wrong by more than their σ"
            )
            causes = (
                "keystone correction or scaling of the image",
                "a lens, mirror or window with local distortion",
            )
            advice = "switch off all corrections of the image, and compare with a known body"
            figures = {"structure_px": rms, "scatter_px": float(usual)}
            findings.append(Finding("structure", seen, causes, advice, figures=figures))
    return findings


def _poses_that_disagree(calibration: Calibration) -> list[Finding]:
    findings = []
    if calibration.inflation > LARGE_INFLATION:
        seen = (
            f"leaving out a pose changes the rig by {calibration.inflation:.1f} times what the "
            "scatter of corners explains, so all standard deviations were raised by this factor; "
            "corners of one pose share errors"
        )
        causes = ("uncorrected response", "blur", "lenses that the model does not describe")
        advice = "correct the response, or add poses"
        figures = {"inflation": calibration.inflation}
        findings.append(Finding("disagreement", seen, causes, advice, figures=figures))
    if not calibration.adjusted.converged:
        seen = "the adjustment did not settle, so weights and standard deviations are not final"
        advice = "look for a pose that stands out, and leave it out"
        findings.append(Finding("convergence", seen, advice=advice, severity="error"))
    return findings


def _outlying_corners(calibration: Calibration) -> list[Finding]:
    findings = []
    columns = calibration.board.grid[0]
    for observation, used in zip(calibration.observations, calibration.adjusted.used, strict=True):
        outliers = observation.view.index[observation.found.read][~used]
        if not len(outliers):
            continue
        places = ", ".join(f"{k % columns}/{k // columns}" for k in outliers[:LISTED_CORNERS])
        more = len(outliers) - LISTED_CORNERS
        if more > 0:
            places += f" and {more} more"
        corners = "1 corner was" if len(outliers) == 1 else f"{len(outliers)} corners were"
        seen = (
            f"{observation.name}: {corners} left out as too far from the fit (column/row {places})"
        )
        causes = ("glare, dirt or something in front of the board",)
        figures = {"corners": float(len(outliers))}
        findings.append(Finding("corners", seen, causes, figures=figures))
    return findings


def few_corners(observations: Iterable[Observation]) -> list[Finding]:
    """Report poses that count with few of the corners that the camera sees."""
    findings = []
    for observation in observations:
        read = observation.found.read
        share = float(read.mean())
        if share >= MIN_READ_SHARE:
            continue
        seen = (
            f"{observation.name}: only {read.sum()} of the {read.size} corners that the camera "
            f"sees ({share:.0%}) have projector coordinates, and the others are not used"
        )
        figures = {"corners": float(read.sum()), "corners_found": float(read.size)}
        findings.append(Finding("corners", seen, (observation.unread,), figures=figures))
    return findings


def skipped_poses(skipped: dict[str, str]) -> list[Finding]:
    """Report poses that could not be used, each with its reason."""
    return [Finding("skipped", f"pose not used: {reason}") for reason in skipped.values()]
