"""Inverse depths along a camera's rays, from the projector and from every other camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fringeworks.rig.device_errors import DeviceErrors
from fringeworks.rig.device_pairs import Device, camera_pair
from fringeworks.rig.pinhole import project_with_derivatives, rays
from fringeworks.rig.stereo_match import CoordinateField, match
from fringeworks.types import Axis, BoolMap, Decoded, FloatMap, MultiRig, PointCloud, Reason

STEPS = 3
"""Newton steps to the inverse depth that fits a match best; two reach rounding."""
DEPTH_MARGIN = 0.02
"""Share by which the table of calibration errors reaches beyond the measured inverse depths."""
UNKNOWN_VARIANCE = 1e6
"""Variance of a missing estimate over the largest of its pixel: its weight is then negligible."""


@dataclass(frozen=True, eq=False)
class Estimates:
    """Inverse depths w = 1/z of n pixels of one camera, from e other devices.

    The error of estimate i is b_i · (e_k − e_i) + a_i · z_i: e_k are the errors of this camera's
    coordinates, e_i those of the other camera (none for the projector), and z_i how far the
    calibration misplaces the pixel of device i.
    """

    devices: tuple[Device, ...]
    """The projector first, then cameras."""
    pixels: FloatMap
    """(n, 2), px."""
    rays: FloatMap
    """(n, 3), with z = 1."""
    w: FloatMap
    """(n, e), 1/mm; NaN where a device gives none."""
    by_coordinate: FloatMap
    """b, (n, e, axes), 1/mm per projector px."""
    by_pixel: FloatMap
    """a, (n, e, 2), 1/mm per px of the device."""
    own_variance: FloatMap
    """Variance of e_k, (n, axes), px²."""
    other_variance: FloatMap
    """Variance of e_i, (n, e, axes), px²; 0 for the projector."""

    @property
    def measured(self) -> BoolMap:
        """Which estimates there are, (n, e)."""
        return np.asarray(np.isfinite(self.w))

    def noise_covariance(self) -> FloatMap:
        """Covariance of the estimates by the noise of the coordinates, (n, e, e), 1/mm²."""
        b = self.by_coordinate
        found = np.einsum("nia,nka,na->nik", b, b, self.own_variance)
        own = np.einsum("nia,nia->ni", b**2, self.other_variance)
        e = b.shape[1]
        found[:, np.arange(e), np.arange(e)] += own
        return np.asarray(found)

    def calibration_covariance(self, errors: DeviceErrors) -> FloatMap:
        """Covariance of the estimates by the calibration, (n, e, e), 1/mm².

        It is that of the inverse distance along the ray, times the length of the ray where z = 1.
        """
        rows = self.by_errors()
        found = errors.at(self.pixels, np.nanmean(self.w, axis=1))
        return np.asarray(rows @ found @ rows.transpose(0, 2, 1))

    def by_errors(self) -> FloatMap:
        """Derivative of the estimates by the rows of ``DeviceErrors``, (n, e, rows)."""
        n, e = self.w.shape
        rows = np.zeros((n, e, 2 * e + 1))
        for i in range(e):
            rows[:, i, 2 * i : 2 * i + 2] = -self.by_pixel[:, i]
        rows[:, :, -1] = -np.nanmean(self.w, axis=1)[:, None]
        return rows


def estimates_of(
    rig: MultiRig,
    camera: int,
    decoded: Decoded,
    cloud: PointCloud,
    fields: Mapping[int, CoordinateField],
    axes: Sequence[Axis],
) -> Estimates:
    """Estimate the inverse depths of all pixels for which a camera and the projector have one.

    Parameters
    ----------
    rig : MultiRig
    camera : int
        Number of the camera, from 0.
    decoded : Decoded
        Its coordinates.
    cloud : PointCloud
        Its points with the projector alone.
    fields : coordinates of the other cameras, by number
    axes : the axes from which ``cloud`` was triangulated
    """
    v, u = np.nonzero(cloud.reason == Reason.OK)
    pixels = np.stack((u, v), axis=-1).astype(np.float64)
    goal = np.stack([decoded.maps[a].coordinate_px[v, u] for a in axes], -1).astype(np.float64)
    own = np.stack([decoded.maps[a].sigma_px[v, u] for a in axes], -1).astype(np.float64) ** 2
    w = 1.0 / cloud.xyz_mm[v, u, 2].astype(np.float64)
    ray = rays(rig.cameras[camera], pixels)
    columns = [_by_projector(rig, camera, ray, w, own, axes)]
    columns += [_by_camera(rig, camera, other, (ray, w, goal), fields[other]) for other in fields]
    merged, b, a, variance = (np.stack(part, axis=1) for part in zip(*columns, strict=True))
    return Estimates(("projector", *fields), pixels, ray, merged, b, a, own, variance)


_Column = tuple[FloatMap, FloatMap, FloatMap, FloatMap]


def _by_projector(
    rig: MultiRig, camera: int, ray: FloatMap, w: FloatMap, own: FloatMap, axes: Sequence[Axis]
) -> _Column:
    """w, b, a and the other device's variance of the points with the projector."""
    _, by_w = _seen(rig, camera, "projector", ray, w)
    chosen = by_w[:, [0 if a == "x" else 1 for a in axes]]
    weighted = chosen / own
    b = weighted / np.sum(chosen * weighted, axis=1, keepdims=True)
    a = np.zeros_like(by_w)
    for k, axis in enumerate(axes):
        a[:, 0 if axis == "x" else 1] = b[:, k]
    return w, b, a, np.zeros_like(own)


def _by_camera(
    rig: MultiRig,
    camera: int,
    other: int,
    known: tuple[FloatMap, FloatMap, FloatMap],
    field: CoordinateField,
) -> _Column:
    """The same of the points with another camera; NaN where it does not see them."""
    ray, start, goal = known
    w = start.copy()
    seen, by_w = _seen(rig, camera, other, ray, w)
    single = len(field.axes) == 1
    length = np.linalg.norm(by_w, axis=1, keepdims=True)
    place, found = match(field, goal, seen, by_w / length if single else None)
    for _ in range(STEPS):
        seen, by_w = _seen(rig, camera, other, ray, w)
        w = w + np.sum(by_w * (place - seen), axis=1) / np.sum(by_w**2, axis=1)
    slope = field.slope_at(place)
    with np.errstate(all="ignore"):
        if single:
            rate = np.einsum("nk,nk->n", slope[:, 0], by_w)
            b, a = (1.0 / rate)[:, None], slope[:, 0] / rate[:, None]
        else:
            a = by_w / np.sum(by_w**2, axis=1, keepdims=True)
            safe = np.where(found[:, None, None], slope, np.eye(2))
            b = np.linalg.solve(safe.transpose(0, 2, 1), a[..., None])[..., 0]
    variance = field.variance_at(place)
    good = found & (w > 0) & np.isfinite(b).all(axis=1) & np.isfinite(variance).all(axis=1)
    blank = ~good
    w[blank], b[blank], a[blank], variance[blank] = np.nan, 0.0, 0.0, 0.0
    return w, b, a, variance


def _seen(
    rig: MultiRig, camera: int, other: Device, ray: FloatMap, w: FloatMap
) -> tuple[FloatMap, FloatMap]:
    """Where a device sees points at 1/z = w on a camera's rays, px, and the derivative by w."""
    pair = camera_pair(rig, camera, other)
    R, t = pair.T_projector_camera[:3, :3], pair.T_projector_camera[:3, 3]
    with np.errstate(all="ignore"):
        seen = ray @ R.T + w[:, None] * t
        seen = np.where(seen[:, 2:] > 0, seen, np.nan)
        pixel, by_point, _ = project_with_derivatives(pair.projector, seen)
    return pixel, by_point @ t


def errors_over(rig: MultiRig, camera: int, devices: Sequence[Device], w: FloatMap) -> DeviceErrors:
    """Tabulate the calibration's errors for one camera, over the inverse depths that occur."""
    low, high = float(np.nanmin(w)), float(np.nanmax(w))
    return DeviceErrors.of(
        rig, camera, devices, (low * (1.0 - DEPTH_MARGIN), high * (1.0 + DEPTH_MARGIN))
    )


def combined(w: FloatMap, covariance: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Merge estimates by their covariance, with weights that are not negative.

    Parameters
    ----------
    w : (n, e) array
        Estimates; NaN where there is none.
    covariance : (n, e, e) array

    Returns
    -------
    The merged values (n,), and the weights (n, e), which add up to 1.

    Notes
    -----
    The weights C⁻¹ 1 / (1ᵀ C⁻¹ 1) have the least variance. Estimates whose errors are much alike
    can get negative weights, which rely on the difference of two nearly equal errors. Such
    estimates are left out instead. The variance is then still at most that of the best estimate.
    """
    e = w.shape[1]
    kept = np.isfinite(w)
    unit = np.eye(e)
    worst = np.max(np.einsum("nii->ni", covariance) * kept, axis=1)
    weights = np.zeros(w.shape)
    open_ = np.arange(len(w))
    for _ in range(e):
        both = kept[open_, :, None] & kept[open_, None, :]
        missing = ~kept[open_, :, None] * unit * (UNKNOWN_VARIANCE * worst[open_])[:, None, None]
        C = np.where(both, covariance[open_], 0.0) + missing
        scale = np.sqrt(np.einsum("nii->ni", C))
        right = (1.0 / scale)[..., None]
        relative = C / (scale[:, :, None] * scale[:, None, :])
        solved = np.linalg.solve(relative, right)[..., 0] / scale
        solved *= kept[open_]
        weights[open_] = solved / solved.sum(axis=1, keepdims=True)
        least = np.argmin(weights[open_], axis=1)
        negative = weights[open_, least] < 0
        if not negative.any():
            break
        kept[open_[negative], least[negative]] = False
        open_ = open_[negative]
    return np.einsum("ne,ne->n", weights, np.nan_to_num(w)), weights
