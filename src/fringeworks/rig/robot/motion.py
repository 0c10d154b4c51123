"""Whether the robot's motions determine where the camera is."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fringeworks.rig.robot.start import rotation_vectors
from fringeworks.types import FloatMap, InputError, Mount

MIN_POSES = 4
"""Smallest number of poses. Three that turn about two axes determine both transforms; the fourth
shows whether they agree."""
LEAST_RATIO = 10.0
"""Smallest ratio of a rotation to its noise. The model is linear in the noise; below this, terms of
second order reach 1 % of the camera's distance from the flange, which σ does not hold."""
FLOOR_DEG = 0.01
"""Rotation noise that is assumed before it is known, degrees: robots of industry repeat no
better."""
ADVICE = "turn it by 20° or more about two different axes, between 10 poses or more"
"""What determines the camera's place."""


@dataclass(frozen=True)
class Motion:
    """How far the robot turned between its poses."""

    most_deg: float
    """Root mean square rotation about all axes, degrees."""
    across_deg: float
    """Root mean square rotation about axes across the main one, degrees."""
    axis: tuple[float, float, float]
    """The main axis of rotation on the camera's side."""


def motion_of(G: FloatMap) -> Motion:
    """The rotations between all pairs of poses (n, 4, 4).

    Notes
    -----
    (R − 1) t has to determine t. For a rotation by θ about a, (R − 1)ᵀ(R − 1) is 2 (1 − cos θ)
    (1 − a aᵀ): the smallest eigenvalue of its mean vanishes where all axes are parallel.
    """
    one, two = (list(part) for part in zip(*combinations(range(len(G)), 2), strict=True))
    left = G[two, :3, :3] @ np.swapaxes(G[one, :3, :3], 1, 2) - np.eye(3)
    values, vectors = np.linalg.eigh(np.einsum("mki,mkj->ij", left, left) / len(left))
    degrees = np.degrees(np.sqrt(np.maximum(values, 0.0)))
    x, y, z = (float(v) for v in vectors[:, 0])
    return Motion(float(degrees[2]), float(degrees[0]), (x, y, z))


def turns_deg(G: FloatMap) -> FloatMap:
    """Angles of the rotations between all pairs of poses (n, 4, 4), degrees.

    They are the same on both sides of a transform: those of the robot are those of the board.
    """
    one, two = (list(part) for part in zip(*combinations(range(len(G)), 2), strict=True))
    between = G[two, :3, :3] @ np.swapaxes(G[one, :3, :3], 1, 2)
    turned: FloatMap = np.degrees(np.linalg.norm(rotation_vectors(between), axis=-1))
    return turned


def is_determined(G: FloatMap, rotation_deg: float) -> bool:
    """Whether poses turn about two axes, so that they determine a transform; see
    ``check_motion``."""
    return len(G) >= MIN_POSES and motion_of(G).across_deg >= LEAST_RATIO * 2.0 * rotation_deg


def check_motion(G: FloatMap, rotation_deg: float, mount: Mount, *, certain: bool = True) -> None:
    """Refuse motions that leave the camera's place undetermined.

    Parameters
    ----------
    G : (n, 4, 4) array
        Robot poses from the board's side to the camera's.
    rotation_deg : float
        Standard deviation of a rotation of robot and corners together, degrees.
    mount : "hand" or "base"
    certain : bool
        Whether the poses can be read in one way only, so that their axis is worth naming.

    Raises
    ------
    InputError, in words: too few poses, no rotation, rotations about one axis only.
    """
    if len(G) < MIN_POSES:
        raise InputError(f"hand-eye: expected {MIN_POSES} poses or more, got {len(G)}; {ADVICE}")
    found = motion_of(G)
    # The rotation between two poses has twice the variance, about two axes.
    least = LEAST_RATIO * 2.0 * rotation_deg
    moved = "the camera" if mount == "hand" else "the board"
    if found.most_deg < least:
        raise InputError(
            f"hand-eye: the robot moved {moved} without turning it (by {found.most_deg:.2g}°, with "
            f"an error of {rotation_deg:.2g}°): translations do not determine where the camera is; "
            f"{ADVICE}"
        )
    if found.across_deg < least:
        side = "flange" if mount == "hand" else "base"
        axis = ", ".join(f"{v:+.2f}" for v in found.axis) + f" of the {side}; " if certain else ""
        raise InputError(
            f"hand-eye: the robot turned {moved} about one axis only ({axis}by "
            f"{found.across_deg:.2g}° about others, with an error of {rotation_deg:.2g}°): the "
            f"camera's place along this axis is not determined; {ADVICE}"
        )
