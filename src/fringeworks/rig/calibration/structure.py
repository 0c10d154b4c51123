"""Structure of the residuals: errors of a device that depend on the place in its frame."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.calibration.adjusted import Adjusted
from fringeworks.rig.calibration.residuals import Sighting, corners_of
from fringeworks.types import BoolMap, FloatMap, Rig

REACH = 0.5
"""Largest distance of two corners that are taken for one place in a frame, over the usual distance
of neighbouring corners: a structure that corners can show hardly changes within it."""
CERTAIN_SIGMAS = 5.0
"""Smallest structure that counts, in standard deviations of what independent residuals give. Twelve
simulated calibrations without structure gave at most 2.4."""


def structures_px(sightings: Sequence[Sighting], adjusted: Adjusted) -> tuple[float, float]:
    """Estimate the errors of camera and projector that depend on the place in their frames.

    Parameters
    ----------
    sightings : sequence of Sighting
        Of one camera.
    adjusted : Adjusted
        Their adjustment.

    Returns
    -------
    Root mean square of the worse coordinate of both devices, px; 0 where none is certain.
    """
    corners, used = corners_of(sightings), np.concatenate(adjusted.used)
    camera = np.concatenate(adjusted.camera_residual_px)
    seen = np.concatenate(adjusted.projector_residual_px)
    projector = seen - np.einsum("nij,nj->ni", corners.by_pixel, camera)
    pose, point = corners.pose[used], corners.index[used]
    return (
        structure_px(corners.camera_px[used], camera[used], pose, point),
        structure_px(corners.projector_px[used], projector[used], pose, point),
    )


def structure_px(
    places: FloatMap, residual: FloatMap, pose: NDArray[np.intp], point: NDArray[np.intp]
) -> float:
    """Estimate the error that residuals share where a device sees corners at the same place.

    Parameters
    ----------
    places : (n, 2) array
        Corners in the device's frame, px.
    residual : (n, 2) array, px
    pose, point : (n,) int arrays
        Numbers of every corner's pose and point of the board.

    Returns
    -------
    Root mean square of the worse of both coordinates, px; 0 where neither is certain.

    Notes
    -----
    The mean product of two residuals at one place, from different poses and different points of the
    board, is the variance of what the place alone determines: the sill of a variogram without its
    nugget (Matheron, Economic Geology 58, 1963, doi:10.2113/gsecongeo.58.8.1246). Errors that
    corners of a pose share, and errors of the board's print, do not enter.
    """
    pairs = scipy.spatial.cKDTree(places).query_pairs(
        REACH * _spacing(places, pose), output_type="ndarray"
    )
    a, b = pairs.T
    other: BoolMap = (pose[a] != pose[b]) & (point[a] != point[b])
    a, b = a[other], b[other]
    if not len(a):
        return 0.0
    products = residual[a] * residual[b]
    sigma = np.sqrt(np.sum(products**2, axis=0))
    certain = products.sum(axis=0) > CERTAIN_SIGMAS * sigma
    return float(np.sqrt(np.max(products.mean(axis=0), where=certain, initial=0.0)))


def in_projector_px(rig: Rig, structure: tuple[float, float]) -> float:
    """Return the errors of both devices as one of projector coordinates, px."""
    camera, projector = structure
    return math.hypot(projector, camera * rig.projector.focal_px[0] / rig.camera.focal_px[0])


def _spacing(places: FloatMap, pose: NDArray[np.intp]) -> float:
    """Median distance of corners of one pose from their nearest neighbours, px."""
    nearest = []
    for k in np.unique(pose):
        own = places[pose == k]
        nearest.append(scipy.spatial.cKDTree(own).query(own, 2)[0][:, 1])
    return float(np.median(np.concatenate(nearest)))
