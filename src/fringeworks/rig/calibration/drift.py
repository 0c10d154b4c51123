"""Whether a rig still holds: its drift since the calibration, by one pose of a board or several."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import scipy

from fringeworks.rig.calibration.adjusted import Adjusted
from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_points import (
    by_rig,
    corner_points,
    displacement,
    flatness_mm,
    scale_of,
)
from fringeworks.rig.calibration.bundle import adjust, refit
from fringeworks.rig.calibration.calibrate import Observation, refined, sighting_of
from fringeworks.rig.calibration.diagnosis import ripple_findings
from fringeworks.rig.calibration.parameters import (
    DEVICE_SIZE,
    RIG_SIZE,
    RigPrior,
    parameter_change,
)
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

POSSIBLE_TURN_RAD = 0.1
"""Standard deviation of the rotation in the prior of a rig that was knocked, rad: 6°. A larger turn
moves the light off the object, which nobody needs a check for."""
POSSIBLE_SHIFT = 0.1
"""The same for a translation, over the baseline."""
POSSIBLE_FOCUS = 0.05
"""The same for focal lengths, relative. Refocusing from infinity to 0.5 m makes the focal length of
a lens of 25 mm longer by 5 %."""
SHARED_SCATTER = 2.0
"""Factor on the scatter of corners within one pose. Corners of one pose share errors (blur, light,
edges along the pixel grid), which no residual shows; between poses of real photographs the factor
is up to 3 (docs/rig.md), on the virtual rig 0.9 to 1.3."""
SMALLEST_VARIANCE = 1e-13
"""Smallest eigenvalue of a correlation matrix that is inverted; rig files hold 12 digits."""

ROTATION = slice(2 * DEVICE_SIZE, 2 * DEVICE_SIZE + 3)
"""Place of the rotation among the parameters of a rig."""
TRANSLATION = slice(2 * DEVICE_SIZE + 3, RIG_SIZE)
"""Place of the translation among the parameters of a rig."""
EVERYTHING = "everything"
"""Name of the change in which all others are possible together."""
SIGMA_DIGITS = 2
"""Digits of a standard deviation that are shown; more would not be known."""
MAX_DIGITS = 6
"""Largest number of decimals that are shown."""
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


@dataclass(frozen=True, eq=False)
class Fit:
    """A rig that may have changed in certain directions, fitted to poses of a board."""

    freedom: int
    """Number of directions."""
    cost: float
    """Weighted sum of squares of all residuals."""
    rig: Rig
    """The most likely rig now, with its covariance."""
    change: FloatMap
    """By how much the parameters have changed since the calibration, (24,)."""
    covariance: FloatMap
    """Covariance of ``change``, (24, 24)."""


def possible_changes(rig: Rig) -> dict[str, FloatMap]:
    """Return the directions in which a rig may have changed, (24, k), by name.

    Columns are as long as the change's standard deviation in the prior.
    """
    unit = np.eye(RIG_SIZE)
    turn = POSSIBLE_TURN_RAD * unit[:, ROTATION]
    shift = POSSIBLE_SHIFT * rig.baseline_mm * unit[:, TRANSLATION]
    longer = POSSIBLE_SHIFT * unit[:, TRANSLATION] @ rig.T_projector_camera[:3, 3]
    focus = []
    for first, device in ((0, rig.camera), (DEVICE_SIZE, rig.projector)):
        focus.append(POSSIBLE_FOCUS * unit[:, first : first + 2] @ device.focal_px)
    camera, projector = np.array(focus)[:, :, None]
    return {
        "nothing": np.zeros((RIG_SIZE, 0)),
        "baseline": longer[:, None],
        "camera focus": camera,
        "projector focus": projector,
        "rotation": turn,
        "translation": shift,
        "pose": np.hstack((turn, shift)),
        EVERYTHING: np.hstack((turn, shift, camera, projector)),
    }


def fit_changes(
    rig: Rig, sightings: Sequence[Sighting], poses: Sequence[FloatMap]
) -> tuple[dict[str, Fit], Adjusted]:
    """Fit every possible change of a rig to poses of a board.

    Parameters
    ----------
    rig : Rig
        As it was calibrated. Without a covariance, it is taken as exact.
    sightings : sequence of Sighting
        One or more.
    poses : sequence of (4, 4) arrays
        Start: T_camera_board of every sighting, mm.

    Returns
    -------
    The fits by the names of ``possible_changes``, and the adjustment from which their weights come.

    Notes
    -----
    The parameters of the rig now are those of the calibration, normal with its covariance C, plus
    the change A a with a standard normal: their prior is normal with C + A Aᵀ. Scatter, weights
    and the board's prior are estimated once, with every change possible. Differences of the costs
    are then those of a likelihood ratio test, χ² with as many degrees of freedom as directions.
    """
    changes = possible_changes(rig)
    known = np.zeros((RIG_SIZE, RIG_SIZE)) if rig.covariance is None else rig.covariance
    all_free = known + changes[EVERYTHING] @ changes[EVERYTHING].T
    free = np.diag(all_free) > 0
    prior = RigPrior(rig, _inverse(all_free))
    adjusted = adjust(sightings, rig, poses, free=free, prior=prior)
    scatter = SHARED_SCATTER * adjusted.weighting.scatter
    if rig.residual_px is not None:
        # In a single pose, errors of corners look like errors of the board's print.
        scatter[:, 0] = np.maximum(scatter[:, 0], rig.residual_px[0] / np.sqrt(2.0))
    weighted = replace(adjusted, weighting=replace(adjusted.weighting, scatter=scatter))
    fits = {name: _fit(rig, sightings, weighted, known, A) for name, A in changes.items()}
    return fits, adjusted


def _fit(
    rig: Rig, sightings: Sequence[Sighting], adjusted: Adjusted, known: FloatMap, A: FloatMap
) -> Fit:
    """Fit a rig whose parameters may have changed in the directions A (24, k)."""
    before = known + A @ A.T
    free: BoolMap = np.diag(before) > 0
    # What is not free stays at the calibration's value.
    start = replace(adjusted, rig=replace(rig, covariance=None))
    precision = _inverse(before)
    found, cost = refit(sightings, start, free=free, prior=RigPrior(rig, precision))
    assert found.covariance is not None
    gain = A.T @ precision
    change = A @ gain @ parameter_change(found, rig)
    left = np.eye(A.shape[1]) + gain @ (found.covariance - before) @ gain.T
    return Fit(A.shape[1], cost, found, change, A @ left @ A.T)


def _inverse(covariance: FloatMap) -> FloatMap:
    """Invert a covariance; parameters without a variance get zeros."""
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0, 1.0 / np.where(sigma > 0, sigma, 1.0), 0.0)
    free = sigma > 0
    found = np.zeros_like(covariance)
    values, vectors = np.linalg.eigh((covariance * np.outer(scale, scale))[np.ix_(free, free)])
    kept = vectors / np.sqrt(np.maximum(values, SMALLEST_VARIANCE * max(values.max(initial=0), 1)))
    found[np.ix_(free, free)] = kept @ kept.T
    return np.asarray(found * np.outer(scale, scale))


@dataclass(frozen=True)
class Cause:
    """A change of a rig that explains what was seen."""

    name: str
    """Short name: rotation, translation, baseline, camera focus, projector focus or pose."""
    text: str
    """The change with its size and standard deviation."""


def cause_of(name: str, rig: Rig, fit: Fit) -> Cause:
    """Describe a fitted change of a rig."""
    if name == "rotation":
        return Cause(name, f"the projector {_turn(fit)}")
    if name == "translation":
        return Cause(name, f"the projector {_shift(fit)}")
    if name == "baseline":
        along = rig.T_projector_camera[:3, 3] / rig.baseline_mm
        share = 100.0 * float(fit.change[TRANSLATION] @ along) / rig.baseline_mm
        sigma = 100.0 * _sigma(fit, TRANSLATION, along) / rig.baseline_mm
        return Cause(
            name,
            f"the baseline became {with_sigma(abs(share), sigma)} % "
            f"{'longer' if share > 0 else 'shorter'}, or the board's squares are so much "
            f"{'smaller' if share > 0 else 'larger'} than stated",
        )
    if name == "pose":
        return Cause(name, f"the projector {_turn(fit)}, and {_shift(fit)}")
    device, first = ("camera", 0) if name == "camera focus" else ("projector", DEVICE_SIZE)
    focal = (rig.camera if first == 0 else rig.projector).focal_px[0]
    share = 100.0 * float(fit.change[first]) / focal
    sigma = 100.0 * float(np.sqrt(fit.covariance[first, first])) / focal
    return Cause(
        name,
        f"the {device} was refocused: its focal length is {with_sigma(abs(share), sigma)} % "
        f"{'longer' if share > 0 else 'shorter'}",
    )


def _turn(fit: Fit) -> str:
    omega = np.degrees(fit.change[ROTATION])
    size = float(np.linalg.norm(omega))
    sigma = np.degrees(_sigma(fit, ROTATION, omega / size))
    shares = ", ".join(f"{axis} {value:+.3f}°" for axis, value in zip("xyz", omega, strict=True))
    return (
        f"turned against the camera by {with_sigma(size, sigma)}° (about the projector's axes "
        f"{shares})"
    )


def _shift(fit: Fit) -> str:
    shift = fit.change[TRANSLATION]
    size = float(np.linalg.norm(shift))
    sigma = _sigma(fit, TRANSLATION, shift / size)
    shares = ", ".join(f"{axis} {value:+.2f} mm" for axis, value in zip("xyz", shift, strict=True))
    return f"moved against the camera by {with_sigma(size, sigma)} mm ({shares})"


def with_sigma(value: float, sigma: float) -> str:
    """A value and its standard deviation, as many digits as that says."""
    place = math.floor(math.log10(sigma)) if sigma > 0 else -MAX_DIGITS
    digits = min(max(SIGMA_DIGITS - 1 - place, 0), MAX_DIGITS)
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"


def _sigma(fit: Fit, part: slice, along: FloatMap) -> float:
    """Standard deviation of a part of the change along a unit vector."""
    return math.sqrt(max(float(along @ fit.covariance[part, part] @ along), 0.0))


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
            f"rotation and translation do not explain{likely}; calibrate again",
            findings=ripple_findings(observations),
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
        what = (
            "the rig states no uncertainty, so errors of its calibration cannot be told from a "
            "drift"
        )
        advice = "calibrate it with fringeworks for a sharper check"
        findings.append(Finding("uncertainty", what, advice=advice))
    if rig.residual_px is not None:
        for name, now, then in zip(
            ("camera", "projector"), seen.scatter_px, rig.residual_px, strict=True
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
