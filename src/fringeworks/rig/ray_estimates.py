"""Inverse depths along a camera's rays, from the projector and from every other camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.coded_places import inverse_depths_by_code
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
    """The projector first, where it is calibrated, then cameras."""
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
    across: FloatMap
    """How far the match is from the epipolar line, (n, e), px of the other camera; 0 for the
    projector and for one axis, along which the match is looked for on this line."""
    across_by_coordinate: FloatMap
    """Derivative of ``across`` by e_i − e_k, (n, e, axes), px per projector px."""
    across_by_pixel: FloatMap
    """Unit vector across the epipolar line, (n, e, 2)."""

    @property
    def measured(self) -> BoolMap:
        """Which estimates there are, (n, e)."""
        return np.asarray(np.isfinite(self.w))

    def at(self, kept: BoolMap) -> Estimates:
        """The estimates of some of the pixels, (n,)."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Estimates(**{k: v if k == "devices" else v[kept] for k, v in values.items()})

    def across_variance(self, errors: DeviceErrors) -> FloatMap:
        """Variance of ``across`` by the noise of the coordinates and the calibration, (n, e)."""
        both = self.own_variance[:, None] + self.other_variance
        noise = np.einsum("nia,nia->ni", self.across_by_coordinate**2, both)
        found = errors.at(self.pixels, np.nanmean(self.w, axis=1))
        for i in range(len(self.devices)):
            part = found[:, 2 * i : 2 * i + 2, 2 * i : 2 * i + 2]
            normal = self.across_by_pixel[:, i]
            noise[:, i] += np.einsum("nk,nkl,nl->n", normal, part, normal)
        return np.asarray(noise)

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
    goal, own = _codes(decoded, (v, u), axes)
    w = 1.0 / cloud.xyz_mm[v, u, 2].astype(np.float64)
    ray = rays(rig.cameras[camera], pixels)
    columns = [_by_projector(rig, camera, ray, w, own, axes)]
    columns += [_by_camera(rig, camera, other, (ray, w, goal), fields[other]) for other in fields]
    return _joined(("projector", *fields), pixels, ray, own, columns)


def _codes(
    decoded: Decoded, at: tuple[NDArray[np.intp], NDArray[np.intp]], axes: Sequence[Axis]
) -> tuple[FloatMap, FloatMap]:
    """Coordinates of some pixels along the axes and their variances, (n, a), px and px²."""
    goal = np.stack([decoded.maps[a].coordinate_px[at] for a in axes], -1).astype(np.float64)
    sigma = np.stack([decoded.maps[a].sigma_px[at] for a in axes], -1).astype(np.float64)
    return goal, sigma**2


def estimates_by_code(
    rig: MultiRig,
    camera: int,
    decoded: Sequence[Decoded],
    fields: Mapping[int, CoordinateField],
    axes: Sequence[Axis],
) -> Estimates:
    """Estimate the inverse depths of all pixels whose codes another camera decodes as well.

    Parameters
    ----------
    rig : MultiRig
    camera : int
        Number of the camera, from 0.
    decoded : Decoded of every camera
    fields : coordinates of the other cameras, by number
    axes : the axes of the codes
    """
    here = decoded[camera]
    starts = {
        other: inverse_depths_by_code(
            camera_pair(rig, camera, other), here, decoded[other], field, axes
        )
        for other, field in fields.items()
    }
    v, u = np.nonzero(np.logical_or.reduce([np.isfinite(w) for w in starts.values()]))
    pixels = np.stack((u, v), axis=-1).astype(np.float64)
    goal, own = _codes(here, (v, u), axes)
    ray = rays(rig.cameras[camera], pixels)
    columns = [
        _by_camera(rig, camera, other, (ray, starts[other][v, u], goal), fields[other])
        for other in fields
    ]
    found = _joined(tuple(fields), pixels, ray, own, columns)
    return found.at(np.asarray(found.measured.any(axis=1)))


@dataclass(frozen=True, eq=False)
class _Column:
    """The estimates by one device: what ``Estimates`` has of each."""

    w: FloatMap
    by_coordinate: FloatMap
    by_pixel: FloatMap
    other_variance: FloatMap
    across: FloatMap
    across_by_coordinate: FloatMap
    across_by_pixel: FloatMap


def _joined(
    devices: tuple[Device, ...],
    pixels: FloatMap,
    ray: FloatMap,
    own: FloatMap,
    columns: Sequence[_Column],
) -> Estimates:
    """The estimates by all devices side by side."""
    names = _Column.__dataclass_fields__
    parts = {name: np.stack([getattr(c, name) for c in columns], axis=1) for name in names}
    return Estimates(devices, pixels, ray, own_variance=own, **parts)


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
    none = np.zeros_like(own)
    return _Column(w, b, a, none, np.zeros(len(w)), none, np.zeros_like(by_w))


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
    line = by_w / np.linalg.norm(by_w, axis=1, keepdims=True)
    place, found = match(field, goal, seen, line if single else None)
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
    column = _Column(w, b, a, variance, *_across(place, seen, by_w, None if single else slope))
    for name in _Column.__dataclass_fields__:
        getattr(column, name)[~good] = np.nan if name == "w" else 0.0
    return column


def _across(
    place: FloatMap, seen: FloatMap, by_w: FloatMap, slope: FloatMap | None
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """How far matches are from the epipolar line, and the derivative by coordinates and pixel.

    Without ``slope`` the matches are on it by their making.
    """
    if slope is None:
        return np.zeros(len(place)), np.zeros((len(place), 1)), np.zeros_like(by_w)
    with np.errstate(all="ignore"):
        normal = np.stack((-by_w[:, 1], by_w[:, 0]), -1) / np.linalg.norm(by_w, axis=1)[:, None]
        across = np.sum(normal * (place - seen), axis=1)
        (xx, xy), (yx, yy) = np.moveaxis(slope, 0, -1)
        solved = (yy * normal[:, 0] - yx * normal[:, 1], xx * normal[:, 1] - xy * normal[:, 0])
        by_coordinate = np.stack(solved, axis=-1) / (xx * yy - xy * yx)[:, None]
    return across, by_coordinate, normal


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
