"""Where points are that are not in camera coordinates: in those of a robot's base, or others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types.arrays import FloatMap
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen
from fringeworks.types.robot import check_pose_covariance, check_rigid

CAMERA_FRAME = "camera"
"""Name of camera coordinates."""
MOST_LETTERS = 64
"""Largest number of letters of the name of coordinates; files and ROS write it into headers."""


def cross_matrix(v: FloatMap) -> FloatMap:
    """The matrix of a cross product, (3, 3)."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True, eq=False, repr=False)
class Placement(Frozen):
    """The coordinates that points are in, and how they came there from camera coordinates.

    Raises
    ------
    InputError for a name that is empty, has white space or more than 64 letters, a matrix that is
    no transform, and a wrong covariance.
    """

    frame: str
    """Name of the coordinates, such as "base"."""
    T_frame_camera: FloatMap
    """(4, 4), maps camera coordinates to them, mm."""
    covariance: FloatMap | None = None
    """(6, 6) covariance of its error: rotation ω (rad) and shift v (mm) about the axes of the frame
    turn R into exp(ω) R and t into t + v. None where it is exact or unknown."""

    def __post_init__(self) -> None:
        name = self.frame
        if not (isinstance(name, str) and name.isprintable() and 0 < len(name) <= MOST_LETTERS):
            raise InputError(
                f"frame: expected a name of 1 to {MOST_LETTERS} letters, got {str(name)[:80]!r}"
            )
        if any(letter.isspace() for letter in name) or name == CAMERA_FRAME:
            raise InputError(
                f"frame: expected a name without white space other than {CAMERA_FRAME}, got "
                f"{name!r}"
            )
        T = check_rigid(self.T_frame_camera, "T_frame_camera")
        object.__setattr__(self, "T_frame_camera", T)
        known = check_pose_covariance(self.covariance, "placement.covariance")
        object.__setattr__(self, "covariance", known)
        super().__post_init__()

    def then(self, T: FloatMap, frame: str, covariance: FloatMap | None) -> Placement:
        """The placement after another transform with an independent error."""
        R, moved = T[:3, :3], T[:3, :3] @ self.T_frame_camera[:3, 3]
        total = None if covariance is None else np.array(covariance, np.float64)
        if total is not None:
            lever = np.eye(6)
            lever[3:, :3] = -cross_matrix(moved)
            total = lever @ total @ lever.T
        if self.covariance is not None:
            turn = np.kron(np.eye(2), R)
            carried = turn @ self.covariance @ turn.T
            total = carried if total is None else total + carried
        return Placement(frame, T @ self.T_frame_camera, total)


def pose_sigma_mm(covariance: FloatMap, arms_mm: FloatMap) -> FloatMap:
    """Standard deviation that the error of a pose gives to points, in the worst direction.

    Parameters
    ----------
    covariance : (6, 6) array
        Of rotation (rad) and shift (mm).
    arms_mm : (..., 3) array
        Points from the origin of the coordinates that were transformed, in the new axes, mm.

    Returns
    -------
    (...) array, mm: the root of the largest eigenvalue of the (3, 3) covariance of every point.

    Notes
    -----
    A point p moves by ω × p + v. The eigenvalues of a symmetric matrix of three rows are those of
    a cubic equation (Smith, Communications of the ACM 4, 1961, doi:10.1145/355578.366316).
    """
    x, y, z = np.moveaxis(np.asarray(arms_mm, np.float64), -1, 0)
    zero, one = np.zeros_like(x), np.ones_like(x)
    # Rows of (−[p]×, 1), by axis.
    rows = (
        (zero, z, -y, one, zero, zero),
        (-z, zero, x, zero, one, zero),
        (y, -x, zero, zero, zero, one),
    )
    C = np.asarray(covariance, np.float64)

    def product(a: int, b: int) -> FloatMap:
        terms = ((i, j) for i in range(6) for j in range(6) if C[i, j] != 0.0)
        total: FloatMap = zero
        for i, j in terms:
            total = np.asarray(total + C[i, j] * rows[a][i] * rows[b][j])
        return total

    xx, yy, zz = product(0, 0), product(1, 1), product(2, 2)
    xy, xz, yz = product(0, 1), product(0, 2), product(1, 2)
    mean = (xx + yy + zz) / 3.0
    dx, dy, dz = xx - mean, yy - mean, zz - mean
    spread = np.sqrt((dx**2 + dy**2 + dz**2 + 2.0 * (xy**2 + xz**2 + yz**2)) / 6.0)
    half = 0.5 * (dx * (dy * dz - yz**2) - xy * (xy * dz - yz * xz) + xz * (xy * yz - dy * xz))
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.where(spread > 0.0, half / spread**3, 1.0)
    largest = mean + 2.0 * spread * np.cos(np.arccos(np.clip(cosine, -1.0, 1.0)) / 3.0)
    return np.asarray(np.sqrt(np.maximum(largest, 0.0)))
