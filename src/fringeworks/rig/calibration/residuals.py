"""Residuals of a calibration, camera and projector, and their derivatives (theory §8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fringeworks.rig.calibration.parameters import (
    DEVICE_SIZE,
    POSE_SIZE,
    RIG_SIZE,
    State,
    pose_slice,
)
from fringeworks.rig.pinhole import project_with_derivatives, skew, transform
from fringeworks.types import FloatMap, Frozen, Rig


@dataclass(frozen=True, eq=False, repr=False)
class Sighting(Frozen):
    """The corners of the board that both devices see in one pose, as numbers for the adjustment.

    An ``Observation`` is everything known about a pose, with its photograph and its name. A
    ``Sighting`` is only what bundle adjustment needs of it.
    """

    points_mm: FloatMap
    """Corners on the board, (m, 3), mm."""
    camera_px: FloatMap
    """The corners in the camera's frame, (m, 2), px."""
    projector_px: FloatMap
    """Projector coordinates read at those camera pixels, (m, 2), px."""
    by_pixel: FloatMap
    """Derivative of the projector coordinate with respect to the camera pixel, (m, 2, 2)."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of all n corners, in px."""

    independent: FloatMap
    """(n, 4): the camera's, then the projector's at the predicted camera pixel. Their errors are
    independent."""
    projector_seen: FloatMap
    """(n, 2): the projector's at the camera pixel where the corner was seen."""
    jacobian: FloatMap
    """Derivative of the model behind ``independent`` with respect to all parameters,
    (n, 4, 24 + 6 poses); empty where it was not asked for."""


def rows_of(sightings: Sequence[Sighting]) -> list[slice]:
    """Return which rows of arrays over all corners belong to each sighting."""
    ends = np.cumsum([len(s.points_mm) for s in sightings])
    return [
        slice(int(end) - len(s.points_mm), int(end)) for end, s in zip(ends, sightings, strict=True)
    ]


def residuals_of(
    sightings: Sequence[Sighting], state: State, *, derivatives: bool = False
) -> Residuals:
    """Compute measured minus predicted pixels of all corners.

    Parameters
    ----------
    sightings : sequence of Sighting
    state : State
    derivatives : bool
        Whether to compute the Jacobian as well.

    Notes
    -----
    r_c = c − π_c(X) and r_p = q − Q r_c − π_p(X), with Q = ``by_pixel`` (theory §8). The projector
    coordinate is read at the corner as it was seen. A corner that is off by δ is read off by Q δ,
    and taking Q r_c away makes the two residuals independent.
    """
    rows = rows_of(sightings)
    corners = rows[-1].stop if rows else 0
    independent = np.empty((corners, 4))
    projector_seen = np.empty((corners, 2))
    size = RIG_SIZE + POSE_SIZE * len(sightings)
    jacobian = np.zeros((corners if derivatives else 0, 4, size))
    for k, (sighting, T) in enumerate(zip(sightings, state.poses, strict=True)):
        turned = sighting.points_mm @ T[:3, :3].T
        in_camera = turned + T[:3, 3]
        in_projector = transform(state.rig.T_projector_camera, in_camera)
        camera = project_with_derivatives(state.rig.camera, in_camera)
        projector = project_with_derivatives(state.rig.projector, in_projector)
        of_pose = independent[rows[k]]
        of_pose[:, :2] = sighting.camera_px - camera[0]
        projector_seen[rows[k]] = sighting.projector_px - projector[0]
        of_pose[:, 2:] = projector_seen[rows[k]] - np.einsum(
            "nij,nj->ni", sighting.by_pixel, of_pose[:, :2]
        )
        if derivatives:
            _fill_jacobian(
                jacobian[rows[k]],
                pose_slice(k),
                (turned, in_camera, state.rig),
                camera[1:],
                projector[1:],
            )
            jacobian[rows[k], 2:] -= sighting.by_pixel @ jacobian[rows[k], :2]
    return Residuals(independent, projector_seen, jacobian)


def _fill_jacobian(
    jacobian: FloatMap,
    pose_columns: slice,
    geometry: tuple[FloatMap, FloatMap, Rig],
    camera: tuple[FloatMap, FloatMap],
    projector: tuple[FloatMap, FloatMap],
) -> None:
    """Write the derivatives of one sighting's predicted pixels.

    ``geometry``: the board's points turned as in the camera, the same in camera coordinates, and
    the rig. ``camera`` and ``projector``: derivatives of their pixels with respect to the point
    and to the device.
    """
    turned, in_camera, rig = geometry
    R = rig.T_projector_camera[:3, :3]
    by_pose = point_by_pose(turned)
    by_relative_pose = point_by_pose(in_camera @ R.T)
    jacobian[:, :2, :DEVICE_SIZE] = camera[1]
    jacobian[:, :2, pose_columns] = camera[0] @ by_pose
    jacobian[:, 2:, DEVICE_SIZE : 2 * DEVICE_SIZE] = projector[1]
    jacobian[:, 2:, 2 * DEVICE_SIZE : RIG_SIZE] = projector[0] @ by_relative_pose
    jacobian[:, 2:, pose_columns] = projector[0] @ R @ by_pose


def point_by_pose(turned: FloatMap) -> FloatMap:
    """Return the derivative of R X + t with respect to a pose's parameters, (n, 3, 6).

    ``turned`` is R X, (n, 3).
    """
    return np.concatenate((-skew(turned), np.broadcast_to(np.eye(3), (len(turned), 3, 3))), axis=2)
