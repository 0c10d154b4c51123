"""Triangulation: projector coordinates and a calibrated rig to points in mm (theory §8, §9)."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks import _core
from fringeworks.rig.pinhole import project_with_derivatives, rays, skew
from fringeworks.types import (
    Axis,
    CoordinateMap,
    Decoded,
    FloatMap,
    InputError,
    PointCloud,
    Reason,
    Rig,
)

RESIDUAL_SIGMAS = 5.0
"""Distance from the epipolar line that is let through, in its standard deviations."""
NODES = (20, 26)
"""Rows and columns of nodes at which the calibration's part of σ is computed."""
DEPTHS = 7
"""Places along each node's ray that a polynomial is fitted to."""
POWERS = 5
NEWTON = 8
NOTHING = -126.0
"""Binary logarithm of a variance that is none."""

_kernels: WeakKeyDictionary[Rig, dict[Axis | None, _core.Triangulation]] = WeakKeyDictionary()


def triangulate(
    decoded: Decoded,
    rig: Rig,
    *,
    axis: Axis | None = None,
    residual_sigmas: float = RESIDUAL_SIGMAS,
    colour: FloatMap | None = None,
    out: PointCloud | None = None,
) -> PointCloud:
    """Points of a surface from where each camera pixel's light comes from.

    Parameters
    ----------
    decoded : Decoded
        Absolute coordinates of one axis or both, maps of the rig's camera.
    rig : Rig
    axis : "x" or "y", optional
        Use this axis only; both where there are both.
    residual_sigmas : float > 0
        With both axes: distance of the projector's point from the epipolar line, in standard
        deviations of pixel noise and calibration, beyond which a pixel is NaN (``RAYS_APART``).
    colour : (h, w) or (h, w, 3) array, optional
        Kept with the points.
    out : PointCloud, optional
        An earlier result of the same kind whose arrays are written to again. It is not valid
        afterwards.

    Returns
    -------
    PointCloud in camera coordinates.

    Raises
    ------
    InputError for maps of another size than the rig's camera, relative coordinates, an axis that
    was not decoded, coordinates beyond the rig's projector, and where no point lies in front of
    both devices.

    Notes
    -----
    The camera's pixel is exact: the point lies on its ray, at the distance 1/w. With one axis the
    ray meets the surface that a column or row of the projector lights; with both, w minimises the
    distance to the decoded point weighted by its variances. Lens distortion of both devices is in
    the equations. σ² = noise + calibration: the derivative of the distance by the coordinates, and
    by the rig's 24 parameters with their covariance.
    """
    maps = _chosen(decoded, rig, axis)
    if not residual_sigmas > 0:
        raise InputError(f"residual_sigmas: expected > 0, got {residual_sigmas}")
    shape = rig.camera.shape
    both = len(maps) == 2
    if out is None:
        out = _empty(shape, both)
    elif out.shape != shape or (out.residual_px is not None) != both:
        raise InputError(f"out: expected a point cloud of {shape} from as many axes, got another")
    kernel = _kernel(rig, None if both else next(iter(maps)))
    kernel.run(
        _arrays(maps.get("x")),
        _arrays(maps.get("y")),
        xyz=out.xyz_mm,
        sigma=out.sigma_mm,
        noise=out.noise_mm,
        residual=out.residual_px,
        reason=out.reason,
        residual_sigmas=residual_sigmas,
        residual_px=float(np.hypot(*rig.residual_px)),
    )
    _refuse_nothing(out, maps)
    if colour is not None and np.shape(colour)[:2] != shape:
        raise InputError(f"colour: expected shape {shape}, got {np.shape(colour)}")
    return PointCloud(out.xyz_mm, out.sigma_mm, out.noise_mm, out.reason, out.residual_px, colour)


def _chosen(decoded: Decoded, rig: Rig, axis: Axis | None) -> dict[Axis, CoordinateMap]:
    maps = decoded.maps
    if axis is not None:
        if axis not in maps:
            raise InputError(f"axis: expected one of {', '.join(maps)}, got {axis}")
        maps = {axis: maps[axis]}
    if not maps:
        raise InputError("decoded: expected coordinates along an axis or both, got none")
    camera, projector = rig.camera, rig.projector
    for name, found in maps.items():
        h, w = found.coordinate_px.shape
        if (h, w) != camera.shape:
            raise InputError(
                f"rig: it is for a camera of {camera.width_px} × {camera.height_px} px, got "
                f"frames of {w} × {h}"
            )
        if found.repeats_px is not None:
            raise InputError(
                f"{name}: expected absolute coordinates, got some that repeat every "
                f"{found.repeats_px:g} px"
            )
        length = projector.width_px if name == "x" else projector.height_px
        rows = found.coordinate_px[:: max(1, h // 16)]
        with np.errstate(invalid="ignore"):
            beyond = float(np.mean(rows > length + 1))
        if beyond > 0.01:
            raise InputError(
                f"rig: it is for a projector of {projector.width_px} × {projector.height_px} px, "
                f"got coordinates up to {np.nanmax(rows):.0f} along {name}"
            )
    return maps


def _arrays(
    found: CoordinateMap | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]] | None:
    if found is None:
        return None
    return (
        np.ascontiguousarray(found.coordinate_px, np.float32),
        np.ascontiguousarray(found.sigma_px, np.float32),
        np.ascontiguousarray(found.reason, np.uint8),
    )


def _empty(shape: tuple[int, int], both: bool) -> PointCloud:
    return PointCloud(
        xyz_mm=np.empty((*shape, 3), np.float32),
        sigma_mm=np.empty(shape, np.float32),
        noise_mm=np.empty(shape, np.float32),
        reason=np.empty(shape, np.uint8),
        residual_px=np.empty(shape, np.float32) if both else None,
    )


def _refuse_nothing(cloud: PointCloud, maps: dict[Axis, CoordinateMap]) -> None:
    """A rig that does not belong to a capture shows in that hardly any rays meet."""
    rows = slice(None, None, max(1, cloud.shape[0] // 16))
    reason = cloud.reason[rows]
    measured = int(np.sum((reason == Reason.OK) | (reason >= Reason.BEYOND_GEOMETRY)))
    decoded = min(int(np.sum(m.reason[rows] == Reason.OK)) for m in maps.values())
    behind = int(np.sum(reason == Reason.BEYOND_GEOMETRY))
    if measured and decoded and behind > 0.5 * decoded:
        raise InputError(
            f"rig: {behind / decoded:.0%} of the points lie behind the camera or the projector: "
            "it does not belong to this capture, or columns and rows are swapped"
        )
    apart = int(np.sum(reason == Reason.RAYS_APART))
    if decoded and apart > 0.9 * decoded:
        raise InputError(
            f"rig: rays of camera and projector pass each other in {apart / decoded:.0%} of the "
            "pixels: it does not belong to this capture, or a device was moved since"
        )


def _kernel(rig: Rig, axis: Axis | None) -> _core.Triangulation:
    """The kernel for a rig, with the calibration's part of σ along ``axis`` or by both."""
    known = _kernels.setdefault(rig, {})
    if axis not in known:
        along = main_axis(rig) if axis is None else axis
        known[axis] = _core.Triangulation(
            camera=[float(v) for v in rig.camera.parameters],
            projector=[float(v) for v in rig.projector.parameters],
            rotation=[float(v) for v in rig.T_projector_camera[:3, :3].ravel()],
            translation=[float(v) for v in rig.T_projector_camera[:3, 3]],
            spread=calibration_spread(rig, axis, along),
            spread_along_x=along == "x",
            spread_length=float(_length(rig, along)),
            camera_shape=rig.camera.shape,
            projector_size=(rig.projector.width_px, rig.projector.height_px),
        )
    return known[axis]


def _length(rig: Rig, axis: Axis) -> int:
    return rig.projector.width_px if axis == "x" else rig.projector.height_px


def main_axis(rig: Rig) -> Axis:
    """The axis of the projector along which a point moves the more when its depth changes."""
    centre = np.array([[0.5 * rig.camera.width_px, 0.5 * rig.camera.height_px]])
    ray = rays(rig.camera, centre)
    _, by_point, _ = project_with_derivatives(rig.projector, ray @ rig.T_projector_camera[:3, :3].T)
    moved = by_point[0] @ rig.T_projector_camera[:3, 3]
    return "x" if abs(moved[0]) >= abs(moved[1]) else "y"


def calibration_spread(rig: Rig, axis: Axis | None, along: Axis) -> NDArray[np.float32]:
    """Variance of 1/z that the calibration leaves, over the camera's frame.

    Parameters
    ----------
    axis : "x", "y", or None for both
        What is triangulated from.
    along : "x" or "y"
        Axis whose coordinate tells where on a ray a point is.

    Returns
    -------
    (rows, columns, 5) float32 coefficients of polynomials in that coordinate, −1…1 over the
    projector's frame, for the binary logarithm of the variance in 1/mm²: over a frame that a
    calibration has not covered the variance itself changes by orders of magnitude.
    """
    spread = np.zeros((*NODES, POWERS), np.float32)
    spread[..., 0] = NOTHING
    if rig.covariance is None or not rig.covariance.any():
        return spread
    place = np.cos(np.pi * (np.arange(DEPTHS) + 0.5) / DEPTHS)
    goal = (0.5 * place + 0.5) * _length(rig, along) - 0.5
    v, u, q = np.meshgrid(
        np.linspace(0, rig.camera.height_px - 1, NODES[0]),
        np.linspace(0, rig.camera.width_px - 1, NODES[1]),
        goal,
        indexing="ij",
    )
    pixels = np.stack((u, v), axis=-1).reshape(-1, 2)
    w = inverse_depth(rig, pixels, q.ravel(), along)
    by = inverse_depth_by_parameters(rig, pixels, w, axis)
    variance = np.einsum("ni,ij,nj->n", by, rig.covariance, by).reshape(-1, DEPTHS)
    good = (variance > 0) & np.isfinite(variance)
    fitted = good.sum(axis=1) >= POWERS
    powers = polynomial.polyvander(place, POWERS - 1)
    logarithm = np.log2(np.where(good, variance, 1.0))
    for k in np.flatnonzero(fitted):
        node = np.unravel_index(k, NODES)
        spread[node] = np.linalg.lstsq(powers[good[k]], logarithm[k, good[k]], rcond=None)[0]
    known = fitted.reshape(NODES)
    if known.any() and not known.all():
        # Where no ray meets the projector's light no point will be: any finite value does.
        nearest = ndimage.distance_transform_edt(~known, return_indices=True)[1]
        spread = spread[tuple(nearest)]
    return np.ascontiguousarray(spread)


def inverse_depth(rig: Rig, pixels: FloatMap, goal_px: FloatMap, axis: Axis) -> FloatMap:
    """1/z where rays of camera pixels (n, 2) meet a column or row of the projector, (n,), 1/mm.

    NaN where the way to it leaves what the lens models cover; 0 and below for no point in front.
    """
    k = 0 if axis == "x" else 1
    R, t = rig.T_projector_camera[:3, :3], rig.T_projector_camera[:3, 3]
    turned = rays(rig.camera, pixels) @ R.T
    ideal = (goal_px - rig.projector.principal_px[k]) / rig.projector.focal_px[k]
    with np.errstate(all="ignore"):
        w = (ideal * turned[:, 2] - turned[:, k]) / (t[k] - ideal * t[2])
        for _ in range(NEWTON):
            # A point times w: free of infinity where rays meet far away.
            seen = turned + w[:, None] * t
            seen = np.where(seen[:, 2:] > 0, seen, np.nan)
            pixel, by_point, _ = project_with_derivatives(rig.projector, seen)
            w = w + (goal_px - pixel[:, k]) / (by_point[:, k] @ t)
    return np.asarray(np.where(np.abs(goal_px - pixel[:, k]) < 1e-6, w, np.nan))


def inverse_depth_by_parameters(
    rig: Rig, pixels: FloatMap, w: FloatMap, axis: Axis | None
) -> FloatMap:
    """Derivative of the inverse distance by the rig's 24 parameters, projector coordinates given.

    Parameters
    ----------
    pixels : (n, 2) camera px
    w : (n,) 1/mm
    axis : "x" or "y", or None for both, weighted alike

    Returns
    -------
    (n, 24) array, of |r| over the point's distance, which is w where the ray stays; NaN for points
    that are not in front of the projector.

    Notes
    -----
    The projector's pixel of the point, π(R r + w t), stays what was decoded:
    ∂w/∂θ = −∂π/∂θ / ∂π/∂w, along one axis or by least squares over both.
    """
    R, t = rig.T_projector_camera[:3, :3], rig.T_projector_camera[:3, 3]
    ray = rays(rig.camera, pixels)
    seen = ray @ R.T + w[:, None] * t
    with np.errstate(all="ignore"):
        seen = np.where(seen[:, 2:] > 0, seen, np.nan)
        _, by_point, by_projector = project_with_derivatives(rig.projector, seen)
        _, c_by_ray, c_by_camera = project_with_derivatives(rig.camera, ray)
        # The camera's pixel stays: its ray turns when the camera's parameters change.
        turned = -np.linalg.solve(c_by_ray[:, :, :2], c_by_camera)
        by_camera = by_point @ R[:, :2] @ turned
        by_turn = by_point @ -skew(ray @ R.T)
        by = np.concatenate((by_camera, by_projector, by_turn, by_point * w[:, None, None]), axis=2)
        by_w = by_point @ t
        weight = np.ones(2) if axis is None else np.array([axis == "x", axis == "y"], float)
        top = np.einsum("ni,nij->nj", by_w * weight, by)
        found = -top / np.sum(by_w**2 * weight, axis=1)[:, None]
        # A ray that turns also changes its length where z = 1, and with it the distance.
        longer = np.einsum("ni,nij->nj", ray[:, :2], turned) / np.sum(ray**2, axis=1)[:, None]
        found[:, : longer.shape[1]] -= w[:, None] * longer
        return np.asarray(found)
