"""Projector coordinates that a range of depths allows on the rays of camera pixels (theory §8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.rig.pinhole import project, rays, transform
from fringeworks.rig.ray_depth import axis_length, projector_by_parameters
from fringeworks.types import Axis, FloatMap, InputError, Rig

ROOM_SIGMAS = 5.0
"""Standard deviations by which both ends of an interval of coordinates are widened: of the decoded
coordinate and of the rig's calibration. Normal errors exceed five in one of two million pixels."""
NODES = (33, 41)
"""Rows and columns of nodes over the camera's frame between which the ends of the intervals are
interpolated by cubic splines, to better than 0.01 px for the lenses of the standard rig."""


@dataclass(frozen=True)
class Interval:
    """Coordinates along one axis that a range of depths allows, per pixel or per node."""

    middle: FloatMap
    """Middle of the interval, px."""
    half: FloatMap
    """Half its length, px; negative where the projector lights no point of the range."""
    variance: FloatMap
    """Variance of the coordinate of a known point by the rig's calibration, px²."""

    @property
    def reach(self) -> FloatMap:
        """Half the length of the interval with room for the calibration alone, px."""
        return self.half + ROOM_SIGMAS * np.sqrt(self.variance)


def node_pixels(rig: Rig) -> FloatMap:
    """Camera pixels of the nodes, (n, 2)."""
    h, w = rig.camera.shape
    v, u = np.meshgrid(
        np.linspace(0, h - 1, NODES[0]), np.linspace(0, w - 1, NODES[1]), indexing="ij"
    )
    return np.stack((u.ravel(), v.ravel()), axis=-1)


def coordinates_at(rig: Rig, pixels: FloatMap, z_mm: float, axis: Axis) -> FloatMap:
    """Projector coordinates of the points at a depth on the rays of pixels, (n,), px."""
    points = transform(rig.T_projector_camera, rays(rig.camera, pixels) * z_mm)
    if (points[:, 2] <= 0.0).any():
        raise InputError(
            f"depth range: expected depths in front of the projector, got {z_mm:g} mm, which is "
            "behind it in a part of the frame"
        )
    return np.asarray(project(rig.projector, points)[:, 0 if axis == "x" else 1])


def variance_at(rig: Rig, pixels: FloatMap, axis: Axis, depth_mm: tuple[float, float]) -> FloatMap:
    """Variance of the coordinates of known points by the calibration, (n,), px²; the larger one of
    both depths."""
    residual = 0.0 if rig.residual_px is None else float(np.hypot(*rig.residual_px))
    variance = np.full(len(pixels), residual**2)
    if rig.covariance is None:
        return variance
    k = 0 if axis == "x" else 1
    by = [
        projector_by_parameters(rig, pixels, np.full(len(pixels), 1.0 / z))[1][:, k]
        for z in depth_mm
    ]
    covariance = rig.covariance
    each = [np.einsum("nj,nj->n", np.einsum("ni,ij->nj", b, covariance), b) for b in by]
    return np.asarray(variance + np.maximum(np.maximum(*each), 0.0))


def interval_at(rig: Rig, pixels: FloatMap, axis: Axis, depth_mm: tuple[float, float]) -> Interval:
    """The interval of coordinates at pixels (n, 2)."""
    low, high = (coordinates_at(rig, pixels, z, axis) for z in depth_mm)
    return clipped(low, high, variance_at(rig, pixels, axis, depth_mm), axis_length(rig, axis))


def clipped(low: FloatMap, high: FloatMap, variance: FloatMap, length: int) -> Interval:
    """The interval between two ends in any order, within the projector's frame."""
    first = np.maximum(np.minimum(low, high), -0.5)
    last = np.minimum(np.maximum(low, high), length - 0.5)
    return Interval(0.5 * (first + last), 0.5 * (last - first), variance)
