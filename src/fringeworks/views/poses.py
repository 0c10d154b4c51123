"""Poses of views with their covariance, and the axis of a turntable."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from fringeworks.rig.pinhole import inverse, pose, rotation, skew
from fringeworks.types import FloatMap, Frozen, InputError, finite, unmasked

MOST_SKEW = 1e-3
"""Largest deviation of RᵀR from the identity. Measured poses, and files with few digits, are
off by less; a matrix that is off by more is no rotation."""
MIN_AXIS_POSES = 3
"""Smallest number of poses that determine an axis and leave something to check it with."""
MIN_TURN_DEG = 5.0
"""Smallest range of angles that determines an axis, degrees. With less, the axis is determined more
than ten times worse than the poses themselves."""


@dataclass(frozen=True, eq=False, repr=False)
class ViewPose(Frozen):
    """Where a view was taken from, with two parts of its covariance.

    An error ξ = (ω, v) turns and moves points of the part: p becomes p + ω × p + v.
    """

    T_part_camera: FloatMap
    """(4, 4), maps the view's camera coordinates to the part's coordinates, mm."""
    noise: FloatMap
    """(6, 6) covariance of ξ that is independent from view to view; rad, mm."""
    common: FloatMap
    """(6, 6) covariance of ξ that all views may share, as that of the rig's calibration."""

    @property
    def covariance(self) -> FloatMap:
        """(6, 6) covariance of ξ."""
        return np.asarray(self.noise + self.common)

    def carried(self, T: FloatMap) -> ViewPose:
        """The pose in the coordinates that ``T`` (4, 4) maps the part's coordinates to."""
        return ViewPose(T @ self.T_part_camera, carried(T, self.noise), carried(T, self.common))


@dataclass(frozen=True, eq=False, repr=False)
class TurntableAxis(Frozen):
    """The axis of a turntable in camera coordinates, and how well it is known."""

    point_mm: FloatMap
    """(3,), the point of the axis that is nearest to the middle of the poses, mm."""
    direction: FloatMap
    """(3,), unit vector; angles count by the right-hand rule."""
    covariance: FloatMap
    """(6, 6) covariance of (rotation of the direction, displacement of the point); rad, mm."""
    scatter_deg: float
    """Standard deviation of one view about the fit, as a rotation, degrees; for the error of the
    table's own angles and its wobble."""
    scatter_mm: float
    """The same as a displacement of the point of the axis, mm."""


def twist(T: FloatMap) -> FloatMap:
    """Return (rotation vector, translation) of a transform (4, 4), (6,); rad, mm."""
    turn = scipy.spatial.transform.Rotation.from_matrix(T[:3, :3]).as_rotvec()
    return np.concatenate((turn, T[:3, 3]))


def from_twist(xi: FloatMap) -> FloatMap:
    """Return the transform of (rotation vector, translation), the inverse of ``twist``."""
    return pose(rotation(xi[:3]), xi[3:])


def mean_pose(poses: Sequence[FloatMap]) -> FloatMap:
    """Return the mean of transforms (4, 4) that differ little, (4, 4).

    Parameters
    ----------
    poses : sequence of (4, 4) arrays
        Rigid transforms, mm.
    """
    turns = scipy.spatial.transform.Rotation.from_matrix([T[:3, :3] for T in poses])
    return pose(turns.mean().as_matrix(), np.mean([T[:3, 3] for T in poses], axis=0))


def carried(T: FloatMap, covariance: FloatMap) -> FloatMap:
    """Convert the covariance of an error ξ to the coordinates that ``T`` maps to, (6, 6)."""
    A = np.zeros((6, 6))
    A[:3, :3] = A[3:, 3:] = T[:3, :3]
    A[3:, :3] = skew(T[:3, 3]) @ T[:3, :3]
    return np.asarray(A @ covariance @ A.T)


def turn_deg(T: FloatMap) -> float:
    """Angle of the rotation of a transform (4, 4), 0…180 degrees."""
    return float(np.degrees(np.linalg.norm(twist(T)[:3])))


def folded_deg(angle_deg: float) -> float:
    """Angle of the rotation by any number of degrees, 0…180."""
    return abs((angle_deg + 180.0) % 360.0 - 180.0)


def apart(T: FloatMap, other: FloatMap, middle_mm: FloatMap, limits: tuple[float, float]) -> bool:
    """Whether two poses (4, 4) differ by more than a rotation, degrees, or a displacement of the
    middle of the part, mm."""
    off = T - other
    # The distance of two rotation matrices is 2 √2 sin of half the angle between them.
    half = float(np.linalg.norm(off[:3, :3])) / np.sqrt(8.0)
    way = off[:3, :3] @ middle_mm + off[:3, 3]
    return bool(half > np.sin(0.5 * np.radians(limits[0])) or np.linalg.norm(way) > limits[1])


def distinct(
    poses: Iterable[FloatMap], middle_mm: FloatMap, limits: tuple[float, float], most: int
) -> list[FloatMap]:
    """Return the first poses (4, 4) that differ from each other (``apart``), ``most`` of them."""
    kept: list[FloatMap] = []
    for T in poses:
        if all(apart(T, one, middle_mm, limits) for one in kept):
            kept.append(T)
        if len(kept) == most:
            break
    return kept


def turntable_axis(
    poses: Sequence[FloatMap], angles_deg: Sequence[float] | None = None
) -> TurntableAxis:
    """Fit the axis of a turntable to the poses of something that turns with it.

    Parameters
    ----------
    poses : sequence of (4, 4) arrays
        T_camera_board of a board that stands on the table, in three views or more, mm.
    angles_deg : sequence of float, optional
        Angles of the table. Without them every view has an angle of its own.

    Returns
    -------
    TurntableAxis. Its covariance comes from the scatter of the poses about the fit, so it covers
    wobble and angle errors of the table as well as errors of the poses.

    Raises
    ------
    InputError for fewer than three poses, and for poses that turn by less than 5°.

    Notes
    -----
    The direction is common to the rotations between all pairs of views: it is the main direction
    of their rotation vectors. The point solves (R_ij − 1) c = −t_ij by least squares, since a
    point c of the axis stays where it is. Errors are by leaving out one view at a time (jackknife).
    """
    poses = [unmasked(T, "poses").astype(np.float64) for T in poses]
    if len(poses) < MIN_AXIS_POSES:
        raise InputError(f"poses: expected {MIN_AXIS_POSES} or more, got {len(poses)}")
    for T in poses:
        if np.shape(T) != (4, 4) or not finite(*np.ravel(T)):
            raise InputError(f"poses: expected finite (4, 4) transforms, got shape {np.shape(T)}")
        if np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > MOST_SKEW:
            raise InputError("poses: expected rotations, got a matrix that is none")
    if angles_deg is not None and not finite(*angles_deg):
        raise InputError(f"angles: expected finite values, got {angles_deg}")
    if angles_deg is not None and len(angles_deg) != len(poses):
        raise InputError(f"angles: expected {len(poses)}, one for each pose, got {len(angles_deg)}")
    point, direction, turned = _axis(poses)
    if turned < np.radians(MIN_TURN_DEG):
        raise InputError(
            f"poses: expected rotations of {MIN_TURN_DEG:g}° or more, got {np.degrees(turned):.2g}°"
        )
    # Views before the first one turn by the right-hand rule where the angles grow.
    if angles_deg is not None and _sense(poses, direction, angles_deg) < 0:
        direction = -direction
    n = len(poses)
    parts = []
    for k in range(n):
        if n == MIN_AXIS_POSES:
            other = _axis(poses, weight=np.where(np.arange(n) == k, 0.5, 1.0))
        else:
            other = _axis(poses[:k] + poses[k + 1 :])
        turn = np.cross(direction, other[1] * np.sign(other[1] @ direction))
        parts.append(np.concatenate((turn, other[0] - point)))
    off = np.stack(parts).astype(np.float64)
    spread = off - off.mean(axis=0)
    angle, aside = _scatter(poses, point, direction, angles_deg)
    return TurntableAxis(point, direction, (n - 1) / n * spread.T @ spread, angle, aside)


def turned_pose(axis: TurntableAxis, angle_deg: float) -> ViewPose:
    """Return the pose of a view whose table stands at an angle, from the axis alone.

    Parameters
    ----------
    axis : TurntableAxis
    angle_deg : float
        Angle of the table, degrees.

    Returns
    -------
    ViewPose, into the camera coordinates of the view at angle 0. The scatter of the table is its
    noise, the error of the axis is common to all views.
    """
    T = _about(axis.point_mm, axis.direction, -np.radians(angle_deg))
    turn = T[:3, :3]
    # A point of the axis that is off by d moves by (1 − R) d, and so for the direction.
    A = np.zeros((6, 6))
    A[:3, :3] = A[3:, 3:] = np.eye(3) - turn
    to_point = pose(np.eye(3), axis.point_mm)
    common = carried(to_point, A @ axis.covariance @ A.T)
    # An angle error turns about the axis; a wobble turns about the two other directions.
    turning = np.radians(axis.scatter_deg) ** 2 * np.eye(3)
    noise = scipy.linalg.block_diag(turning, axis.scatter_mm**2 * np.eye(3))
    return ViewPose(T, carried(to_point, noise), common)


def _about(point: FloatMap, direction: FloatMap, angle: float) -> FloatMap:
    R = rotation(angle * direction)
    return pose(R, point - R @ point)


def _axis(
    poses: Sequence[FloatMap], weight: FloatMap | None = None
) -> tuple[FloatMap, FloatMap, float]:
    """Point, direction and largest rotation of the axis that poses turn about."""
    n = len(poses)
    w = np.ones(n) if weight is None else weight
    vectors, rows, right = [], [], []
    for i in range(n):
        for j in range(i + 1, n):
            between = poses[j] @ inverse(poses[i])
            share = np.sqrt(w[i] * w[j])
            turn = twist(between)[:3]
            vectors.append(share * turn)
            rows.append(share * (between[:3, :3] - np.eye(3)))
            right.append(-share * between[:3, 3])
    moments = np.einsum("ni,nj->ij", np.array(vectors), np.array(vectors))
    direction = np.linalg.eigh(moments)[1][:, -1]
    middle: FloatMap = np.stack([T[:3, 3] for T in poses]).astype(np.float64).mean(axis=0)
    # Along the axis the point is free: it stays beside the middle of the poses.
    rows.append(direction[None])
    right.append(np.array([direction @ middle]))
    point = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    first = vectors[0] if vectors[0] @ direction != 0 else vectors[-1]
    direction = direction * np.sign(first @ direction)
    return point, direction, float(max(np.linalg.norm(v) for v in vectors))


def _sense(poses: Sequence[FloatMap], direction: FloatMap, angles_deg: Sequence[float]) -> float:
    """Above 0 where growing angles turn by the right-hand rule about the direction."""
    total = 0.0
    for (one, other), step in zip(pairwise(poses), np.diff(angles_deg), strict=True):
        turn = float(twist(other @ inverse(one))[:3] @ direction)
        total += np.cos(turn - np.radians(step)) - np.cos(turn + np.radians(step))
    return total


def _scatter(
    poses: Sequence[FloatMap],
    point: FloatMap,
    direction: FloatMap,
    angles_deg: Sequence[float] | None,
) -> tuple[float, float]:
    """Standard deviations of single poses about the axis, degrees and mm per coordinate."""
    unturned = []
    for k, T in enumerate(poses):
        relative = float(twist(T @ inverse(poses[0]))[:3] @ direction)
        angle = relative if angles_deg is None else float(np.radians(angles_deg[k] - angles_deg[0]))
        unturned.append(_about(point, direction, -angle) @ T)
    to_point = inverse(pose(np.eye(3), point))
    first = unturned[0]
    off = np.array([twist(to_point @ T @ inverse(first) @ inverse(to_point)) for T in unturned])
    spread = np.std(off, axis=0, ddof=1)
    turn, shift = (float(np.sqrt(np.mean(part**2))) for part in (spread[:3], spread[3:]))
    return float(np.degrees(turn)), shift
