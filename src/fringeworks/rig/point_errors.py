"""What an error of a rig's parameters does to the points that it measures."""

from __future__ import annotations

import numpy as np

from fringeworks.rig.pinhole import project, rays
from fringeworks.rig.ray_depth import has_structure, main_axis, structure_variance, w_by_parameters
from fringeworks.types import FloatMap, PointCloud, Rig

NEGLIGIBLE = 1e-12
"""Share of the largest variance of a covariance below which a direction of it is left out."""


def points_by_parameters(rig: Rig, points_mm: FloatMap, *, both: bool = False) -> FloatMap:
    """Derivative of measured points by the rig's 24 parameters.

    Parameters
    ----------
    rig : Rig
    points_mm : (n, 3) array
        In camera coordinates, in front of both devices.
    both : bool
        Whether the points come from both axes of the projector; by default from its main one.

    Returns
    -------
    (n, 3, 24) array, mm per unit of ``RIG_PARAMETERS``

    Notes
    -----
    The pixels of camera and projector stay what they were: with the ray r, w = 1/z and P = r/w,
    ∂P/∂θ = ∂r/∂θ / w − r ∂w/∂θ / w² (theory §8).
    """
    pixels = project(rig.camera, points_mm)
    ray = rays(rig.camera, pixels)
    w = 1.0 / points_mm[:, 2]
    w_by, turned = w_by_parameters(rig, pixels, w, None if both else main_axis(rig))
    found = -ray[:, :, None] * (w_by / w[:, None] ** 2)[:, None, :]
    found[:, :2, : turned.shape[2]] += turned / w[:, None, None]
    return np.asarray(found)


def point_errors(rig: Rig, points_mm: FloatMap, cloud: PointCloud) -> FloatMap | None:
    """Errors of points that a rig's covariance stands for, as independent parts.

    Parameters
    ----------
    rig : Rig
    points_mm : (n, 3) array
    cloud : PointCloud
        Cloud that contains the points.

    Returns
    -------
    (n, 3, k) array, mm: E with the covariance E Eᵀ of all points together; None for a rig without
    a covariance.
    """
    if rig.covariance is None:
        return None
    root = root_of(rig.covariance)
    both = cloud.residual_px is not None
    parts = points_by_parameters(rig, points_mm, both=both) @ root
    if has_structure(rig) and len(points_mm):
        parts = np.concatenate((parts, _structure(rig, points_mm, both=both)), axis=2)
    return np.asarray(parts)


def root_of(covariance: FloatMap) -> FloatMap:
    """Independent parts of a covariance, (n, k): it is their product with their transpose."""
    variances, directions = np.linalg.eigh(covariance)
    kept = variances > NEGLIGIBLE * variances.max(initial=0.0)
    return np.asarray(directions[:, kept] * np.sqrt(variances[kept]))


def _structure(rig: Rig, points_mm: FloatMap, *, both: bool) -> FloatMap:
    """Errors of points by the place in a device's frame, as independent parts, (n, 3, 10), mm."""
    pixels = project(rig.camera, points_mm)
    w = 1.0 / points_mm[:, 2]
    variance = structure_variance(rig, pixels, w, None if both else main_axis(rig))
    size = np.sqrt(variance) / w
    return np.asarray(points_mm[:, :, None] * (size[:, None] * places_share(pixels))[:, None, :])


def places_share(pixels: FloatMap) -> FloatMap:
    """Parts of an error of variance 1 that depends on the place in a device's frame, (n, 10).

    Half of the variance is common to all pixels, half to those of each of 3 × 3 parts of the frame
    that they span: corners do not show over which distance such an error changes.
    """
    low, span = pixels.min(axis=0), np.maximum(np.ptp(pixels, axis=0), 1.0)
    column, row = np.minimum((3.0 * (pixels - low) / span).astype(int), 2).T
    share = np.column_stack((np.ones(len(pixels)), np.eye(9)[3 * row + column]))
    return np.asarray(np.sqrt(0.5) * share)
