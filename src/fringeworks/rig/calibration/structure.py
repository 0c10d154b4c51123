"""Structure of the residuals: errors of a device that depend on the place in its frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.calibration.adjusted import Adjusted
from fringeworks.rig.calibration.residuals import Sighting, corners_of
from fringeworks.types import BoolMap, FloatMap

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
    Root mean square per coordinate of both devices, px; 0 where none is certain.
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
    Root mean square per coordinate, px; 0 where it is not certain.

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
    products = 0.5 * np.sum(residual[a] * residual[b], axis=1)
    variance = 0.5 * np.sum(residual**2, axis=1)
    sigma = float(np.sqrt(0.5 * np.sum(variance[a] * variance[b])))
    certain = float(products.sum()) > CERTAIN_SIGMAS * sigma > 0.0
    return float(np.sqrt(products.mean())) if certain else 0.0


def _spacing(places: FloatMap, pose: NDArray[np.intp]) -> float:
    """Median distance of corners of one pose from their nearest neighbours, px."""
    nearest = []
    for k in np.unique(pose):
        own = places[pose == k]
        nearest.append(scipy.spatial.cKDTree(own).query(own, 2)[0][:, 1])
    return float(np.median(np.concatenate(nearest)))
