"""Where a camera's ray meets a projector's column or row, and what the calibration adds to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.rig.lens_field import correction_sigma
from fringeworks.rig.pinhole import project_with_derivatives, rays, skew
from fringeworks.types import Axis, FloatMap, Rig

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
EXACT_PX = 1e-9
"""Distance below which another step changes nothing that matters, px."""
NO_VARIANCE = -126.0
"""Binary logarithm that stands for a variance of zero: the least exponent of single precision."""

PRINCIPAL_POINTS = ([2, 3], [11, 12])
"""Places of the principal points of camera and projector among the rig's 24 parameters."""


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
    goal = (0.5 * place + 0.5) * axis_length(rig, along) - 0.5
    v, u, q = np.meshgrid(
        np.linspace(0, rig.camera.height_px - 1, NODES[0]),
        np.linspace(0, rig.camera.width_px - 1, NODES[1]),
        goal,
        indexing="ij",
    )
    pixels = np.stack((u, v), axis=-1).reshape(-1, 2)
    w = inverse_depth(rig, pixels, q.ravel(), along)
    by = inverse_depth_by_parameters(rig, pixels, w, axis)
    variance = np.einsum("nj,nj->n", by @ rig.covariance, by)
    if has_structure(rig):
        variance = variance + structure_variance(rig, pixels, w, axis)
    variance = variance.reshape(-1, DEPTHS)
    good = (variance > 0) & np.isfinite(variance)
    fitted = good.sum(axis=1) >= POWERS
    powers = np.polynomial.polynomial.polyvander(place, POWERS - 1)
    logarithm = np.log2(np.where(good, variance, 1.0))
    whole = good.all(axis=1)
    nodes = spread.reshape(-1, POWERS)
    nodes[whole] = np.linalg.lstsq(powers, logarithm[whole].T, rcond=None)[0].T
    for k in np.flatnonzero(fitted & ~whole):
        nodes[k] = np.linalg.lstsq(powers[good[k]], logarithm[k, good[k]], rcond=None)[0]
    known = fitted.reshape(NODES)
    if known.any() and not known.all():
        # These nodes yield no points; copy the nearest valid value to keep the table finite.
        nearest = scipy.ndimage.distance_transform_edt(~known, return_indices=True)[1]
        spread = spread[tuple(nearest)]
    return np.ascontiguousarray(spread)


def has_structure(rig: Rig) -> bool:
    """Whether the rig states errors that depend on the place in a device's frame."""
    fields = (rig.camera.field, rig.projector.field)
    return rig.structure_px > 0 or any(field is not None for field in fields)


def structure_variance(rig: Rig, pixels: FloatMap, w: FloatMap, axis: Axis | None) -> FloatMap:
    """Variance of 1/z by errors that depend on the place in a device's frame, (n,), 1/mm².

    They are the errors of the devices' fields, which act as a principal point that is off at this
    place, and ``structure_px``.
    """
    variance = np.zeros(len(pixels))
    if rig.structure_px > 0:
        variance = variance + rig.structure_px**2 * inverse_depth_by_px(rig, pixels, w, axis)
    if rig.camera.field is None and rig.projector.field is None:
        return variance
    by = inverse_depth_by_parameters(rig, pixels, w, axis)
    for columns, sigma in zip(PRINCIPAL_POINTS, field_sigmas(rig, pixels, w), strict=True):
        variance = variance + np.sum((by[:, columns] * sigma) ** 2, axis=1)
    return np.asarray(variance)


def field_sigmas(rig: Rig, pixels: FloatMap, w: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Standard deviations of the fields of camera and projector at points, (n, 2) each, px."""
    none = np.zeros((len(pixels), 2))
    of_camera, of_projector = rig.camera.field, rig.projector.field
    camera = none if of_camera is None else correction_sigma(of_camera, pixels)
    if of_projector is None:
        return camera, none
    return camera, correction_sigma(of_projector, projector_by_parameters(rig, pixels, w)[0])


def inverse_depth_by_px(rig: Rig, pixels: FloatMap, w: FloatMap, axis: Axis | None) -> FloatMap:
    """Return the variance of 1/z per px² of the projector's coordinates, (n,), 1/mm² px⁻²."""
    by_w = projector_by_parameters(rig, pixels, w)[2]
    square = np.sum(by_w**2, axis=1) if axis is None else by_w[:, 0 if axis == "x" else 1] ** 2
    return np.asarray(1.0 / square)


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
            off = goal_px - pixel[:, k]
            if not np.any(np.abs(off) > EXACT_PX):
                break
            w = w + off / (by_point[:, k] @ t)
    return np.asarray(np.where(np.abs(off) < CONVERGED_PX, w, np.nan))


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

    """
    ray = rays(rig.camera, pixels)
    with np.errstate(all="ignore"):
        found, turned = w_by_parameters(rig, pixels, w, axis)
        # A ray that turns also changes its length where z = 1, and with it the distance.
        longer = np.einsum("ni,nij->nj", ray[:, :2], turned) / np.sum(ray**2, axis=1)[:, None]
        found[:, : longer.shape[1]] -= w[:, None] * longer
        return np.asarray(found)


def w_by_parameters(
    rig: Rig, pixels: FloatMap, w: FloatMap, axis: Axis | None
) -> tuple[FloatMap, FloatMap]:
    """Derivative of w = 1/z by the rig's 24 parameters at fixed coordinates, and that of the ray.

    Parameters
    ----------
    pixels, w, axis
        As for ``inverse_depth_by_parameters``.

    Returns
    -------
    (n, 24) array; and the derivative (n, 2, 9) of the camera's ray, where z = 1, by the camera's
    parameters.

    Notes
    -----
    The projector's pixel of the point, π(R r + w t), stays what was decoded:
    ∂w/∂θ = −∂π/∂θ / ∂π/∂w, along one axis or by least squares over both (theory §8).
    """
    _, by, by_w, turned = projector_by_parameters(rig, pixels, w)
    weight = np.ones(2) if axis is None else np.array([axis == "x", axis == "y"], float)
    top = np.einsum("ni,nij->nj", by_w * weight, by)
    return np.asarray(-top / np.sum(by_w**2 * weight, axis=1)[:, None]), turned


def projector_by_parameters(
    rig: Rig, pixels: FloatMap, w: FloatMap
) -> tuple[FloatMap, FloatMap, FloatMap, FloatMap]:
    """Where the points at 1/z = w on the camera's rays are seen by the projector.

    Parameters
    ----------
    pixels : (n, 2) camera px
    w : (n,) 1/mm

    Returns
    -------
    The projector's pixels (n, 2), px; their derivatives by the rig's 24 parameters at fixed w
    (n, 2, 24) and by w (n, 2); the derivative of the camera's ray, where z = 1, by the camera's
    parameters (n, 2, 9). NaN for points that are not in front of the projector.
    """
    R, t = rig.T_projector_camera[:3, :3], rig.T_projector_camera[:3, 3]
    ray = rays(rig.camera, pixels)
    seen = ray @ R.T + w[:, None] * t
    with np.errstate(all="ignore"):
        seen = np.where(seen[:, 2:] > 0, seen, np.nan)
        pixel, by_point, by_projector = project_with_derivatives(rig.projector, seen)
        _, c_by_ray, c_by_camera = project_with_derivatives(rig.camera, ray)
        # The camera's pixel stays: its ray turns when the camera's parameters change.
        turned = -np.linalg.solve(c_by_ray[:, :, :2], c_by_camera)
        by_camera = by_point @ R[:, :2] @ turned
        by_turn = by_point @ -skew(ray @ R.T)
        by = np.concatenate((by_camera, by_projector, by_turn, by_point * w[:, None, None]), axis=2)
    return pixel, by, by_point @ t, turned


def axis_length(rig: Rig, axis: Axis) -> int:
    return rig.projector.width_px if axis == "x" else rig.projector.height_px
