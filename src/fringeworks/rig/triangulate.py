"""Triangulation: projector coordinates and a calibrated rig to points in mm (theory §8, §9)."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks import _core
from fringeworks.rig.pinhole import project_with_derivatives, rays, skew
from fringeworks.rig.point_arrays import empty_arrays, input_arrays, reused_arrays
from fringeworks.types import (
    Axis,
    ByteMap,
    CoordinateMap,
    Decoded,
    FloatMap,
    InputError,
    PointCloud,
    Reason,
    Rig,
    RigMismatch,
    sealed,
)

RESIDUAL_SIGMAS = 5.0
"""Largest epipolar error that is accepted, in its standard deviations. Normal errors exceed five
in one of two million pixels."""
NODES = (20, 26)
"""Rows and columns of nodes over the camera's frame at which the calibration's variance is
computed. The variance is smooth; between the nodes it is interpolated to better than 1 % away from
the corners of the frame (tests/test_triangulate.py)."""
DEPTHS = 7
"""Places along each node's ray that a polynomial is fitted to; two more than its coefficients."""
POWERS = 5
"""Coefficients of that polynomial. A quartic follows the logarithm of the variance to 1 %."""
NEWTON_STEPS = 8
"""Newton steps that find where a ray meets a projector column. Convergence is quadratic; eight
steps reach double precision for every lens that calibrations have given."""
CONVERGED_PX = 1e-6
"""Largest distance from the wanted projector coordinate after the last step, px; a larger one means
that the ray leaves what the lens model covers."""
NO_VARIANCE = -126.0
"""Binary logarithm that stands for a variance of zero: the least exponent of single precision."""
CHECKED_ROWS = 16
"""Rows of a frame, about, that are looked at to see whether a rig belongs to it."""
MAX_BEYOND = 0.01
"""Share of coordinates beyond the projector's frame from which on the rig is taken for another
projector's. Noise at the border puts fewer there."""
MAX_BEHIND = 0.5
"""Share of points behind camera or projector from which on the rig is refused."""
MAX_APART = 0.9
"""Share of pixels with too large an epipolar error from which on the rig is refused."""


class Triangulator:
    """Triangulates with one rig, again and again.

    The tables that depend on the rig alone are computed once for each choice of axes and kept.

    Parameters
    ----------
    rig : Rig

    Examples
    --------
    >>> from fringeworks.simulate import standard_rig
    >>> Triangulator(standard_rig(scale=0.1)).rig.camera.shape
    (102, 128)
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._kernels: dict[Axis | None, _core.Triangulation] = {}

    @property
    def rig(self) -> Rig:
        """The rig that points are computed with."""
        return self._rig

    def triangulate(
        self,
        decoded: Decoded,
        *,
        axis: Axis | None = None,
        residual_sigmas: float = RESIDUAL_SIGMAS,
        colour: FloatMap | None = None,
        out: PointCloud | None = None,
    ) -> PointCloud:
        """Points of a surface from projector coordinates; see ``triangulate``."""
        rig = self._rig
        maps = _chosen(decoded, rig, axis)
        if not residual_sigmas > 0:
            raise InputError(f"residual_sigmas: expected > 0, got {residual_sigmas}")
        shape = rig.camera.shape
        if colour is not None and np.shape(colour)[:2] != shape:
            raise InputError(f"colour: expected shape {shape}, got {np.shape(colour)}")
        both = len(maps) == 2
        results = empty_arrays(shape, both) if out is None else reused_arrays(out, shape, both)
        self._kernel(None if both else next(iter(maps))).run(
            input_arrays(maps.get("x")),
            input_arrays(maps.get("y")),
            **results,
            residual_sigmas=residual_sigmas,
            residual_px=float(np.hypot(*rig.residual_px)),
        )
        _refuse_nothing(results["reason"], maps)
        return PointCloud(
            xyz_mm=sealed(results["xyz"]),
            sigma_mm=sealed(results["sigma"]),
            noise_mm=sealed(results["noise"]),
            reason=sealed(results["reason"]),
            residual_px=sealed(results["residual"]) if both else None,
            colour=colour,
        )

    def _kernel(self, axis: Axis | None) -> _core.Triangulation:
        """The kernel for one axis, or for both (None)."""
        if axis not in self._kernels:
            rig = self._rig
            along = main_axis(rig) if axis is None else axis
            self._kernels[axis] = _core.Triangulation(
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
        return self._kernels[axis]


def triangulate(
    decoded: Decoded,
    rig: Rig,
    *,
    axis: Axis | None = None,
    residual_sigmas: float = RESIDUAL_SIGMAS,
    colour: FloatMap | None = None,
    out: PointCloud | None = None,
) -> PointCloud:
    """Points of a surface from projector coordinates. ``Triangulator`` does it again and again.

    Parameters
    ----------
    decoded : Decoded
        Absolute coordinates along one axis or both, from the rig's camera.
    rig : Rig
    axis : "x" or "y", optional
        Use this axis only; both where both were decoded.
    residual_sigmas : float > 0
        With both axes: epipolar error, in standard deviations of pixel noise and calibration,
        beyond which a pixel is NaN (``RAYS_APART``).
    colour : (h, w) or (h, w, 3) array, optional
        Kept with the points.
    out : PointCloud, optional
        An earlier result of the same kind. Its arrays are written to again; it is not valid
        afterwards.

    Returns
    -------
    PointCloud in camera coordinates.

    Raises
    ------
    RigMismatch for maps of another size than the rig's camera, coordinates beyond the rig's
    projector, and where the rays hardly meet in front of both devices. InputError for relative
    coordinates, for an axis that was not decoded, and for ``out`` with arrays of other shapes,
    types or strides than those of a result.

    Notes
    -----
    The camera's pixel is exact: the point lies on its ray, at the distance 1/w. With one axis, the
    ray meets the surface that a column or row of the projector lights. With both, w minimises the
    distance to the decoded point weighted by its variances. The equations hold the lens distortion
    of both devices. σ² = noise + calibration: the derivative of the distance by the coordinates,
    and by the rig's 24 parameters with their covariance (theory §8, §9).
    """
    return Triangulator(rig).triangulate(
        decoded, axis=axis, residual_sigmas=residual_sigmas, colour=colour, out=out
    )


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
            raise RigMismatch(
                f"rig: it is for a camera of {camera.width_px} × {camera.height_px} px, got "
                f"frames of {w} × {h}"
            )
        if found.repeats_px is not None:
            raise InputError(
                f"{name}: expected absolute coordinates, got some that repeat every "
                f"{found.repeats_px:g} px"
            )
        length = projector.width_px if name == "x" else projector.height_px
        rows = found.coordinate_px[:: max(1, h // CHECKED_ROWS)]
        with np.errstate(invalid="ignore"):
            beyond = float(np.mean(rows > length + 1))
        if beyond > MAX_BEYOND:
            raise RigMismatch(
                f"rig: it is for a projector of {projector.width_px} × {projector.height_px} px, "
                f"got coordinates up to {np.nanmax(rows):.0f} along {name}"
            )
    return maps


def _refuse_nothing(all_reasons: ByteMap, maps: dict[Axis, CoordinateMap]) -> None:
    """Refuse a rig whose rays hardly ever meet: it does not belong to the capture."""
    rows = slice(None, None, max(1, all_reasons.shape[0] // CHECKED_ROWS))
    reason = all_reasons[rows]
    measured = int(np.sum((reason == Reason.OK) | (reason >= Reason.BEYOND_GEOMETRY)))
    decoded = min(int(np.sum(m.reason[rows] == Reason.OK)) for m in maps.values())
    behind = int(np.sum(reason == Reason.BEYOND_GEOMETRY))
    if measured and decoded and behind > MAX_BEHIND * decoded:
        raise RigMismatch(
            f"rig: {behind / decoded:.0%} of the points lie behind the camera or the projector: "
            "it does not belong to this capture, or columns and rows are swapped"
        )
    apart = int(np.sum(reason == Reason.RAYS_APART))
    if decoded and apart > MAX_APART * decoded:
        raise RigMismatch(
            f"rig: rays of camera and projector pass each other in {apart / decoded:.0%} of the "
            "pixels: it does not belong to this capture, or a device was moved since"
        )


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
    spread[..., 0] = NO_VARIANCE
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
        # These nodes yield no points; copy the nearest valid value to keep the table finite.
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
        for _ in range(NEWTON_STEPS):
            # A point times w: free of infinity where rays meet far away.
            seen = turned + w[:, None] * t
            seen = np.where(seen[:, 2:] > 0, seen, np.nan)
            pixel, by_point, _ = project_with_derivatives(rig.projector, seen)
            w = w + (goal_px - pixel[:, k]) / (by_point[:, k] @ t)
    return np.asarray(np.where(np.abs(goal_px - pixel[:, k]) < CONVERGED_PX, w, np.nan))


def inverse_depth_by_parameters(
    rig: Rig, pixels: FloatMap, w: FloatMap, axis: Axis | None
) -> FloatMap:
    """Derivative of the inverse distance by the rig's 24 parameters at fixed coordinates.

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
