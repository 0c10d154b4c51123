"""What an error of a rig's parameters does to the pixels at which its devices see a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from fringeworks.rig.device_pairs import Device, camera_pair, pair_by_parameters
from fringeworks.rig.pinhole import rays
from fringeworks.rig.ray_depth import projector_by_parameters
from fringeworks.types import FloatMap, MultiRig

NODES = (25, 31, 9)
"""Rows, columns and inverse depths of nodes at which covariances are computed. Between them the
logarithms of the variances and the correlations are interpolated linearly: over a frame that a
calibration has not covered the variances change by orders of magnitude. The error
is 1 % of the variance (root mean square), and below 6 % at 99 of 100 places
(tests/test_cameras.py)."""
NO_VARIANCE = 1e-60
"""Lower bound on a variance whose logarithm is taken: a rig that states no uncertainty has 0."""


@dataclass(frozen=True, eq=False)
class DeviceErrors:
    """Covariance of the pixels of several devices, of points on one camera's rays.

    Rows are two pixel coordinates for each device, px, then the relative change of the length of
    the ray.
    """

    table: FloatMap
    """Logarithms of the variances on the diagonal, beside it the correlations, (rows, rows,
    *NODES)."""
    frame: tuple[int, int]
    """Rows and columns of the camera."""
    inverse_mm: tuple[float, float]
    """Smallest and largest inverse depth of the nodes, 1/mm."""

    @classmethod
    def of(
        cls,
        rig: MultiRig,
        camera: int,
        devices: Sequence[Device],
        inverse_mm: tuple[float, float],
    ) -> Self:
        """Tabulate the covariances over a camera's frame and a range of inverse depths."""
        h, w = rig.cameras[camera].shape
        v, u, depth = np.meshgrid(
            np.linspace(0, h - 1, NODES[0]),
            np.linspace(0, w - 1, NODES[1]),
            np.linspace(*inverse_mm, NODES[2]),
            indexing="ij",
        )
        pixels = np.stack((u.ravel(), v.ravel()), axis=-1)
        rows = 2 * len(devices) + 1
        if rig.covariance is None or not rig.covariance.any():
            none = np.zeros((rows, rows, *NODES))
            none[np.arange(rows), np.arange(rows)] = np.log(NO_VARIANCE)
            return cls(none, (h, w), inverse_mm)
        stacked = pixel_errors(rig, camera, devices, pixels, depth.ravel())
        table = np.moveaxis(stacked @ stacked.transpose(0, 2, 1), 0, -1)
        each = np.arange(rows)
        variance = np.maximum(table[each, each], NO_VARIANCE)
        table /= np.sqrt(variance[:, None] * variance[None])
        table[each, each] = np.log(variance)
        return cls(_filled(table.reshape(rows, rows, *NODES)), (h, w), inverse_mm)

    def at(self, pixels: FloatMap, inverse_mm: FloatMap) -> FloatMap:
        """Covariance at points on the camera's rays, (n, rows, rows)."""
        h, w = self.frame
        low, high = self.inverse_mm
        place = np.stack(
            (
                pixels[:, 1] * ((NODES[0] - 1) / (h - 1)),
                pixels[:, 0] * ((NODES[1] - 1) / (w - 1)),
                (inverse_mm - low) * ((NODES[2] - 1) / (high - low)),
            )
        )
        rows = len(self.table)
        found = np.empty((len(pixels), rows, rows))
        for i in range(rows):
            for k in range(i + 1):
                value = scipy.ndimage.map_coordinates(
                    self.table[i, k], place, order=1, mode="nearest"
                )
                found[:, i, k] = found[:, k, i] = value
        each = np.arange(rows)
        sigma = np.exp(0.5 * found[:, each, each])
        found[:, each, each] = 1.0
        found *= sigma[:, :, None] * sigma[:, None, :]
        return found


def pixel_errors(
    rig: MultiRig,
    camera: int,
    devices: Sequence[Device],
    pixels: FloatMap,
    inverse_mm: FloatMap,
) -> FloatMap:
    """Errors that a rig's covariance stands for, as independent parts.

    Parameters
    ----------
    rig : MultiRig
        With a covariance.
    camera : int
    devices : sequence of devices
    pixels : (n, 2) array
        Of the camera, px.
    inverse_mm : (n,) array
        Inverse depths of the points, 1/mm.

    Returns
    -------
    (n, rows, parameters) array E: the rows of all points together have the covariance E Eᵀ. NaN for
    points that are not in front of a device.
    """
    assert rig.covariance is not None
    root = _root(rig.covariance)
    parts, longer = [], None
    for device in devices:
        pair = camera_pair(rig, camera, device)
        _, by, _, turned = projector_by_parameters(pair, pixels, inverse_mm)
        of_pair = pair_by_parameters(rig, camera, device) @ root
        parts.append(by @ of_pair)
        if longer is None:
            ray = rays(pair.camera, pixels)
            share = np.einsum("ni,nij->nj", ray[:, :2], turned)
            share /= np.sum(ray**2, axis=1)[:, None]
            longer = (share @ of_pair[: share.shape[1]])[:, None]
    assert longer is not None
    return np.concatenate((*parts, longer), axis=1)


def _root(covariance: FloatMap) -> FloatMap:
    """A matrix E with the covariance E Eᵀ."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _filled(table: FloatMap) -> FloatMap:
    """The table with the nearest node where a point is not in front of a device."""
    known = np.isfinite(table).all(axis=(0, 1))
    if known.all() or not known.any():
        return np.nan_to_num(table)
    nearest = scipy.ndimage.distance_transform_edt(
        ~known, return_distances=False, return_indices=True
    )
    return np.asarray(table[(slice(None), slice(None), *nearest)])
