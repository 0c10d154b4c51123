"""Pinhole devices with lens distortion: points to pixels, pixels to rays, and the derivatives."""

from __future__ import annotations

import numpy as np

from fringeworks.types import FloatMap, InputError, Pinhole

NEWTON_STEPS = 12
CONVERGED = 1e-11


def distort(ideal: FloatMap, distortion: FloatMap) -> FloatMap:
    """Where a lens moves normalised image points to.

    Parameters
    ----------
    ideal : (..., 2) array, x/z and y/z.
    distortion : (5,) k₁, k₂, p₁, p₂, k₃

    Notes
    -----
    x_d = x (1 + k₁r² + k₂r⁴ + k₃r⁶) + 2p₁xy + p₂(r² + 2x²), and the same for y with p₁ and p₂
    exchanged (Brown, Photogrammetric Engineering 32, 1966; theory §8).
    """
    k1, k2, p1, p2, k3 = distortion
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ),
        axis=-1,
    )


def distortion_by_point(ideal: FloatMap, distortion: FloatMap) -> FloatMap:
    """Derivative of ``distort`` by the ideal point, (..., 2, 2)."""
    k1, k2, p1, p2, k3 = distortion
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))
    across = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    by = np.empty((*x.shape, 2, 2))
    by[..., 0, 0] = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    by[..., 0, 1] = by[..., 1, 0] = across
    by[..., 1, 1] = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return by


def distortion_by_coefficients(ideal: FloatMap) -> FloatMap:
    """Derivative of ``distort`` by k₁, k₂, p₁, p₂, k₃, (..., 2, 5)."""
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    zero = 2.0 * x * y
    by_x = np.stack((x * r2, x * r2**2, zero, r2 + 2.0 * x * x, x * r2**3), axis=-1)
    by_y = np.stack((y * r2, y * r2**2, r2 + 2.0 * y * y, zero, y * r2**3), axis=-1)
    return np.stack((by_x, by_y), axis=-2)


def undistort(distorted: FloatMap, distortion: FloatMap) -> FloatMap:
    """Inverse of ``distort`` by Newton's method.

    Returns
    -------
    (..., 2) array; NaN where the lens model folds over and has no inverse.
    """
    ideal = np.array(distorted, np.float64)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            miss = distort(ideal, distortion) - distorted
            if not np.nanmax(np.abs(miss), initial=0.0) > CONVERGED:
                break
            by = distortion_by_point(ideal, distortion)
            a, b, c = by[..., 0, 0], by[..., 0, 1], by[..., 1, 1]
            determinant = a * c - b * b
            ideal[..., 0] -= (c * miss[..., 0] - b * miss[..., 1]) / determinant
            ideal[..., 1] -= (a * miss[..., 1] - b * miss[..., 0]) / determinant
        miss = distort(ideal, distortion) - distorted
        by = distortion_by_point(ideal, distortion)
        upright = by[..., 0, 0] * by[..., 1, 1] > by[..., 0, 1] ** 2
        good = (np.abs(miss).max(axis=-1) < 1e-9) & upright & (by[..., 0, 0] > 0)
    ideal[~good] = np.nan
    return ideal


def project(device: Pinhole, points_mm: FloatMap) -> FloatMap:
    """Pixels of points in the device's coordinates.

    Parameters
    ----------
    points_mm : (..., 3) array.

    Returns
    -------
    (..., 2) array, px; NaN for points that are not in front of the device.
    """
    points = np.asarray(points_mm, np.float64)
    if points.shape[-1:] != (3,):
        raise InputError(f"points: expected shape (..., 3), got {points.shape}")
    z = points[..., 2]
    with np.errstate(all="ignore"):
        ideal = points[..., :2] / np.where(z > 0, z, np.nan)[..., None]
        moved = distort(ideal, np.asarray(device.distortion))
    return np.asarray(moved * device.focal_px + device.principal_px)


def project_with_derivatives(
    device: Pinhole, points_mm: FloatMap
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Pixels, their derivatives by the points and by the device's nine parameters.

    Returns
    -------
    (n, 2) px; (n, 2, 3) px/mm; (n, 2, 9) in the order of ``Pinhole.parameters``.
    """
    z = points_mm[:, 2]
    ideal = points_mm[:, :2] / z[:, None]
    distortion, focal = np.asarray(device.distortion), np.asarray(device.focal_px)
    moved = distort(ideal, distortion)
    by_ideal = focal[:, None] * distortion_by_point(ideal, distortion)
    ideal_by_point = np.zeros((len(z), 2, 3))
    ideal_by_point[:, 0, 0] = ideal_by_point[:, 1, 1] = 1.0 / z
    ideal_by_point[:, :, 2] = -ideal / z[:, None]
    by_device = np.zeros((len(z), 2, 9))
    by_device[:, [0, 1], [0, 1]] = moved
    by_device[:, [0, 1], [2, 3]] = 1.0
    by_device[:, :, 4:] = focal[:, None] * distortion_by_coefficients(ideal)
    return moved * focal + device.principal_px, by_ideal @ ideal_by_point, by_device


def rays(device: Pinhole, pixels: FloatMap) -> FloatMap:
    """Directions of pixels in the device's coordinates, with z = 1.

    Parameters
    ----------
    pixels : (..., 2) array, px.

    Returns
    -------
    (..., 3) array; NaN where the distortion has no inverse.
    """
    distorted = (np.asarray(pixels, np.float64) - device.principal_px) / device.focal_px
    ideal = undistort(distorted, np.asarray(device.distortion))
    return np.concatenate((ideal, np.ones((*ideal.shape[:-1], 1))), axis=-1)


def rotation(vector: FloatMap) -> FloatMap:
    """exp(ω): the rotation by |ω| rad about ω, (3, 3) (Rodrigues)."""
    vector = np.asarray(vector, np.float64)
    angle = float(np.linalg.norm(vector))
    cross = skew(vector)
    if angle < 1e-8:
        return np.asarray(np.eye(3) + cross + 0.5 * cross @ cross)
    half = np.sin(0.5 * angle) / angle
    return np.asarray(np.eye(3) + np.sin(angle) / angle * cross + 2.0 * half**2 * cross @ cross)


def skew(vector: FloatMap) -> FloatMap:
    """The matrix of v ×, (..., 3, 3)."""
    vector = np.asarray(vector, np.float64)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    rows = ((zero, -z, y), (z, zero, -x), (-y, x, zero))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def transform(T: FloatMap, points_mm: FloatMap) -> FloatMap:
    """Points (..., 3) in the coordinates that ``T`` (4, 4) maps to."""
    return np.asarray(points_mm @ T[:3, :3].T + T[:3, 3])


def pose(rotation: FloatMap, translation_mm: FloatMap) -> FloatMap:
    """A (4, 4) transform of a rotation and a translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation_mm
    return T


def inverse(T: FloatMap) -> FloatMap:
    """The inverse of a rigid transform."""
    return pose(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])


def look_at(eye_mm: FloatMap, target_mm: FloatMap, *, down: FloatMap | None = None) -> FloatMap:
    """T_device_world of a device at ``eye`` that looks at ``target``, its rows along ``down``.

    Raises
    ------
    InputError where the direction of sight is undefined or along ``down``.
    """
    forward = np.asarray(target_mm, np.float64) - np.asarray(eye_mm, np.float64)
    y = np.array([0.0, 1.0, 0.0]) if down is None else np.asarray(down, np.float64)
    across = np.cross(y, forward)
    if not np.linalg.norm(across) > 1e-9 * np.linalg.norm(forward) > 0:
        raise InputError("look_at: expected a target away from the eye and not along down")
    z = forward / np.linalg.norm(forward)
    x = across / np.linalg.norm(across)
    R = np.stack((x, np.cross(z, x), z))
    return pose(R, -R @ np.asarray(eye_mm, np.float64))
