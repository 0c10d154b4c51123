"""Whether a rig still holds: its drift since the calibration, by one pose of a board or several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import scipy

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_points import (
    by_rig,
    corner_points,
    displacement,
    flatness_mm,
    scale_of,
)
from fringeworks.rig.calibration.calibrate import Observation, refined, sighting_of
from fringeworks.rig.calibration.diagnosis import ripple_findings
from fringeworks.rig.calibration.drift_fits import EVERYTHING, Fit, fit_changes
from fringeworks.rig.calibration.drift_words import Cause, cause_of, with_sigma
from fringeworks.rig.calibration.poses import fit_pose
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.rig.calibration.start import first_pose
from fringeworks.rig.pinhole import project, transform
from fringeworks.types import (
    BoolMap,
    Finding,
    FloatMap,
    Frozen,
    InputError,
    Provenance,
    Rig,
    RigMismatch,
)

FALSE_ALARM = 1e-4
"""Probability that a rig which holds is said to have moved."""
BLIND_SHARE = 2e-3
"""Smallest drift that a check must be able to notice, over the board's distance: 1 mm at 500 mm. A
check that would miss more cannot tell whether the rig holds."""
UNKNOWN_RIG_PX = 2.0
"""Drift from which on a rig without a covariance is said to have moved, projector px. Calibrations
by other programs leave errors of 0.3 to 0.9 px."""
LARGE_SCATTER = 4.0
"""Scatter of the corners, over that of the calibration, from which on it is reported. Poses of one
series differ by less than a factor of two."""
LARGE_SCALE_SIGMAS = 4.0
"""Deviation of the measured scale from 1 that is reported, in standard deviations."""
MIN_SCALE_POINTS = 4
"""Smallest number of triangulated corners for flatness and scale: three always lie on a plane."""


@dataclass(frozen=True, eq=False, repr=False)
class RigCheck(Frozen):
    """What poses of a board say about a rig that was calibrated earlier."""

    verdict: Literal["holds", "has moved", "cannot tell"]
    drift_mm: float
    """Median distance by which points at the board are displaced, mm; as the likeliest cause has
    it where the rig has moved, else by any change of the relative pose."""
    sigma_mm: float
    """Standard deviation of the displacement, mm."""
    drift_px: float
    """Root mean square displacement of the projector's pixels at the board, px."""
    sigma_px: float
    """Its standard deviation, px."""
    excess: float
    """Disagreement of rig and board, over the largest that σ explains (one in 10⁴ checks of a rig
    that holds); above 1 the rig has moved."""
    noticeable_mm: float
    """Smallest drift at the board that this check notices, mm."""
    causes: tuple[Cause, ...]
    """Changes that explain the drift, the likeliest first; each explains it alone. Empty where the
    rig did not move, and where no single change explains it."""
    rotation_deg: FloatMap
    """Rotation of the projector against the camera since the calibration, about the axes of the
    projector, (3,), degrees; if any change of the relative pose is possible."""
    rotation_sigma_deg: FloatMap
    """Its standard deviations, (3,), degrees."""
    translation_mm: FloatMap
    """Change of the translation of ``T_projector_camera``, (3,), mm, found with the rotation."""
    translation_sigma_mm: FloatMap
    """Its standard deviations, (3,), mm."""
    camera_rms_px: float
    """Root mean square residual of the corners in the camera after a fit of the board, px."""
    projector_rms_px: float
    """Root mean square distance of the corners' projector coordinates from those that the rig
    predicts from the camera's corners, px."""
    flatness_mm: float
    """Root mean square distance of the board's measured corners from a plane, mm, with the board's
    own errors."""
    scale: float
    """Size of the measured board over its stated size."""
    scale_sigma: float
    """Standard deviation of ``scale`` that rig and scatter explain."""
    distance_mm: float
    """Median distance of the board from the camera, mm."""
    findings: tuple[Finding, ...] = ()
    """What makes the check less certain, and what it cannot tell."""
    provenance: Provenance | None = None
    """How it was made; None where the caller made observations."""

    @property
    def text(self) -> str:
        """The verdict, the drift and its likely cause in one or two sentences."""
        drift = f"{with_sigma(self.drift_mm, self.sigma_mm)} mm at {self.distance_mm:.0f} mm"
        if self.verdict == "has moved":
            likely = " or ".join(cause.text for cause in self.causes)
            return (
                f"the rig has moved: points at the board are off by {drift} "
                f"({self.drift_px:.2f} px); {likely or 'no single change of the rig explains it'}"
            )
        noticed = f"a drift of {self.noticeable_mm:.2g} mm would have been noticed"
        if self.verdict == "holds":
            return f"the rig holds: drift of points at the board {drift}; {noticed}"
        return f"cannot tell whether the rig holds: drift of points at the board {drift}; {noticed}"

    def __str__(self) -> str:
        return "\n".join([self.text, *(f.text for f in self.findings)])


@dataclass(frozen=True, eq=False)
class _Seen:
    """Poses of a board as numbers, with every change of the rig fitted to them."""

    sightings: list[Sighting]
    poses: list[FloatMap]
    fits: dict[str, Fit]
    scatter_px: tuple[float, float]

    def excess(self, name: str) -> float:
        """Disagreement that a change leaves, over the largest that σ explains."""
        most, fit = self.fits[EVERYTHING], self.fits[name]
        limit = scipy.stats.chi2.isf(FALSE_ALARM, most.freedom - fit.freedom)
        return float(np.sqrt(max(fit.cost - most.cost, 0.0) / limit))


def check_observations(rig: Rig, observations: Sequence[Observation], board: Board) -> RigCheck:
    """Check a rig with a board in one pose or several.

    Parameters
    ----------
    rig : Rig
    observations : sequence of Observation
        One is enough; the board need not be the one of the calibration.
    board : Board

    Returns
    -------
    RigCheck

    Raises
    ------
    RigMismatch for observations with frames of other sizes; InputError for none.

    Notes
    -----
    Each change is fitted with its own prior (``fit_changes``), and the rig has moved where the fit
    without a change is worse than that with all changes by more than χ² allows. The board's bow,
    print errors and pose are estimated along with it. σ holds the scatter of the corners, twice
    (errors that corners of a pose share), and the covariance of the rig.
    """
    seen = _seen(rig, observations, board)
    moved = seen.excess("nothing")
    causes = _causes(rig, seen) if moved > 1.0 else ()
    of = seen.fits[causes[0].name if causes else "pose"]
    mm, sigma_mm, px, sigma_px = displacement(seen.sightings, rig, of.change, of.covariance)
    distance = float(np.median([np.linalg.norm(T[:3, 3]) for T in seen.poses]))
    pose = seen.fits["pose"]
    limit = float(np.sqrt(scipy.stats.chi2.isf(FALSE_ALARM, pose.freedom)))
    blind = displacement(seen.sightings, rig, pose.change, pose.covariance)[1] * limit
    turn, shift = pose.change[18:21], pose.change[21:]
    sigma = np.sqrt(np.maximum(np.diag(pose.covariance), 0.0))
    checked = RigCheck(
        verdict="holds",
        drift_mm=mm,
        sigma_mm=sigma_mm,
        drift_px=px,
        sigma_px=sigma_px,
        excess=moved,
        noticeable_mm=blind,
        causes=causes,
        rotation_deg=np.degrees(turn),
        rotation_sigma_deg=np.degrees(sigma[18:21]),
        translation_mm=shift,
        translation_sigma_mm=sigma[21:],
        distance_mm=distance,
        **_of_board(rig, seen),
    )
    judged = replace(checked, verdict=_verdict(rig, checked))
    return replace(judged, findings=_findings(rig, judged, seen, observations))


def adjust_to(rig: Rig, observations: Sequence[Observation], board: Board) -> Rig:
    """Correct the relative pose of a rig by a board in one pose or several.

    Parameters
    ----------
    rig : Rig
    observations : sequence of Observation
    board : Board

    Returns
    -------
    Rig with the covariance of all its parameters. The devices' own parameters are estimated again
    with the calibration as prior, so that they stay within their σ.

    Raises
    ------
    InputError where a change of the relative pose does not explain what was seen, such as a camera
    that was refocused; and as ``check_observations``.
    """
    seen = _seen(rig, observations, board)
    if seen.excess("pose") > 1.0:
        names = [cause.text for cause in _causes(rig, seen)]
        likely = f" (likely {names[0]})" if names else ""
        raise InputError(
            "rig: expected a change of the relative pose of camera and projector, got one that "
            f"rotation and translation do not explain{likely}; calibrate again"
        )
    found = seen.fits["pose"].rig
    residual = [_rms(r) for r in _residuals(found, seen)]
    return replace(found, residual_px=(residual[0], residual[1]))


def _seen(rig: Rig, observations: Sequence[Observation], board: Board) -> _Seen:
    if not observations:
        raise InputError("rig check: expected a board in one pose or more, got none")
    for o in observations:
        for name, size, device in (
            ("camera", o.camera_size, rig.camera),
            ("projector", o.projector_size, rig.projector),
        ):
            if size != (device.width_px, device.height_px):
                raise RigMismatch(
                    f"rig: it is for a {name} of {device.width_px} × {device.height_px} px, got "
                    f"{o.name} of {size[0]} × {size[1]} px"
                )
    sightings, poses = [], []
    for o in observations:
        start = sighting_of(o, board)
        T = fit_pose(start, rig, first_pose(start, rig.camera))
        sightings.append(sighting_of(refined(o, board, rig.camera, T), board))
        poses.append(fit_pose(sightings[-1], rig, T))
    fits, adjusted = fit_changes(rig, sightings, poses)
    camera, projector = np.median(adjusted.scatter_px, axis=0)
    return _Seen(sightings, poses, fits, (float(camera), float(projector)))


def _causes(rig: Rig, seen: _Seen) -> tuple[Cause, ...]:
    """The changes that explain what was seen, by their costs and freedom (Akaike)."""
    alone = [name for name in seen.fits if name not in ("nothing", "pose", EVERYTHING)]
    good = [name for name in alone if seen.excess(name) <= 1.0]
    if not good and seen.excess("pose") <= 1.0:
        good = ["pose"]
    if "baseline" in good and "translation" in good:
        good.remove("translation")
    good.sort(key=lambda name: seen.fits[name].cost + 2.0 * seen.fits[name].freedom)
    return tuple(cause_of(name, rig, seen.fits[name]) for name in good)


def _of_board(rig: Rig, seen: _Seen) -> dict[str, Any]:
    """The board as the rig measures it: residuals, flatness and scale."""
    covariance = np.zeros((24, 24)) if rig.covariance is None else rig.covariance
    flat, scale, variance = [], [], []
    for sighting in seen.sightings:
        points = corner_points(rig, sighting)
        good: BoolMap = np.asarray(np.isfinite(points).all(axis=1))
        if good.sum() < MIN_SCALE_POINTS:
            continue
        points, board = points[good], sighting.points_mm[good]
        flat.append(flatness_mm(points))
        scale.append(scale_of(points, board))

        def size(of: Rig, s: Sighting = sighting, g: BoolMap = good) -> FloatMap:
            return np.array([scale_of(corner_points(of, s)[g], s.points_mm[g])])

        own = flat[-1] / float(np.sqrt(np.sum((board - board.mean(axis=0)) ** 2)))
        variance.append(float(np.sum(by_rig(rig, covariance, size) ** 2)) + own**2)
    camera, projector = _residuals(rig, seen)
    return {
        "camera_rms_px": _rms(camera),
        "projector_rms_px": _rms(projector),
        "flatness_mm": float(np.mean(flat)) if flat else float("nan"),
        "scale": float(np.mean(scale)) if scale else float("nan"),
        "scale_sigma": float(np.sqrt(np.mean(variance))) if variance else float("nan"),
    }


def _residuals(rig: Rig, seen: _Seen) -> tuple[FloatMap, FloatMap]:
    """Measured minus predicted pixels of camera and projector, (n, 2), px.

    The board's poses are fitted to the camera's corners alone.
    """
    camera, projector = [], []
    for s, start in zip(seen.sightings, seen.poses, strict=True):
        points = transform(fit_pose(s, rig, start), s.points_mm)
        camera.append(s.camera_px - project(rig.camera, points))
        in_projector = transform(rig.T_projector_camera, points)
        projector.append(s.projector_px - project(rig.projector, in_projector))
    return np.concatenate(camera), np.concatenate(projector)


def _rms(residual: FloatMap) -> float:
    return float(np.sqrt(np.nanmean(np.sum(residual**2, axis=1))))


def _verdict(rig: Rig, checked: RigCheck) -> Literal["holds", "has moved", "cannot tell"]:
    if checked.excess > 1.0:
        certain = rig.covariance is not None or checked.drift_px > UNKNOWN_RIG_PX
        return "has moved" if certain else "cannot tell"
    if not checked.noticeable_mm <= BLIND_SHARE * checked.distance_mm:
        return "cannot tell"
    return "holds"


def _findings(
    rig: Rig, checked: RigCheck, seen: _Seen, observations: Sequence[Observation]
) -> tuple[Finding, ...]:
    """What makes a check less certain, and what it cannot tell."""
    findings = list(ripple_findings(observations))
    if rig.covariance is None:
        seen = (
            "the rig states no uncertainty, so errors of its calibration cannot be told from a "
            "drift"
        )
        advice = "calibrate it with fringeworks for a sharper check"
        findings.append(Finding("uncertainty", seen, advice=advice))
    if rig.residual_px is not None:
        for name, now, then in zip(
            ("camera", "projector"), seen.scatter_px, rig.residual_px, strict=True
        ):
            if now > LARGE_SCATTER * then:
                seen = (
                    f"corners scatter by {now:.3f} px in the {name}, at the calibration they did "
                    f"by {then:.3f} px"
                )
                causes = ("the board is blurred, badly lit or another", "the lens has changed")
                figures = {"scatter_px": now, "calibration_px": then}
                findings.append(Finding("scatter", seen, causes, figures=figures))
    if len(checked.causes) > 1:
        names = " and ".join(cause.name for cause in checked.causes)
        seen = f"{names} cannot be told apart by this pose"
        advice = "tilt the board more, move it nearer or further, or add poses"
        findings.append(Finding("cause", seen, advice=advice))
    if checked.excess <= 1.0 and checked.verdict == "cannot tell":
        seen = f"a drift of up to {checked.noticeable_mm:.2g} mm would go unnoticed"
        advice = "fill the frame with a tilted board, take sharper frames, or add poses"
        figures = {"noticeable_mm": checked.noticeable_mm}
        findings.append(Finding("blind", seen, advice=advice, figures=figures))
    off = abs(checked.scale - 1.0)
    if off > LARGE_SCALE_SIGMAS * checked.scale_sigma and checked.excess > 1.0:
        size = with_sigma(100.0 * checked.scale, 100.0 * checked.scale_sigma)
        seen = f"measured with this rig, the board has {size} % of its stated size"
        figures = {"scale": checked.scale, "sigma": checked.scale_sigma}
        findings.append(Finding("scale", seen, figures=figures, severity="error"))
    return tuple(findings)
