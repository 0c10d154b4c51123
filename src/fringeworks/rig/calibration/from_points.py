"""Calibration of a projector from points that calibrated cameras measured by its codes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.rig.calibration.parameters import (
    DEVICE_SIZE,
    FURTHER_SIZE,
    POSE_SIZE,
    RIG_SIZE,
    FurtherCamera,
    moved_pose,
    pinhole_of,
)
from fringeworks.rig.calibration.residuals import point_by_pose
from fringeworks.rig.camera_points import CameraPoints
from fringeworks.rig.pinhole import (
    pose,
    project,
    project_with_derivatives,
    rays,
    transform,
)
from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.types import (
    BoolMap,
    Decoded,
    FloatMap,
    InputError,
    MultiRig,
    Pinhole,
    Reason,
    multi_rig_parameters,
)

MOST_POINTS = 6000
"""Points of a scene that are used, at most. Their noise is then far below the cameras' errors."""
FEWEST_POINTS = 200
"""Fewest points of all scenes for the 15 parameters of a projector and its pose."""
TILES = 12
"""Tiles of the frame along rows and columns. Errors of pixels in one tile count as related."""
UNSEEN = 2.0
"""Factor on the standard deviations by noise. Errors of coordinates that are smooth over many
tiles, such as those of blur, do not show between tiles: without it, χ² of the 15 parameters was 3.6
per parameter in four simulated rigs with exact cameras; with it, 0.7 in three others."""
FLAT_SHARE = 0.02
"""Smallest extent of the points across the plane that fits them best, over their largest extent.
Points of one plane leave the focal length open."""
LARGEST_FOCAL_SHARE = 0.05
"""Standard deviation of the focal length, as a share of it, from which on it is not determined."""
OUTLYING = 5.0
"""Residual from which on a point is left out, in robust standard deviations of all."""
PASSES = 4
"""Fits, each without the points that the one before leaves far off; the third changes nothing."""
STEPS = 60
"""Largest number of steps of a fit; from the linear start, ten are usual."""
SETTLED = 1e-4
"""Step below which a fit has settled, in standard deviations of every parameter."""
DIFFERENCE_SIGMAS = 0.1
"""Change of a camera's parameter by which derivatives are taken, in its standard deviations."""
FIRST_DISTORTION = 4
"""Place of the first coefficient of distortion among the parameters of a device."""


@dataclass(frozen=True, eq=False)
class LitPoints:
    """Points of a scene, and the projector coordinates that light them."""

    xyz_mm: FloatMap
    """(n, 3), in coordinates of the first camera."""
    lit_px: FloatMap
    """(n, 2), column and row of the projector."""
    sigma_px: FloatMap
    """Standard deviation of ``lit_px`` by noise, (n, 2)."""
    along_mm: FloatMap
    """Standard deviation of the points by noise, along their rays, (n, 3), mm."""
    by_cameras: FloatMap
    """Derivative of the points by the parameters of the cameras, (n, 3, p)."""
    tile: NDArray[np.intp]
    """Number of the part of the frame, (n,)."""


def lit_points(rig: MultiRig, seen: CameraPoints, decoded: Decoded) -> LitPoints:
    """The points on the pixels of the first camera, evenly thinned."""
    if decoded.x is None or decoded.y is None:
        raise InputError(
            "plan: expected codes along x and y, which a projector is calibrated from, got one axis"
        )
    cloud, maps = seen.points, (decoded.x, decoded.y)
    good = (cloud.reason == Reason.OK) & np.logical_and.reduce([m.reason == 0 for m in maps])
    v, u = np.nonzero(good)
    v, u = (one[:: max(1, -(-v.size // MOST_POINTS))] for one in (v, u))
    pixels = np.stack((u, v), axis=-1).astype(np.float64)
    xyz = cloud.xyz_mm[v, u].astype(np.float64)
    away = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    noise = cloud.sigma_mm if cloud.noise_mm is None else cloud.noise_mm
    height, width = good.shape
    lit, sigma = (
        np.stack([np.asarray(getattr(m, name), np.float64)[v, u] for m in maps], axis=-1)
        for name in ("coordinate_px", "sigma_px")
    )
    return LitPoints(
        xyz,
        lit,
        sigma,
        away * noise[v, u].astype(np.float64)[:, None],
        _by_cameras(rig, seen, (v, u), pixels),
        v * TILES // height * TILES + u * TILES // width,
    )


def _by_cameras(
    rig: MultiRig, seen: CameraPoints, place: tuple[NDArray[np.intp], ...], pixels: FloatMap
) -> FloatMap:
    """Derivative of the points by the parameters of all cameras, (n, 3, p)."""
    size = len(multi_rig_parameters(len(rig.cameras), projector=False))
    found = np.zeros((len(pixels), 3, size))
    if rig.covariance is None:
        return found
    weights = np.nan_to_num(seen.weights[place].astype(np.float64))
    others = []
    for i, device in enumerate(seen.devices):
        assert not isinstance(device, str)
        xyz = seen.pairs[i].xyz_mm[place].astype(np.float64)
        others.append((device, np.where(weights[:, i, None] > 0, xyz, np.nan)))
    matches = [project(rig.cameras[d], transform(rig.T_camera_first[d], x)) for d, x in others]
    sigma = np.sqrt(np.diag(rig.covariance))
    for k in np.flatnonzero(sigma > 0):
        step = np.zeros(size)
        step[k] = DIFFERENCE_SIGMAS * sigma[k]
        sides = [
            _points_of(_moved(rig, sign * step), others, matches, weights, pixels)
            for sign in (1.0, -1.0)
        ]
        found[:, :, k] = (sides[0] - sides[1]) / (2.0 * step[k])
    return found


def _moved(rig: MultiRig, step: FloatMap) -> MultiRig:
    """A rig of cameras alone after a step of its parameters."""
    first = pinhole_of(rig.cameras[0].parameters + step[:DEVICE_SIZE], rig.cameras[0])
    further = [
        FurtherCamera(camera, T).moved(part)
        for camera, T, part in zip(
            rig.cameras[1:],
            rig.T_camera_first[1:],
            step[DEVICE_SIZE:].reshape(-1, FURTHER_SIZE),
            strict=True,
        )
    ]
    known = [one for one in further if one is not None]
    poses = np.stack([np.eye(4), *(one.T_camera_first for one in known)])
    return replace(
        rig,
        cameras=(first, *(one.camera for one in known)),
        T_camera_first=poses,
        covariance=None,
        residual_px=None,
    )


def _points_of(
    rig: MultiRig,
    others: Sequence[tuple[int, FloatMap]],
    matches: Sequence[FloatMap],
    weights: FloatMap,
    pixels: FloatMap,
) -> FloatMap:
    """The points of the same pixels and matches with other parameters of the cameras."""
    ray = rays(rig.cameras[0], pixels)
    w = np.zeros(len(pixels))
    for i, ((device, xyz), match) in enumerate(zip(others, matches, strict=True)):
        chosen = np.flatnonzero(np.isfinite(xyz[:, 2]))
        start = 1.0 / xyz[chosen, 2]
        T = rig.T_camera_first[device]
        here = transform(T, ray[chosen] / start[:, None])
        seen, by_point, _ = project_with_derivatives(rig.cameras[device], here)
        along = by_point @ T[:3, :3] @ (-ray[chosen] / start[:, None] ** 2)[..., None]
        slope, off = along[..., 0], match[chosen] - seen
        step = np.sum(slope * off, axis=1) / np.sum(slope**2, axis=1)
        w[chosen] += weights[chosen, i] * (start + step)
    return np.asarray(ray / w[:, None])


def calibrated_projector(
    rig: MultiRig, scenes: Sequence[LitPoints], size: tuple[int, int], distortion: int
) -> MultiRig:
    """Calibrate the projector from the points that it lights; the cameras stay as they are.

    Parameters
    ----------
    rig : MultiRig
        Of cameras alone.
    scenes : sequence of LitPoints
    size : (columns, rows) of the projector
    distortion : int
        Number of coefficients that are estimated, 0 to 5.

    Returns
    -------
    MultiRig with the covariance of all parameters where that of the cameras is known.

    Raises
    ------
    InputError for too few points, and for points that do not determine a projector.

    Notes
    -----
    The 15 parameters ψ minimise the squares of the residuals of all coordinates, over their
    variance by the noise of coordinates and points. A linear fit of the projection matrix is the
    start. Errors of neighbouring pixels are related: the covariance of ψ by noise is that of the
    sums of the equations over parts of the frame (a sandwich estimate by clusters). The parameters
    θ of the cameras move the points: with the normal equations A = JᵀWJ and the derivative B of the
    predicted coordinates by θ, dψ/dθ = −A⁻¹JᵀWB, which adds its share of the cameras' covariance
    and ties both.
    """
    every = _joined(scenes)
    if len(every.xyz_mm) < FEWEST_POINTS:
        raise InputError(
            f"points: expected {FEWEST_POINTS} or more that the projector lights, got "
            f"{len(every.xyz_mm)}"
        )
    _refuse_flat(every.xyz_mm)
    fit = _Fit(every, Pinhole(*size, (1.0, 1.0), (0.0, 0.0)), distortion)
    values, T, kept = fit.found(*_linear(every))
    equations = fit.equations(values, T)
    noise, by_cameras = equations.covariance(kept, every.tile), equations.by_cameras(every, T, kept)
    sigma = float(np.sqrt(noise[0, 0])) / values[0]
    if not sigma < LARGEST_FOCAL_SHARE:
        raise InputError(
            f"points: expected ones that determine the projector, got a focal length that is known "
            f"to {100 * sigma:.0f} %; let it light a scene that is deep, or several scenes"
        )
    residual = fit.residual(values, T)[kept]
    rms = float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))
    return _with_projector(rig, pinhole_of(values, fit.like), T, noise, by_cameras, rms)


def _joined(scenes: Sequence[LitPoints]) -> LitPoints:
    """The points of all scenes, with tiles of their own."""
    return LitPoints(
        np.concatenate([one.xyz_mm for one in scenes]),
        np.concatenate([one.lit_px for one in scenes]),
        np.concatenate([one.sigma_px for one in scenes]),
        np.concatenate([one.along_mm for one in scenes]),
        np.concatenate([one.by_cameras for one in scenes]),
        np.concatenate([one.tile + k * TILES**2 for k, one in enumerate(scenes)]),
    )


def _refuse_flat(xyz: FloatMap) -> None:
    extent = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
    if extent[2] < FLAT_SHARE * extent[0]:
        raise InputError(
            "points: expected ones at several depths, got those of a plane, which leaves the "
            "projector's focal length open; add scenes, such as the plane at other distances"
        )


def _linear(every: LitPoints) -> tuple[FloatMap, FloatMap]:
    """The nine parameters and the pose of a projector without distortion (a linear fit of its
    projection matrix, and the decomposition of that)."""
    xyz, lit = every.xyz_mm, every.lit_px
    middle, spread = xyz.mean(axis=0), float(xyz.std())
    centre, size = lit.mean(axis=0), float(lit.std())
    X = np.c_[(xyz - middle) / spread, np.ones(len(xyz))]
    x = (lit - centre) / size
    rows = [np.c_[X, 0 * X, -x[:, :1] * X], np.c_[0 * X, X, -x[:, 1:] * X]]
    normal = sum(part.T @ part for part in rows)
    P = np.linalg.eigh(normal)[1][:, 0].reshape(3, 4)
    to_px = np.array([[size, 0, centre[0]], [0, size, centre[1]], [0, 0, 1.0]])
    from_mm = np.eye(4) / spread
    from_mm[:3, 3], from_mm[3, 3] = -middle / spread, 1.0
    P = to_px @ P @ from_mm
    P *= np.sign(np.linalg.det(P[:, :3])) or 1.0
    K, R = scipy.linalg.rq(P[:, :3])
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    t = np.linalg.solve(K, P[:, 3])
    K = K / K[2, 2]
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], 0, 0, 0, 0, 0]), pose(R, t)


@dataclass(frozen=True, eq=False)
class _Equations:
    """The linear equations of a fit around its result."""

    jacobian: FloatMap
    """(n, 2, free)."""
    by_point: FloatMap
    """Derivative of the coordinates by the points in the projector, (n, 2, 3)."""
    weights: FloatMap
    """(n, 2), 1/px²."""
    residual: FloatMap
    """(n, 2), px."""
    free: NDArray[np.intp]

    def covariance(self, kept: BoolMap, tile: NDArray[np.intp]) -> FloatMap:
        """Covariance of the 15 parameters by noise, which neighbours share."""
        scores = np.einsum("nkf,nk->nf", self.jacobian, self.weights * self.residual)[kept]
        numbers = np.unique(tile[kept], return_inverse=True)[1]
        sums = np.stack([np.bincount(numbers, s) for s in scores.T], axis=-1)
        meat = sums.T @ sums * (len(sums) / max(len(sums) - len(self.free), 1))
        bread = self._inverse(kept)
        return self._whole(UNSEEN**2 * (bread @ meat @ bread))

    def by_cameras(self, every: LitPoints, T: FloatMap, kept: BoolMap) -> FloatMap:
        """Derivative of the 15 parameters by those of the cameras, (15, p)."""
        moved = self.by_point @ T[:3, :3] @ every.by_cameras
        rows, scale = self.rows(kept)
        goal = rows.T @ (scale * moved[kept].reshape(len(rows), -1))
        out = np.zeros((DEVICE_SIZE + POSE_SIZE, goal.shape[1]))
        out[self.free] = -self._inverse(kept) @ goal
        return out

    def _inverse(self, kept: BoolMap) -> FloatMap:
        rows, _ = self.rows(kept)
        return _inverse(rows.T @ rows)

    def rows(self, kept: BoolMap) -> tuple[FloatMap, FloatMap]:
        """The equations of the points that count over their σ, (2n, free), and 1/σ, (2n, 1)."""
        scale = np.sqrt(self.weights[kept]).reshape(-1, 1)
        return scale * self.jacobian[kept].reshape(len(scale), -1), scale

    def _whole(self, part: FloatMap) -> FloatMap:
        out = np.zeros((DEVICE_SIZE + POSE_SIZE,) * 2)
        out[np.ix_(self.free, self.free)] = part
        return out


def _inverse(A: FloatMap) -> FloatMap:
    """Inverse of normal equations, whose parameters have unlike units."""
    scale = np.sqrt(np.diag(A))
    both = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(A / both, hermitian=True) / both)


class _Fit:
    """Least squares of a projector's parameters over lit points."""

    def __init__(self, every: LitPoints, like: Pinhole, distortion: int) -> None:
        self.like = like
        self._every = every
        fixed = np.arange(FIRST_DISTORTION + distortion, DEVICE_SIZE)
        self._free = np.setdiff1d(np.arange(DEVICE_SIZE + POSE_SIZE), fixed)

    def residual(self, values: FloatMap, T: FloatMap) -> FloatMap:
        """Coordinates less those that a projector predicts, (n, 2), px."""
        points = transform(T, self._every.xyz_mm)
        return np.asarray(self._every.lit_px - project(pinhole_of(values, self.like), points))

    def equations(self, values: FloatMap, T: FloatMap) -> _Equations:
        """The equations around some parameters."""
        every = self._every
        turned = every.xyz_mm @ T[:3, :3].T
        device = pinhole_of(values, self.like)
        seen, by_point, by_device = project_with_derivatives(device, turned + T[:3, 3])
        J = np.concatenate((by_device, by_point @ point_by_pose(turned)), axis=2)
        along = np.einsum("nkp,np->nk", by_point @ T[:3, :3], every.along_mm)
        weights = 1.0 / (every.sigma_px**2 + along**2)
        return _Equations(J[:, :, self._free], by_point, weights, every.lit_px - seen, self._free)

    def found(self, values: FloatMap, T: FloatMap) -> tuple[FloatMap, FloatMap, BoolMap]:
        """The parameters that fit best, and the points that count."""
        kept: BoolMap = np.ones(len(self._every.xyz_mm), bool)
        for _ in range(PASSES):
            values, T = self._minimised(values, T, kept)
            equations = self.equations(values, T)
            off = equations.residual * np.sqrt(equations.weights)
            near = np.abs(off) < OUTLYING * robust_sigma(off[kept].ravel())
            kept = np.asarray(near.all(axis=1))
        return values, T, kept

    def _minimised(self, values: FloatMap, T: FloatMap, kept: BoolMap) -> tuple[FloatMap, FloatMap]:
        """Levenberg–Marquardt over the points that count."""
        damping, at = 1e-3, self.equations(values, T)
        cost = self._cost(at, kept)
        for _ in range(STEPS):
            rows, scale = at.rows(kept)
            A, goal = rows.T @ rows, rows.T @ (scale[:, 0] * at.residual[kept].ravel())
            step = np.zeros(DEVICE_SIZE + POSE_SIZE)
            damped = A + damping * np.diag(np.diag(A))
            step[self._free] = _inverse(damped) @ goal
            new = values + step[:DEVICE_SIZE]
            moved = moved_pose(T, step[DEVICE_SIZE:])
            trial = self.equations(new, moved) if min(new[0], new[1]) > 0 else None
            tried = np.inf if trial is None else self._cost(trial, kept)
            if trial is None or not tried <= cost:
                damping = min(10.0 * damping, 1e8)
                continue
            settled = np.sqrt(np.diag(A)) * np.abs(step[self._free]) < SETTLED
            values, T, at, cost = new, moved, trial, tried
            damping = max(0.1 * damping, 1e-12)
            if settled.all():
                break
        return values, T

    def _cost(self, at: _Equations, kept: BoolMap) -> float:
        cost = float(np.sum(at.weights[kept] * at.residual[kept] ** 2))
        return cost if np.isfinite(cost) else float("inf")


def _with_projector(
    rig: MultiRig,
    projector: Pinhole,
    T: FloatMap,
    noise: FloatMap,
    by_cameras: FloatMap,
    rms_px: float,
) -> MultiRig:
    """The rig with its projector, and the covariance of all parameters in their order."""
    covariance = None
    if rig.covariance is not None:
        size = len(rig.covariance)
        by = np.zeros((size + DEVICE_SIZE + POSE_SIZE, size))
        own = np.arange(DEVICE_SIZE, RIG_SIZE)
        cameras = np.setdiff1d(np.arange(len(by)), own)
        by[cameras], by[own] = np.eye(size), by_cameras
        covariance = by @ rig.covariance @ by.T
        covariance[np.ix_(own, own)] += noise
        covariance = 0.5 * (covariance + covariance.T)
    residual = None if rig.residual_px is None else (*rig.residual_px, rms_px)
    return replace(
        rig,
        projector=projector,
        T_projector_camera=T,
        covariance=covariance,
        residual_px=residual,
    )
