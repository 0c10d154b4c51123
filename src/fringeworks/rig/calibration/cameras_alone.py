"""Calibration of two cameras from photographs of a flat board, without a projector."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.rig.calibration.adjusted import Adjusted
from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import MIN_CORNERS, BoardView
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.calibrate import Observation, check_poses, sighting_of
from fringeworks.rig.calibration.cameras import MultiCalibration
from fringeworks.rig.calibration.coefficients import free_parameters, without_useless
from fringeworks.rig.calibration.correspondence import Correspondence
from fringeworks.rig.calibration.leave_out import leave_poses_out, with_smooth_board
from fringeworks.rig.calibration.refine import refined_view
from fringeworks.rig.calibration.start import start
from fringeworks.types import FloatMap, InputError, MultiRig, Pinhole
from fringeworks.types.packages import need_opencv


def observe_pair(
    name: str, images: tuple[FloatMap, FloatMap], views: tuple[BoardView, BoardView]
) -> tuple[Observation, Observation]:
    """Join the corners that two cameras see of one pose of a board.

    Parameters
    ----------
    name : str
        Name of the pose.
    images : two (h, w) arrays
        Photographs of the two cameras, counts.
    views : two BoardView
        The corners in them.

    Returns
    -------
    The observation of each camera; the other camera takes the projector's place.
    """
    sizes = [(image.shape[1], image.shape[0]) for image in images]
    found = []
    for k in (0, 1):
        own, other = views[k], views[1 - k]
        place = {int(i): n for n, i in enumerate(other.index)}
        pixels = np.full((len(own.index), 2), np.nan)
        for n, i in enumerate(own.index):
            if int(i) in place:
                pixels[n] = other.pixels[place[int(i)]]
        m = len(pixels)
        seen = Correspondence(pixels, np.zeros((m, 2, 2)), np.zeros((m, 2)), 0.0, {})
        unread = "" if seen.read.all() else "the other camera does not see them"
        found.append(Observation(name, images[k], own, seen, sizes[k], sizes[1 - k], unread))
    return found[0], found[1]


def calibrate_cameras_alone(
    observations: Sequence[tuple[Observation, Observation]],
    board: Board,
    *,
    skipped: dict[str, str] | None = None,
    distortion: int | None = None,
) -> MultiCalibration:
    """Calibrate two cameras without a projector, with the covariance of every parameter.

    Parameters
    ----------
    observations : sequence of two Observation each
        What both cameras see of a pose, by ``observe_pair``; three poses or more.
    board : Board
    skipped, distortion
        As for ``calibrate``.

    Returns
    -------
    MultiCalibration, whose rig has no projector.

    Raises
    ------
    InputError as ``calibrate``.

    Notes
    -----
    The second camera takes the place of the projector: it is a pinhole as well, and a corner's
    pixel in it is what is read of the projector otherwise. The steps are those of ``calibrate``,
    but the corners are measured again in both cameras.
    """
    need_opencv("a calibration")
    skipped = dict(skipped or {})
    first = [one for one, _ in observations]
    check_poses(first, board, skipped)
    for one in first:
        if one.found.read.sum() < MIN_CORNERS:
            raise InputError(
                f"{one.name}: expected {MIN_CORNERS} or more corners that both cameras see, got "
                f"{one.found.read.sum()}"
            )
    free = free_parameters(distortion)
    sightings = [sighting_of(o, board) for o in first]
    sizes = first[0].camera_size, first[0].projector_size
    try:
        rig, poses = start(sightings, *sizes, distortion=distortion != 0)
    except InputError as error:
        raise InputError(str(error).replace("the projector", "camera 2")) from error
    adjusted = adjust(sightings, rig, poses, free=free)
    observations = _refined(observations, board, adjusted)
    sightings = [sighting_of(one, board) for one, _ in observations]
    adjusted = adjust(sightings, adjusted.rig, adjusted.poses, free=free)
    adjusted = with_smooth_board(sightings, adjusted, free=free)
    if distortion is None:
        adjusted, left_out, free = without_useless(sightings, adjusted, free)
    else:
        left_out = leave_poses_out(sightings, adjusted, free=free)
    return MultiCalibration(
        rig=_rig_of(adjusted, left_out.inflation),
        board=board,
        observations=tuple(tuple(pair[k] for pair in observations) for k in (0, 1)),
        poses=tuple(one.name for one, _ in observations),
        skipped=skipped,
        adjusted=adjusted,
        bow_mm=adjusted.shape.bow_mm,
        bow_sigma_mm=adjusted.bow_sigma_mm * left_out.inflation,
        predicted_px=left_out.predicted_px,
        inflation=left_out.inflation,
    )


def _refined(
    observations: Sequence[tuple[Observation, Observation]], board: Board, adjusted: Adjusted
) -> list[tuple[Observation, Observation]]:
    """All corners measured again in both cameras."""
    rig = adjusted.rig
    devices: tuple[tuple[Pinhole, FloatMap], ...] = (
        (rig.camera, np.eye(4)),
        (rig.projector, rig.T_projector_camera),
    )
    found = []
    for pair, pose in zip(observations, adjusted.poses, strict=True):
        one, other = (
            refined_view(o.image, board, o.view, device, T @ pose)
            for o, (device, T) in zip(pair, devices, strict=True)
        )
        images = pair[0].image, pair[1].image
        found.append(observe_pair(pair[0].name, images, (one, other)))
    return found


def _rig_of(adjusted: Adjusted, inflation: float) -> MultiRig:
    """The two cameras as a rig, with standard deviations that are raised by a factor.

    The parameters of a rig of two devices are those of two cameras in the same order.
    """
    rig = adjusted.rig
    return MultiRig(
        (rig.camera, rig.projector),
        None,
        None,
        np.stack((np.eye(4), rig.T_projector_camera)),
        adjusted.devices_covariance * inflation**2,
        rig.residual_px,
    )
