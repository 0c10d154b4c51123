"""Residuals of a calibration, camera and projector, and their derivatives (theory §8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.calibration.board_shape import (
    BoardShape,
    heights_of,
    smooth_modes,
)
from fringeworks.rig.calibration.parameters import DEVICE_SIZE, FURTHER_SIZE, RIG_SIZE, State
from fringeworks.rig.pinhole import project_with_derivatives, skew, transform
from fringeworks.types import FloatMap, Frozen


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
    index: NDArray[np.intp]
    """Numbers of the corners on the board, (m,)."""
    camera: int = 0
    """Number of the camera that saw it."""
    pose: int | None = None
    """Number of the board's pose, which several cameras see; None for a pose of its own: its place
    among all sightings."""

    def at(self, kept: NDArray[Any]) -> Sighting:
        """Return the same with some of the corners."""
        parts = {name: getattr(self, name)[kept] for name in CORNER_FIELDS}
        return Sighting(**parts, camera=self.camera, pose=self.pose)


CORNER_FIELDS = ("points_mm", "camera_px", "projector_px", "by_pixel", "index")
"""Fields of a ``Sighting`` with a value for each corner."""


@dataclass(frozen=True, eq=False, repr=False)
class Corners(Frozen):
    """All n corners of all sightings, one after the other."""

    pose: NDArray[np.intp]
    """Number of the board's pose, (n,)."""
    index: NDArray[np.intp]
    """Number of the board's point, (n,)."""
    points_mm: FloatMap
    """Nominal places on the board, (n, 3), mm."""
    height: FloatMap
    """x², x y, y² of these places, (n, 3); see ``heights_of``."""
    smooth: FloatMap
    """Displacements by the other smooth errors, (n, 3, s); see ``smooth_modes``."""
    camera_px: FloatMap
    """(n, 2), px."""
    projector_px: FloatMap
    """(n, 2), px."""
    by_pixel: FloatMap
    """(n, 2, 2)."""
    poses: int
    """Number of poses of the board."""
    sighting: NDArray[np.intp]
    """Number of the sighting, (n,)."""
    pose_of: NDArray[np.intp]
    """Number of the pose of every sighting."""
    camera_of: NDArray[np.intp]
    """Number of the camera of every sighting."""

    @property
    def board_points(self) -> int:
        """Number of points of the board, as far as their numbers go."""
        return int(self.index.max()) + 1

    @property
    def rows(self) -> list[slice]:
        """Which corners belong to each sighting."""
        ends = np.cumsum(np.bincount(self.sighting, minlength=len(self.pose_of)))
        return [slice(int(a), int(b)) for a, b in zip([0, *ends[:-1]], ends, strict=True)]


def corners_of(sightings: Sequence[Sighting]) -> Corners:
    """Put the corners of all sightings into single arrays."""
    sizes = [len(s.points_mm) for s in sightings]
    joined = {name: np.concatenate([getattr(s, name) for s in sightings]) for name in CORNER_FIELDS}
    number = np.arange(len(sightings))
    pose_of = np.array([k if s.pose is None else s.pose for k, s in enumerate(sightings)])
    return Corners(
        pose=np.repeat(pose_of, sizes),
        height=heights_of(joined["points_mm"], joined["points_mm"]),
        smooth=smooth_modes(joined["points_mm"]),
        poses=int(pose_of.max()) + 1,
        sighting=np.repeat(number, sizes),
        pose_of=pose_of,
        camera_of=np.array([s.camera for s in sightings]),
        **joined,
    )


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of all n corners, in px."""

    independent: FloatMap
    """(n, 4): the camera's, then the projector's at the predicted camera pixel. Their errors are
    independent."""
    projector_seen: FloatMap
    """(n, 2): the projector's at the camera pixel where the corner was seen."""
    jacobian: FloatMap
    """Derivative of the model behind ``independent`` with respect to the parameters of all devices
    (24, and 15 for every further camera), the 6 of the corner's pose, those of the board's smooth
    errors and the 3 offsets of its point, (n, 4, …); empty where it was not asked for."""


def board_places(corners: Corners, shape: BoardShape) -> FloatMap:
    """Return where the corners are on the real board, (n, 3), mm."""
    places = corners.points_mm + shape.offset_mm[corners.index]
    places[:, 2] += corners.height @ shape.bow_mm
    places += corners.smooth @ shape.smooth_mm
    return np.asarray(places)


def residuals_of(corners: Corners, state: State, *, derivatives: bool = False) -> Residuals:
    """Compute measured minus predicted pixels of all corners.

    Parameters
    ----------
    corners : Corners
    state : State
    derivatives : bool
        Whether to compute the Jacobian as well.

    Notes
    -----
    r_c = c − π_c(X) and r_p = q − Q r_c − π_p(X), with Q = ``by_pixel`` (theory §8). The projector
    coordinate is read at the corner as it was seen. A corner that is off by δ is read off by Q δ,
    and taking Q r_c away makes the two residuals independent.
    """
    T = np.stack(state.poses)[corners.pose]
    turned = np.einsum("nij,nj->ni", T[:, :3, :3], board_places(corners, state.shape))
    in_first = turned + T[:, :3, 3]
    in_projector = transform(state.rig.T_projector_camera, in_first)
    seen_by = _cameras(corners, state, in_first, derivatives=derivatives)
    projector = project_with_derivatives(state.rig.projector, in_projector)
    of_camera = corners.camera_px - seen_by.pixel
    seen = corners.projector_px - projector[0]
    of_projector = seen - np.einsum("nij,nj->ni", corners.by_pixel, of_camera)
    independent = np.concatenate((of_camera, of_projector), axis=1)
    if not derivatives:
        return Residuals(independent, seen, np.empty((0, 4, 0)))
    n, R = len(turned), state.rig.T_projector_camera[:3, :3]
    by_relative_pose = point_by_pose(in_projector - state.rig.T_projector_camera[:3, 3])
    normal = T[:, :3, 2, None] * corners.height[:, None, :]
    smooth = T[:, :3, :3] @ corners.smooth
    by_place = np.concatenate((point_by_pose(turned), normal, smooth, T[:, :3, :3]), axis=2)
    devices = state.devices_size
    jacobian = np.zeros((n, 4, devices + by_place.shape[2]))
    jacobian[:, :2, :devices] = seen_by.by_devices
    jacobian[:, :2, devices:] = seen_by.by_first @ by_place
    jacobian[:, 2:, DEVICE_SIZE : 2 * DEVICE_SIZE] = projector[2]
    jacobian[:, 2:, 2 * DEVICE_SIZE : RIG_SIZE] = projector[1] @ by_relative_pose
    jacobian[:, 2:, devices:] = (projector[1] @ R) @ by_place
    jacobian[:, 2:] -= corners.by_pixel @ jacobian[:, :2]
    return Residuals(independent, seen, jacobian)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Where every corner is seen by its own camera."""

    pixel: FloatMap
    """(n, 2), px."""
    by_first: FloatMap
    """Derivative by the point in coordinates of the first camera, (n, 2, 3)."""
    by_devices: FloatMap
    """Derivative by the parameters of all devices, (n, 2, 24 …); empty where not asked for."""


def _cameras(corners: Corners, state: State, in_first: FloatMap, *, derivatives: bool) -> _Seen:
    """Project every corner into the camera that saw it."""
    n, devices = len(in_first), state.devices_size if derivatives else 0
    found = _Seen(np.empty((n, 2)), np.empty((n, 2, 3)), np.zeros((n, 2, devices)))
    camera_of = corners.camera_of[corners.sighting]
    of_first = camera_of == 0
    pixel, by_point, by_device = project_with_derivatives(state.rig.camera, in_first[of_first])
    found.pixel[of_first], found.by_first[of_first] = pixel, by_point
    if derivatives:
        found.by_devices[of_first, :, :DEVICE_SIZE] = by_device
    for k, further in enumerate(state.further):
        own = camera_of == k + 1
        R, t = further.T_camera_first[:3, :3], further.T_camera_first[:3, 3]
        turned = in_first[own] @ R.T
        pixel, by_point, by_device = project_with_derivatives(further.camera, turned + t)
        found.pixel[own], found.by_first[own] = pixel, by_point @ R
        if derivatives:
            first = RIG_SIZE + FURTHER_SIZE * k
            by = np.concatenate((by_device, by_point @ point_by_pose(turned)), axis=2)
            found.by_devices[own, :, first : first + FURTHER_SIZE] = by
    return found


def point_by_pose(turned: FloatMap) -> FloatMap:
    """Return the derivative of R X + t with respect to a pose's parameters, (n, 3, 6).

    ``turned`` is R X, (n, 3).
    """
    return np.concatenate((-skew(turned), np.broadcast_to(np.eye(3), (len(turned), 3, 3))), axis=2)
