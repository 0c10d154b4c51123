"""Ways in which a rig may have changed since its calibration, each fitted to poses of a board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.rig.calibration.adjusted import Adjusted
from fringeworks.rig.calibration.bundle import adjust, refit
from fringeworks.rig.calibration.parameters import (
    DEVICE_SIZE,
    RIG_SIZE,
    RigPrior,
    parameter_change,
)
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.types import BoolMap, FloatMap, Rig

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
