"""Points of one camera of several, merged from all pairs of devices that see them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.device_pairs import Device
from fringeworks.rig.pinhole import inverse, transform
from fringeworks.rig.ray_estimates import Estimates, combined, errors_over, estimates_of
from fringeworks.rig.stereo_match import CoordinateField
from fringeworks.rig.triangulate import RESIDUAL_SIGMAS
from fringeworks.statistics.local_scatter import scatter_factor
from fringeworks.types import (
    Axis,
    BoolMap,
    ByteMap,
    Decoded,
    FloatMap,
    Frozen,
    MultiRig,
    PointCloud,
    Points,
    Reason,
)


@dataclass(frozen=True, eq=False, repr=False)
class CameraPoints(Frozen):
    """Points on the pixels of one camera, in its coordinates."""

    points: PointCloud
    """Merged from all pairs, weighted by their covariance. σ is along the camera's ray."""
    devices: tuple[Device, ...]
    """Devices that form pairs with the camera: the projector where it is calibrated, then cameras
    by number, from 0."""
    pairs: tuple[PointCloud, ...]
    """The points of every pair."""
    weights: FloatMap
    """Weight of every pair in the merged point, (h, w, pairs), 0…1; they add up to 1."""
    difference_mm: FloatMap
    """Distance along the ray from the point with the first of ``devices`` to that with another,
    (h, w), mm: of the one that differs most, in standard deviations. NaN where none is left."""
    difference_sigmas: FloatMap
    """The same over its standard deviation, (h, w)."""
    across_sigmas: FloatMap | None = None
    """Distance of the match from the epipolar line over its standard deviation, (h, w), where the
    projector only codes along both axes."""
    misfit_px: float = 0.0
    """What the distances from the epipolar lines have in excess of noise and calibration, px; it is
    part of σ. 0 with a calibrated projector."""

    @property
    def matched(self) -> BoolMap:
        """Pixels whose point another camera confirms, (h, w); without a projector, a third one."""
        return np.asarray(np.isfinite(self.difference_mm) & (self.points.reason == Reason.OK))


def camera_points(
    rig: MultiRig,
    camera: int,
    decoded: Decoded,
    alone: PointCloud,
    fields: Mapping[int, CoordinateField],
    axes: Sequence[Axis],
    *,
    doubtful: BoolMap | None = None,
) -> CameraPoints:
    """Merge the points of one camera from all pairs of devices that see them.

    Parameters
    ----------
    rig : MultiRig
    camera : int
        Number of the camera, from 0.
    decoded : Decoded
        Its projector coordinates.
    alone : PointCloud
        Its points with the projector alone.
    fields : coordinates of the other cameras, by number
    axes : the axes from which ``alone`` was triangulated
    doubtful : (h, w) bool array, optional
        Pixels that count only where another camera confirms them.

    Notes
    -----
    The point with another camera lies where that camera decodes the same projector coordinate. An
    error that depends on the place in the projector, as that of its response, is the same in both
    cameras and cancels; so do the projector's lens and its calibration. The covariance of all
    estimates has the noise that they share, because one coordinate enters all of them, and the
    calibration, whose parameters they share. The weights follow from it (``combined``). The noise
    of pairs of cameras is that of their local scatter: the σ of coordinates contains ripple, which
    cancels in them.
    """
    found = estimates_of(rig, camera, decoded, alone, fields, axes)
    noise = scattered_noise(found, alone.shape)
    errors = errors_over(rig, camera, found.devices, found.w)
    covariance = noise + found.calibration_covariance(errors)
    w, weights = combined(found.w, covariance)
    difference, sigmas = differences(found, covariance)
    apart = np.abs(np.nan_to_num(sigmas)) > RESIDUAL_SIGMAS
    values = Values(found, alone, w, weights, covariance, noise)
    reason = alone.reason.copy()
    values.put(reason, apart, Reason.RAYS_APART)
    confirmed = np.isfinite(values.as_map(sigmas))
    if doubtful is not None:
        reason[doubtful & (reason == Reason.OK) & ~confirmed] = Reason.ISOLATED
    good = values.of(reason) == Reason.OK
    return CameraPoints(
        points=values.cloud(w, weights, reason),
        devices=found.devices,
        pairs=tuple(values.pair(i, reason) for i in range(len(found.devices))),
        weights=values.as_map(np.where(good[:, None], weights, np.nan)),
        difference_mm=values.as_map(difference),
        difference_sigmas=values.as_map(sigmas),
    )


@dataclass(frozen=True, eq=False)
class Values:
    """Values of single pixels, and how they become maps and clouds."""

    found: Estimates
    alone: PointCloud
    w: FloatMap
    weights: FloatMap
    covariance: FloatMap
    noise: FloatMap

    @property
    def place(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of the pixels."""
        columns, rows = self.found.pixels.astype(np.intp).T
        return rows, columns

    def put(self, target: NDArray[Any], chosen: BoolMap, value: float) -> None:
        """Set chosen pixels of a map."""
        rows, columns = self.place
        target[rows[chosen], columns[chosen]] = value

    def of(self, source: NDArray[Any]) -> NDArray[Any]:
        """The values of a map at the pixels, (n,)."""
        return source[self.place]

    def as_map(self, values: FloatMap) -> FloatMap:
        """Values (n, …) as a map, NaN elsewhere."""
        whole = np.full((*self.alone.shape, *values.shape[1:]), np.nan, np.float32)
        whole[self.place] = values
        return whole

    def cloud(self, w: FloatMap, weights: FloatMap, reason: ByteMap) -> PointCloud:
        """Points at inverse depths that are sums of the estimates with these weights."""
        kept = self.of(reason) == Reason.OK
        length = np.linalg.norm(self.found.rays, axis=1)
        with np.errstate(all="ignore"):
            factor = np.where(kept, length / w**2, np.nan)
            sigma, noise = (
                np.sqrt(np.einsum("ni,nik,nk->n", weights, C, weights))
                for C in (self.covariance, self.noise)
            )
            points = np.where(kept[:, None], self.found.rays / w[:, None], np.nan)
        return replace(
            self.alone,
            xyz_mm=self.as_map(points),
            sigma_mm=self.as_map(sigma * factor),
            noise_mm=self.as_map(noise * factor),
            reason=reason,
        )

    def pair(self, i: int, reason: ByteMap) -> PointCloud:
        """The points of one pair alone."""
        own = reason.copy()
        self.put(own, (self.of(reason) == Reason.OK) & ~self.found.measured[:, i], Reason.OUTSIDE)
        weights = np.zeros_like(self.weights)
        weights[:, i] = 1.0
        return self.cloud(self.found.w[:, i], weights, own)


def joined_points(rig: MultiRig, cameras: Sequence[CameraPoints]) -> Points:
    """Join the points of all cameras in coordinates of the first.

    Parameters
    ----------
    rig : MultiRig
    cameras : sequence of CameraPoints
        One for every camera.

    Returns
    -------
    Points. A place that several cameras see appears once, on the first camera that sees it: points
    that an earlier camera confirms are left out. σ is along the ray of the point's own camera.
    """
    parts = []
    for k, found in enumerate(cameras):
        cloud = found.points
        kept = cloud.reason == Reason.OK
        for i, device in enumerate(found.devices):
            if not isinstance(device, str) and device < k:
                kept &= ~np.isfinite(found.pairs[i].sigma_mm)
        xyz = transform(inverse(rig.T_camera_first[k]), cloud.xyz_mm[kept].astype(np.float64))
        colour = None if cloud.colour is None else cloud.colour[kept]
        parts.append((xyz.astype(np.float32), cloud.sigma_mm[kept], cloud.noise_mm[kept], colour))
    xyz, sigma, noise = (np.concatenate([part[i] for part in parts]) for i in range(3))
    known = [part[3] for part in parts if part[3] is not None]
    colour = np.concatenate(known) if len(known) == len(parts) else None
    return Points(xyz, sigma, noise, colour=colour)


def scattered_noise(found: Estimates, shape: tuple[int, int], *, stride: int = 1) -> FloatMap:
    """Covariance of the estimates by noise, with that of camera pairs as they scatter, (n, e, e).

    The coordinates' σ may contain errors that cancel between cameras. What the cameras show is the
    noise; the rest stays with the projector. Without a projector all pairs are of cameras. Errors
    that neighbours have in common are seen between pixels that are ``stride`` apart.
    """
    stated = found.noise_covariance()
    n, e = found.w.shape
    columns, rows = found.pixels.astype(np.intp).T
    factor = np.ones((n, e))
    for i in range(int(found.devices[0] == "projector"), e):
        values, sigma = np.full(shape, np.nan), np.full(shape, np.nan)
        values[rows, columns] = found.w[:, i]
        sigma[rows, columns] = np.sqrt(stated[:, i, i])
        seen = np.ones(shape)
        for y, x in np.ndindex(stride, stride):
            part = np.s_[y::stride, x::stride]
            seen[part] = scatter_factor(values[part], sigma[part])
        factor[:, i] = seen[rows, columns]
    common = factor.min(axis=1)
    own = np.einsum("nii->ni", stated) * (factor**2 - common[:, None] ** 2)
    noise = stated * common[:, None, None] ** 2
    noise[:, np.arange(e), np.arange(e)] += own
    return np.asarray(noise)


def differences(found: Estimates, covariance: FloatMap) -> tuple[FloatMap, FloatMap]:
    """By how much other devices differ from the first along the ray, mm and σ, (n,)."""
    w, e = found.w, found.w.shape[1]
    if e == 1:
        return np.full(len(w), np.nan), np.full(len(w), np.nan)
    variance = covariance[:, 0, 0, None] - 2.0 * covariance[:, 0, 1:]
    variance = variance + np.einsum("nii->ni", covariance)[:, 1:]
    with np.errstate(all="ignore"):
        sigmas = (w[:, :1] - w[:, 1:]) / np.sqrt(np.maximum(variance, 0.0))
        length = np.linalg.norm(found.rays, axis=1)[:, None]
        mm = (1.0 / w[:, 1:] - 1.0 / w[:, :1]) * length
    most = np.argmax(np.abs(np.nan_to_num(sigmas)), axis=1)[:, None]
    return (
        np.asarray(np.take_along_axis(mm, most, axis=1)[:, 0]),
        np.asarray(np.take_along_axis(sigmas, most, axis=1)[:, 0]),
    )
