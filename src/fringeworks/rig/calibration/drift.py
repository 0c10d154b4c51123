"""Whether a rig still holds: its drift since the calibration, by one pose of a board or several."""

from __future__ import annotations

import math
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
from fringeworks.rig.calibration.camera_blur import camera_blur
from fringeworks.rig.calibration.changes import (
    BASELINE,
    EVERYTHING,
    FOCI,
    NOTHING,
    POSE,
    ROTATION,
    TRANSLATION,
    Causes,
    Change,
    Fits,
    contains,
    fit_changes,
)
from fringeworks.rig.calibration.diagnosis import ripple_findings
from fringeworks.rig.calibration.parameters import DEVICE_SIZE
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
    Pinhole,
    Provenance,
    Rig,
    RigMismatch,
)

SIGMA_DIGITS = 2
"""Digits of a standard deviation that are shown; more would not be known."""
MAX_DIGITS = 6
"""Largest number of decimals that are shown."""
FALSE_ALARM = 1e-4
"""Probability that a rig which holds is said to have moved."""
UNLIKELY = 0.01
"""Probability over that of the likeliest cause below which a cause is not named."""
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


@dataclass(frozen=True)
class Cause:
    """A change of a rig that explains what was seen."""

    name: str
    """Short name: rotation, translation, baseline, camera focus, projector focus, pose (rotation
    and translation), or several of them, joined by "with"."""
    text: str
    """The change with its size and standard deviation."""


def cause_of(causes: Causes, rig: Rig, change: Change) -> Cause:
    """Describe a change of a rig by causes that act together."""
    words = {
        "baseline": _longer,
        "rotation": lambda _, change: f"the projector {_turn(change)}",
        "translation": lambda _, change: f"the projector {_shift(change)}",
        "camera focus": _refocused,
        "projector focus": _refocused_projector,
    }
    names = [name for name in words if name in causes]
    texts = [words[name](rig, change) for name in names]
    if causes >= POSE:
        names[:2] = ["pose"]
        texts[:2] = [f"the projector {_turn(change)}, and {_shift(change)}"]
    return Cause(" with ".join(names), "; and ".join(texts))


def _longer(rig: Rig, change: Change) -> str:
    along = rig.T_projector_camera[:3, 3] / rig.baseline_mm
    share = 100.0 * float(change.change[TRANSLATION] @ along) / rig.baseline_mm
    sigma = 100.0 * _sigma(change, TRANSLATION, along) / rig.baseline_mm
    return (
        f"the baseline became {with_sigma(abs(share), sigma)} % "
        f"{'longer' if share > 0 else 'shorter'}, or the board's squares are so much "
        f"{'smaller' if share > 0 else 'larger'} than stated"
    )


def _refocused(rig: Rig, change: Change) -> str:
    return f"the camera {_focus(change, 0, rig.camera)}"


def _refocused_projector(rig: Rig, change: Change) -> str:
    return f"the projector {_focus(change, DEVICE_SIZE, rig.projector)}"


def _focus(change: Change, first: int, device: Pinhole) -> str:
    share = 100.0 * float(change.change[first]) / device.focal_px[0]
    sigma = 100.0 * _sigma(change, slice(first, first + 1), np.ones(1)) / device.focal_px[0]
    return (
        f"was refocused: its focal length is {with_sigma(abs(share), sigma)} % "
        f"{'longer' if share > 0 else 'shorter'}"
    )


def _turn(change: Change) -> str:
    omega = np.degrees(change.change[ROTATION])
    size = float(np.linalg.norm(omega))
    sigma = np.degrees(_sigma(change, ROTATION, omega / size))
    shares = ", ".join(f"{axis} {value:+.3f}°" for axis, value in zip("xyz", omega, strict=True))
    return (
        f"turned against the camera by {with_sigma(size, sigma)}° (about the projector's axes "
        f"{shares})"
    )


def _shift(change: Change) -> str:
    shift = change.change[TRANSLATION]
    size = float(np.linalg.norm(shift))
    sigma = _sigma(change, TRANSLATION, shift / size)
    shares = ", ".join(f"{axis} {value:+.2f} mm" for axis, value in zip("xyz", shift, strict=True))
    return f"moved against the camera by {with_sigma(size, sigma)} mm ({shares})"


def with_sigma(value: float, sigma: float) -> str:
    """A value and its standard deviation, as many digits as that says."""
    place = math.floor(math.log10(sigma)) if sigma > 0 else -MAX_DIGITS
    digits = min(max(SIGMA_DIGITS - 1 - place, 0), MAX_DIGITS)
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"


def _sigma(change: Change, part: slice, along: FloatMap) -> float:
    """Standard deviation of a part of a change along a unit vector."""
    return math.sqrt(float(along @ change.covariance[part, part] @ along))


@dataclass(frozen=True, eq=False, repr=False)
class RigCheck(Frozen):
    """What poses of a board say about a rig that was calibrated earlier."""

    verdict: Literal["holds", "has moved", "cannot tell"]
    drift_mm: float
    """Median distance by which points at the board are displaced, mm; averaged over all causes by
    their evidence."""
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
    """Smallest drift at the board that this check notices, by a change of the relative pose, of the
    baseline's length or of both focal lengths, mm."""
    causes: tuple[Cause, ...]
    """Changes that explain the drift, the likeliest first; each explains it alone. Empty where the
    rig did not move."""
    rotation_deg: FloatMap
    """Rotation of the projector against the camera since the calibration, about the axes of the
    projector, (3,), degrees; averaged over all causes by their evidence."""
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
                f"({self.drift_px:.2f} px); {likely or 'no known change of the rig explains it'}"
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
    fits: Fits

    @property
    def excess(self) -> float:
        """Disagreement of the unchanged rig, over the largest that σ explains."""
        most, none = self.fits[EVERYTHING], self.fits[NOTHING]
        limit = scipy.stats.chi2.isf(FALSE_ALARM, most.freedom)
        return float(np.sqrt(max(none.cost - most.cost, 0.0) / limit))


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
    Every set of causes is fitted with its own prior (``fit_changes``), and the rig has moved where
    the fit without a change is worse than that with all changes by more than χ² allows. The board's
    bow, print errors and pose are estimated along with it. σ holds the scatter of the corners,
    twice (errors that corners of a pose share), the covariance of the rig, and the differences of
    causes that the poses cannot tell apart.
    """
    seen = _seen(rig, observations, board)
    moved, change = seen.excess, seen.fits.mean()
    mm, sigma_mm, px, sigma_px = displacement(seen.sightings, rig, change.change, change.covariance)
    distance = float(np.median([np.linalg.norm(T[:3, 3]) for T in seen.poses]))
    blind = max(_unnoticed(rig, seen, causes) for causes in (POSE, BASELINE, FOCI))
    sigma = np.sqrt(np.diag(change.covariance))
    checked = RigCheck(
        verdict="holds",
        drift_mm=mm,
        sigma_mm=sigma_mm,
        drift_px=px,
        sigma_px=sigma_px,
        excess=moved,
        noticeable_mm=blind,
        causes=likely_causes(rig, seen.fits) if moved > 1.0 else (),
        rotation_deg=np.degrees(change.change[ROTATION]),
        rotation_sigma_deg=np.degrees(sigma[ROTATION]),
        translation_mm=change.change[TRANSLATION],
        translation_sigma_mm=sigma[TRANSLATION],
        distance_mm=distance,
        **_of_board(rig, seen),
    )
    judged = replace(checked, verdict=_verdict(rig, checked))
    return replace(judged, findings=_findings(rig, judged, seen, observations))


def _unnoticed(rig: Rig, seen: _Seen, causes: Causes) -> float:
    """Largest drift at the board by these causes that a check would not notice, mm."""
    fit = seen.fits[causes]
    limit = float(np.sqrt(scipy.stats.chi2.isf(FALSE_ALARM, fit.freedom)))
    return limit * displacement(seen.sightings, rig, fit.change, fit.of_largest)[1]


def adjust_to(rig: Rig, observations: Sequence[Observation], board: Board) -> Rig:
    """Correct a rig by a board in one pose or several.

    Parameters
    ----------
    rig : Rig
    observations : sequence of Observation
    board : Board

    Returns
    -------
    Rig with the covariance of all its parameters: the average of the rigs that every set of causes
    leads to, weighted by the evidence. The covariance holds the differences of causes that the
    poses cannot tell apart. The camera's blur is measured anew, where the board has squares.

    Raises
    ------
    As ``check_observations``.
    """
    seen = _seen(rig, observations, board)
    found = seen.fits.adjusted()
    residual = [_rms(r) for r in _residuals(found, seen)]
    views = [o.view for o in observations]
    blur = camera_blur(views, seen.poses, board, rig.camera.shape) or rig.blur
    residual_px = (residual[0], residual[1])
    return replace(found, residual_px=residual_px, blur=blur, robot=rig.robot)


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
    return _Seen(sightings, poses, fit_changes(rig, sightings, poses))


def likely_causes(rig: Rig, fits: Fits) -> tuple[Cause, ...]:
    """Return the sets of causes that explain what was seen, the likeliest first.

    A set that holds all causes of a likelier one is left out.
    """
    named: list[Causes] = []
    for causes in sorted(fits.of, key=fits.share, reverse=True):
        if fits.share(causes) < UNLIKELY:
            break
        if causes != NOTHING and not any(contains(causes, other) for other in named):
            named.append(causes)
    return tuple(cause_of(causes, rig, fits.mean(causes)) for causes in named)


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
        what = (
            "the rig states no uncertainty, so errors of its calibration cannot be told from a "
            "drift"
        )
        advice = "calibrate it with fringeworks for a sharper check"
        findings.append(Finding("uncertainty", what, advice=advice))
    if rig.residual_px is not None:
        for name, now, then in zip(
            ("camera", "projector"), seen.fits.scatter_px, rig.residual_px, strict=True
        ):
            if now > LARGE_SCATTER * then:
                what = (
                    f"corners scatter by {now:.3f} px in the {name}, at the calibration they did "
                    f"by {then:.3f} px"
                )
                causes = ("the board is blurred, badly lit or another", "the lens has changed")
                figures = {"scatter_px": now, "calibration_px": then}
                findings.append(Finding("scatter", what, causes, figures=figures))
    if len(checked.causes) > 1:
        names = " and ".join(cause.name for cause in checked.causes)
        what = f"{names} cannot be told apart by this pose"
        advice = "tilt the board more, move it nearer or further, or add poses"
        findings.append(Finding("cause", what, advice=advice))
    if checked.excess <= 1.0 and checked.verdict == "cannot tell":
        what = f"a drift of up to {checked.noticeable_mm:.2g} mm would go unnoticed"
        advice = "fill the frame with a tilted board, take sharper frames, or add poses"
        figures = {"noticeable_mm": checked.noticeable_mm}
        findings.append(Finding("blind", what, advice=advice, figures=figures))
    off = abs(checked.scale - 1.0)
    if off > LARGE_SCALE_SIGMAS * checked.scale_sigma and checked.excess > 1.0:
        size = with_sigma(100.0 * checked.scale, 100.0 * checked.scale_sigma)
        what = f"measured with this rig, the board has {size} % of its stated size"
        figures = {"scale": checked.scale, "sigma": checked.scale_sigma}
        findings.append(Finding("scale", what, figures=figures, severity="error"))
    return tuple(findings)
