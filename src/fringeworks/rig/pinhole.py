"""The pinhole model of a device (camera or projector): points to pixels, pixels to rays.

A device is a camera or a projector; ``Pinhole`` is its model, with lens distortion (theory §8).
This file also has the derivatives that calibration and error bars need, and rigid transforms.
"""

from __future__ import annotations

import numpy as np

from fringeworks.rig.lens_field import corrected, correction_slope, uncorrected
from fringeworks.types import FloatMap, InputError, Pinhole, RigMismatch

MAX_NEWTON_STEPS = 12
"""Largest number of Newton steps for undoing lens distortion. Newton's method doubles the correct
digits in every step, so usual distortions need four or five; the rest is for strong ones."""
CONVERGED = 1e-11
"""Newton's method stops when all points are met to this, in normalised image coordinates. For a
focal length of 10 000 px that is 1e-7 px: far below any measurement, far above rounding."""
INVERTED = 1e-9
"""Largest remaining error of an undistorted point, in normalised image coordinates. A point with a
larger one has no inverse. Looser than ``CONVERGED``, so that rounding never removes a point."""
LENS_GRID = 33
"""Pixels along each side of a frame of which the rays are looked at: a fold is wider than 3 %."""
MIN_SIGHT_SINE = 1e-9
"""Smallest sine of the angle between the direction of sight and ``down``. Below it, rounding would
determine the direction of the rows."""


def distort(ideal: FloatMap, distortion: FloatMap) -> FloatMap:
    """Apply lens distortion to normalised image points.

    Parameters
    ----------
    ideal : (..., 2) array
        x/z and y/z of points in the device's coordinates.
    distortion : (5,) array
        k₁, k₂, p₁, p₂, k₃.

    Returns
    -------
    (..., 2) array, the distorted points, in normalised image coordinates.

    Notes
    -----
    x_d = x (1 + k₁r² + k₂r⁴ + k₃r⁶) + 2p₁xy + p₂(r² + 2x²), and the same for y with p₁ and p₂
    exchanged (Brown, Photogrammetric Engineering 32, 1966; theory §8).
    """
    k1, k2, p1, p2, k3 = distortion
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    # Filled in place, as below: bundle adjustment calls these for a few points, many times.
    distorted = np.empty((*r2.shape, 2), radial.dtype)
    distorted[..., 0] = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    distorted[..., 1] = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return distorted


def distortion_by_point(ideal: FloatMap, distortion: FloatMap) -> FloatMap:
    """Derivative of ``distort`` with respect to the ideal point, (..., 2, 2)."""
    k1, k2, p1, p2, k3 = distortion
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))
    across = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    jacobian = np.empty((*x.shape, 2, 2))
    jacobian[..., 0, 0] = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    jacobian[..., 0, 1] = jacobian[..., 1, 0] = across
    jacobian[..., 1, 1] = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return jacobian


def distortion_by_coefficients(ideal: FloatMap) -> FloatMap:
    """Derivative of ``distort`` with respect to k₁, k₂, p₁, p₂, k₃, (..., 2, 5)."""
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    product, r4, r6 = 2.0 * x * y, r2**2, r2**3
    found = np.empty((*r2.shape, 2, 5), r2.dtype)
    for k, value in enumerate((x, y)):
        found[..., k, 0], found[..., k, 1], found[..., k, 4] = value * r2, value * r4, value * r6
        found[..., k, 2 + k] = product
        found[..., k, 3 - k] = r2 + 2.0 * value * value
    return found


def undistort(distorted: FloatMap, distortion: FloatMap) -> FloatMap:
    """Remove lens distortion from normalised image points: the inverse of ``distort``.

    Parameters
    ----------
    distorted : (..., 2) array
        Normalised image coordinates.
    distortion : (5,) array
        k₁, k₂, p₁, p₂, k₃.

    Returns
    -------
    (..., 2) array; NaN where the model has no inverse. Strong distortion folds the image: beyond
    some radius, points further out are imaged further in.

    Notes
    -----
    Newton's method from the distorted point. A solution counts only where the distortion keeps
    the orientation (positive definite derivative): beyond the fold it does not.
    """
    ideal = np.array(distorted, np.float64)
    with np.errstate(all="ignore"):
        for _ in range(MAX_NEWTON_STEPS):
            error = distort(ideal, distortion) - distorted
            if not np.nanmax(np.abs(error), initial=0.0) > CONVERGED:
                break
            jacobian = distortion_by_point(ideal, distortion)
            a, b, c = jacobian[..., 0, 0], jacobian[..., 0, 1], jacobian[..., 1, 1]
            determinant = a * c - b * b
            ideal[..., 0] -= (c * error[..., 0] - b * error[..., 1]) / determinant
            ideal[..., 1] -= (a * error[..., 1] - b * error[..., 0]) / determinant
        error = distort(ideal, distortion) - distorted
        jacobian = distortion_by_point(ideal, distortion)
        determinant_positive = jacobian[..., 0, 0] * jacobian[..., 1, 1] > jacobian[..., 0, 1] ** 2
        not_folded = determinant_positive & (jacobian[..., 0, 0] > 0)
        valid = (np.abs(error).max(axis=-1) < INVERTED) & not_folded
    ideal[~valid] = np.nan
    return ideal


def project(device: Pinhole, points_mm: FloatMap) -> FloatMap:
    """Project points to the pixels of a device.

    Parameters
    ----------
    device : Pinhole
    points_mm : (..., 3) array
        Points in the device's coordinates, mm.

    Returns
    -------
    (..., 2) float64 array: column and row, px, not limited to the frame; NaN for points that are
    not in front of the device.

    Raises
    ------
    InputError for points of another shape.

    Notes
    -----
    u = f_x x_d + c_x, v = f_y y_d + c_y, with (x_d, y_d) of ``distort`` (theory §8). The pixel that
    the device's field moves there is the result.

    Examples
    --------
    >>> device = Pinhole(640, 480, (700.0, 700.0), (320.0, 240.0))
    >>> project(device, np.array([10.0, 0.0, 500.0])).tolist()
    [334.0, 240.0]
    """
    points = np.asarray(points_mm, np.float64)
    if points.shape[-1:] != (3,):
        raise InputError(f"points: expected an array of shape (..., 3), got {points.shape}")
    z = points[..., 2]
    with np.errstate(all="ignore"):
        ideal = points[..., :2] / np.where(z > 0, z, np.nan)[..., None]
        distorted = distort(ideal, np.asarray(device.distortion))
    return np.asarray(uncorrected(device.field, distorted * device.focal_px + device.principal_px))


def project_with_derivatives(
    device: Pinhole, points_mm: FloatMap
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Project points; also return the derivatives with respect to the points and the device.

    Parameters
    ----------
    device : Pinhole
    points_mm : (n, 3) array
        Points in front of the device, in its coordinates, mm.

    Returns
    -------
    pixels : (n, 2) px
    by_point : (n, 2, 3) px/mm
    by_device : (n, 2, 9)
        With respect to the nine values of ``Pinhole.parameters``, in that order.
    """
    z = points_mm[:, 2]
    ideal = points_mm[:, :2] / z[:, None]
    distortion, focal = np.asarray(device.distortion), np.asarray(device.focal_px)
    distorted = distort(ideal, distortion)
    by_ideal = focal[:, None] * distortion_by_point(ideal, distortion)
    ideal_by_point = np.zeros((len(z), 2, 3))
    ideal_by_point[:, 0, 0] = ideal_by_point[:, 1, 1] = 1.0 / z
    ideal_by_point[:, :, 2] = -ideal / z[:, None]
    by_device = np.zeros((len(z), 2, 9))
    by_device[:, [0, 1], [0, 1]] = distorted
    by_device[:, [0, 1], [2, 3]] = 1.0
    by_device[:, :, 4:] = focal[:, None] * distortion_by_coefficients(ideal)
    pixels, by_point = distorted * focal + device.principal_px, by_ideal @ ideal_by_point
    if device.field is None:
        return pixels, by_point, by_device
    pixels = uncorrected(device.field, pixels)
    turned = np.linalg.inv(np.eye(2) - correction_slope(device.field, pixels))
    return pixels, turned @ by_point, turned @ by_device


def rays(device: Pinhole, pixels: FloatMap) -> FloatMap:
    """Return the directions in which pixels look, in the device's coordinates.

    Parameters
    ----------
    device : Pinhole
    pixels : (..., 2) array
        Column and row, px.

    Returns
    -------
    (..., 3) array, scaled to z = 1; x and y are NaN where the lens distortion has no inverse.

    Examples
    --------
    >>> device = Pinhole(640, 480, (700.0, 700.0), (320.0, 240.0))
    >>> rays(device, np.array([334.0, 240.0])).tolist()
    [0.02, 0.0, 1.0]
    """
    distorted = (corrected(device.field, pixels) - device.principal_px) / device.focal_px
    ideal = undistort(distorted, np.asarray(device.distortion))
    return np.concatenate((ideal, np.ones((*ideal.shape[:-1], 1))), axis=-1)


def check_lens(device: Pinhole, name: str) -> None:
    """Refuse a lens distortion that folds the image around the middle of the frame.

    No lens does so there. In the corners, where few points of a calibration lie, a polynomial may.

    Parameters
    ----------
    device : Pinhole
    name : str
        What the message calls the device.

    Raises
    ------
    RigMismatch for pixels without a ray in the circle that touches the longer sides of the frame.
    """
    h, w = device.shape
    at = np.stack(np.meshgrid(*(np.linspace(0.0, n - 1.0, LENS_GRID) for n in (w, h))), axis=-1)
    apart = np.hypot(at[..., 0] - 0.5 * (w - 1), at[..., 1] - 0.5 * (h - 1))
    folded = np.isnan(rays(device, at)[..., 0]) & (apart <= 0.5 * min(h, w))
    if folded.any():
        told = ", ".join(f"{k:g}" for k in device.distortion)
        raise RigMismatch(
            f"{name}: its lens distortion {told} folds the image {apart[folded].min():.0f} px from "
            "the middle of the frame, as no lens does; the calibration has failed"
        )


def rotation(vector: FloatMap) -> FloatMap:
    """Return the rotation matrices of rotation vectors (..., 3), (..., 3, 3): Rodrigues' formula.

    The rotation is by |vector| rad about the direction of the vector: exp([ω]×).
    """
    vector = np.asarray(vector, np.float64)
    turns = np.linalg.norm(vector, axis=-1)[..., None, None] / (2.0 * np.pi)
    cross = skew(vector)
    # NumPy's sinc(x) is sin(πx)/(πx), and 1 at 0.
    along, across = np.sinc(2.0 * turns), 0.5 * np.sinc(turns) ** 2
    return np.asarray(np.eye(3) + along * cross + across * (cross @ cross))


def skew(vector: FloatMap) -> FloatMap:
    """Return the matrix of the cross product with a vector: skew(v) @ w = v × w, (..., 3, 3)."""
    vector = np.asarray(vector, np.float64)
    cross = np.zeros((*vector.shape[:-1], 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross[..., i, j], cross[..., j, i] = -vector[..., k], vector[..., k]
    return cross


def transform(T: FloatMap, points_mm: FloatMap) -> FloatMap:
    """Apply a rigid transform ``T`` (4, 4) to points (..., 3), mm."""
    return np.asarray(points_mm @ T[:3, :3].T + T[:3, 3])


def pose(rotation: FloatMap, translation_mm: FloatMap) -> FloatMap:
    """Build the (4, 4) transform of a rotation (3, 3) and a translation (3,), mm."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation_mm
    return T


def inverse(T: FloatMap) -> FloatMap:
    """Invert a rigid transform (4, 4)."""
    return pose(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])


def look_at(eye_mm: FloatMap, target_mm: FloatMap, *, down: FloatMap | None = None) -> FloatMap:
    """Return the pose T_device_world of a device that looks from one point at another.

    Parameters
    ----------
    eye_mm : (3,) array
        Pupil of the device in world coordinates, mm.
    target_mm : (3,) array
        A point on the optical axis, mm.
    down : (3,) array, optional
        Direction in which rows are counted, as far as the direction of sight allows; y by default.

    Returns
    -------
    (4, 4) transform from world to device coordinates.

    Raises
    ------
    InputError where eye and target coincide, or the device would look along ``down``.
    """
    forward = np.asarray(target_mm, np.float64) - np.asarray(eye_mm, np.float64)
    y = np.array([0.0, 1.0, 0.0]) if down is None else np.asarray(down, np.float64)
    across = np.cross(y, forward)
    if not np.linalg.norm(across) > MIN_SIGHT_SINE * np.linalg.norm(forward) > 0:
        raise InputError(
            "look_at: expected a target apart from the eye and not along down, got the eye at "
            f"{np.asarray(eye_mm).tolist()} and the target at {np.asarray(target_mm).tolist()}"
        )
    z = forward / np.linalg.norm(forward)
    x = across / np.linalg.norm(across)
    R = np.stack((x, np.cross(z, x), z))
    return pose(R, -R @ np.asarray(eye_mm, np.float64))
