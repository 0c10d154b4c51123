"""Poses left out: how far the rig moves without each, against what its covariance says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from fringeworks.rig.calibration.adjusted import Adjusted, Without
from fringeworks.rig.calibration.board_shape import SMOOTH_GROUPS
from fringeworks.rig.calibration.board_view import MIN_CORNERS
from fringeworks.rig.calibration.bundle import adjust, without
from fringeworks.rig.calibration.parameters import (
    FurtherCamera,
    further_change,
    pair_rig,
    parameter_change,
)
from fringeworks.rig.calibration.poses import fit_pose
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.rig.pinhole import project, transform
from fringeworks.types import BoolMap, FloatMap, InputError, Rig

MIN_PREDICTING = 3
"""Smallest number of remaining poses for a prediction: fewer do not make a usable calibration."""
CHANCE = 1e-3
"""Probability with which errors that the corners of single poses share are taken for smooth errors
of the board. Where they are, the principal points go wrong by several σ."""
MIN_GAIN = 0.02
"""Smallest relative gain of variance that a direction of the parameters must get from the left-out
pose to count. With less, rounding and the curvature of the model decide."""


@dataclass(frozen=True)
class LeftOut:
    """What leaving out each pose in turn shows."""

    inflation: float
    """Factor ≥ 1 on all standard deviations that makes them agree with the changes; 1 where the
    poses agree within them."""
    predicted_px: tuple[float, ...]
    """Per pose: root mean square error of its projector coordinates, predicted from its camera
    corners by a calibration without this pose, px; NaN where it cannot be computed; empty where
    too few poses are left."""


def leave_poses_out(sightings: Sequence[Sighting], adjusted: Adjusted, *, free: BoolMap) -> LeftOut:
    """Leave out every pose in turn, and compare the rig's changes with its covariance.

    Parameters
    ----------
    sightings : sequence of Sighting
    adjusted : Adjusted
        Their adjustment.
    free : (24 …,) bool array
        Which of the devices' parameters are estimated.

    Notes
    -----
    If errors were independent from corner to corner, the change Δ of the parameters without a pose
    would have the covariance C₋ − C, with C₋ the covariance without the pose. The mean of
    Δᵀ (C₋ − C)⁻¹ Δ per degree of freedom is then 1. Errors that corners of one pose share (phase
    errors, blur, lenses that Brown's model does not describe) make it larger, and its root is the
    factor by which the stated standard deviations are too small. It is a jackknife over poses
    (Efron, Annals of Statistics 7, 1979, doi:10.1214/aos/1176344552) that also works with three
    poses, where a covariance from the jackknife alone would have rank two.
    """
    squares, directions = 0.0, 0
    predicted = []
    for k in range(len(adjusted.poses)):
        try:
            left = without(sightings, adjusted, k, free=free)
        except InputError:
            predicted.append(float("nan"))
            continue
        chi = _normalised_change(left, adjusted, free)
        squares, directions = squares + float(np.sum(chi**2)), directions + len(chi)
        predicted.append(_prediction(k, sightings, adjusted, left))
    inflation = max(1.0, float(np.sqrt(squares / directions))) if directions else 1.0
    enough = len(adjusted.poses) > MIN_PREDICTING
    return LeftOut(inflation, tuple(predicted) if enough else ())


def with_smooth_board(
    sightings: Sequence[Sighting], adjusted: Adjusted, *, free: BoolMap
) -> Adjusted:
    """Adjust with smooth errors of the board as well, if all poses agree on them.

    Parameters
    ----------
    sightings, adjusted, free
        As of ``leave_poses_out``.

    Notes
    -----
    Errors that the corners of single poses share look like errors of the board, and more so the
    fewer the poses; evidence of all corners together would take them for it. The board is the same
    in every pose: without any of them, its errors hardly change. Their squares are compared with
    the jackknife's variances over poses (Efron, Annals of Statistics 7, 1979,
    doi:10.1214/aos/1176344552), for each of ``SMOOTH_GROUPS``, by Fisher's distribution.
    """
    rig, poses, further = adjusted.rig, adjusted.poses, adjusted.further
    try:
        other = adjust(sightings, rig, poses, free=free, further=further, smooth=True)
        left = [without(sightings, other, k, free=free).smooth_mm for k in range(len(poses))]
    except InputError:
        return adjusted
    degrees = len(poses) - 1
    variance = degrees * np.var(left, axis=0)
    found = other.shape.smooth_mm
    for group in SMOOTH_GROUPS:
        size = np.count_nonzero(group)
        least = scipy.stats.f.isf(CHANCE / len(SMOOTH_GROUPS), size, degrees)
        if np.sum(found[group] ** 2) > least * np.sum(variance[group]):
            return other
    return adjusted


def _normalised_change(left: Without, whole: Adjusted, free: BoolMap) -> FloatMap:
    """Change of the devices in independent directions, over its expected standard deviation."""
    known = whole.devices_covariance
    C = known[np.ix_(free, free)]
    scale = np.sqrt(np.diag(C))
    L = np.linalg.cholesky(C / np.outer(scale, scale))
    gain = (left.covariance - known)[np.ix_(free, free)]
    half = np.linalg.solve(L, gain / np.outer(scale, scale))
    relative = np.linalg.solve(L, half.T)
    values, vectors = np.linalg.eigh(0.5 * (relative + relative.T))
    step = np.concatenate(
        (parameter_change(left.rig, whole.rig), further_change(left.further, whole.further))
    )
    change = np.linalg.solve(L, step[free] / scale)
    counted = values > MIN_GAIN
    return np.asarray((vectors.T @ change)[counted] / np.sqrt(values[counted]))


def _prediction(k: int, sightings: Sequence[Sighting], adjusted: Adjusted, left: Without) -> float:
    """Prediction error of the k-th pose in all cameras, px; NaN where it cannot be computed."""
    squares, corners, first = 0.0, 0, 0
    for n, s in enumerate(sightings):
        if (n if s.pose is None else s.pose) != k:
            continue
        places = left.places[first : first + len(s.index)]
        first += len(s.index)
        used = adjusted.used[n]
        left_out = replace(s.at(used), points_mm=places[used])
        if len(left_out.points_mm) < MIN_CORNERS:
            continue
        error = _errors(left_out, left.rig, left.further, adjusted.poses[k])
        squares, corners = squares + float(np.sum(error**2)), corners + len(error)
    return float(np.sqrt(squares / corners)) if corners else float("nan")


def _errors(
    seen: Sighting, first: Rig, further: Sequence[FurtherCamera], T_first_board: FloatMap
) -> FloatMap:
    """Projector coordinates of a sighting less those predicted from its camera corners, px."""
    rig, start = pair_rig(first, further, seen.camera), T_first_board
    if seen.camera:
        start = further[seen.camera - 1].T_camera_first @ start
    T = fit_pose(seen, rig, start)
    predicted = project(
        rig.projector,
        transform(rig.T_projector_camera, transform(T, seen.points_mm)),
    )
    return np.asarray(seen.projector_px - predicted)
