"""Calibration of a rig from a flat board in several poses (theory §8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.calibration.adjusted import Adjusted
from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import MIN_CORNERS, BoardView
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.camera_blur import camera_blur
from fringeworks.rig.calibration.coefficients import free_parameters, without_useless
from fringeworks.rig.calibration.corners import find_board
from fringeworks.rig.calibration.correspondence import Correspondence, projector_at, spacing
from fringeworks.rig.calibration.device_fields import Fields, with_fields
from fringeworks.rig.calibration.leave_out import LeftOut, leave_poses_out, with_smooth_board
from fringeworks.rig.calibration.refine import refined_view
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.rig.calibration.start import start
from fringeworks.rig.calibration.structure import in_projector_px, structures_px
from fringeworks.types import (
    BoardNotFound,
    BoolMap,
    Decoded,
    FloatMap,
    Frozen,
    InputError,
    Pinhole,
    Plotted,
    Reason,
    Rig,
    explained,
)
from fringeworks.types.packages import need_opencv

MIN_POSES = 3
"""Smallest number of different poses of the board. Two determine a device only with assumptions
about its principal point (Zhang 2000)."""
SAME_POSE_PX = 1.0
"""Median distance of the corners of two poses below which they count as one pose, camera px.
Corners of a board that was not touched repeat to 0.1 px; a board moved by hand is many px away."""


@dataclass(frozen=True, eq=False, repr=False)
class Observation(Frozen):
    """One pose of the board, as measured: its photograph and its corners in both devices.

    A ``BoardView`` has the corners in the camera only. A ``Sighting`` has only the numbers of an
    observation that enter bundle adjustment.
    """

    name: str
    """Name of the pose in reports and messages, such as its folder."""
    image: NDArray[Any]
    """Photograph of the board under even light, (h, w), counts."""
    view: BoardView
    """The corners in the camera's frame."""
    found: Correspondence
    """The projector coordinates at those corners."""
    camera_size: tuple[int, int]
    """Columns and rows of the camera."""
    projector_size: tuple[int, int]
    """Columns and rows of the projector."""
    unread: str = ""
    """Why corners have no projector coordinates; empty where all have them."""


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Plotted, Frozen):
    """A calibrated rig, and what it was calibrated from."""

    rig: Rig
    """Both devices and their relative pose, with the covariance of all 24 parameters."""
    board: Board
    observations: tuple[Observation, ...]
    """The poses that were used, with their corners as measured the second time."""
    skipped: dict[str, str]
    """Names of the poses that could not be observed, with the reason."""
    adjusted: Adjusted
    """The bundle adjustment: poses, residuals, outliers."""
    bow_mm: FloatMap
    """Quadratic flatness coefficients of the board (x², x y, y²) in mm, with coordinates scaled to
    ±1 at half the board's size, (3,)."""
    bow_sigma_mm: FloatMap
    """Their standard deviations, (3,), mm."""
    predicted_px: tuple[float, ...]
    """Per pose: root mean square error of its projector coordinates, predicted from its camera
    corners by a calibration without this pose, px; empty for three poses or fewer."""
    inflation: float = 1.0
    """Factor ≥ 1 by which the standard deviations were raised, because leaving out poses changes
    the rig by more than independent errors of corners explain, and because the devices' fields make
    the scatter smaller."""
    structure_px: tuple[float, float] = (0.0, 0.0)
    """Errors of camera and projector that depend on the place in their frames, which the model of
    the lenses and the fields do not hold: root mean square of the worse coordinate, px; 0 where not
    certain."""
    field_px: tuple[float, float] = (0.0, 0.0)
    """Root mean square at the corners of the fields of camera and projector, by which they deviate
    from Brown's model, px; 0 for none."""
    field_sigma_px: tuple[float, float] = (0.0, 0.0)
    """Root mean square of their standard deviations there, px."""


def observe(
    image: NDArray[Any],
    decoded: Decoded,
    board: Board,
    *,
    projector_size: tuple[int, int],
    name: str = "pose",
) -> Observation:
    """Find the corners of a board in one pose, and read the projector coordinates there.

    Parameters
    ----------
    image : (h, w) array
        Grey photograph of the board under even light, counts.
    decoded : Decoded
        Projector coordinates along both axes, maps (h, w).
    board : Board
    projector_size : (columns, rows)
    name : str
        Name of this pose in errors and reports.

    Returns
    -------
    Observation

    Raises
    ------
    InputError, with the name, where the board or the projector coordinates of its corners are not
    found.
    """
    need_opencv("a calibration")
    photograph = np.asarray(image)
    for coordinates in decoded.maps.values():
        if coordinates.coordinate_px.shape != photograph.shape:
            raise InputError(
                f"{name}: expected coordinates of shape {photograph.shape}, "
                f"got {coordinates.coordinate_px.shape}"
            )
    try:
        view = find_board(photograph, board)
        correspondence = projector_at(decoded, view.pixels, spacing(view.pixels))
    except InputError as error:
        raise explained(error, decoded.findings).at(name) from error
    lit = correspondence.read
    unread = "" if lit.all() else _why_unread(decoded, view.pixels[~lit])
    if lit.sum() < MIN_CORNERS:
        raise BoardNotFound(
            f"{name}: expected {MIN_CORNERS} or more corners with projector coordinates, got "
            f"{lit.sum()} of the {len(lit)} that the camera sees: {unread}",
            findings=[replace(f, seen=f"{name}: {f.seen}") for f in decoded.findings],
        )
    height, width = photograph.shape
    size = (width, height)
    return Observation(name, photograph, view, correspondence, size, projector_size, unread)


def _why_unread(decoded: Decoded, corners_px: FloatMap) -> str:
    """Why most of these corners have no projector coordinates, by the pixels next to them."""
    column, row = np.rint(corners_px).astype(int).T
    reasons: list[Reason] = []
    for found in decoded.maps.values():
        h, w = found.reason.shape
        at_corners = found.reason[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)]
        decoded_anywhere = bool(np.isfinite(found.coordinate_px).any())
        reasons += [Reason(int(r)) for r in at_corners if r != Reason.OK or not decoded_anywhere]
    if 2 * len(reasons) < len(corners_px) * len(decoded.maps):
        return (
            "the coordinates around the corners scatter or jump; more light, or a plan with more "
            "frames, makes them steadier"
        )
    most = max(set(reasons), key=reasons.count)
    if most in (Reason.OK, Reason.SHADOW, Reason.OUTSIDE):
        return "the projector does not light the board"
    if most == Reason.LOW_MODULATION:
        return (
            "the projector lights the board, but the fringes there are too weak; a longer "
            "exposure, less room light, a sharper projector or wider fringes make them stronger"
        )
    name = most.name.lower().replace("_", " ")
    return f"most pixels there are not decoded ({name}), although the projector may light the board"


def calibrate(
    observations: Sequence[Observation],
    board: Board,
    *,
    skipped: dict[str, str] | None = None,
    distortion: int | None = None,
) -> Calibration:
    """Calibrate both devices and their relative pose, with the covariance of every parameter.

    Parameters
    ----------
    observations : sequence of Observation
        Three poses or more, tilted against each other; ten are usual.
    board : Board
    skipped : dict, optional
        Names of poses that could not be observed, with the reason: for errors and reports.
    distortion : 0, 2, 4 or 5, optional
        Number of distortion coefficients to estimate for each device. 2: k₁ and k₂; 4: p₁ and p₂
        as well; 5: k₃ as well. By default five are estimated, and k₃ is left out where the
        poses do not determine it, and a field where the devices deviate from this model.
        Coefficients that are not estimated are 0.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError that names the cause: too few poses, poses that are the same or parallel, rows and
    columns of the projector swapped, frame sizes that differ.

    Notes
    -----
    The projector coordinates at the board's corners make the projector an inverse camera (Zhang
    and Huang, Optical Engineering 45, 2006, doi:10.1117/1.2336196). Each device alone gives a start
    (Zhang, IEEE PAMI 22, 2000, doi:10.1109/34.888718), bundle adjustment over all poses the result.
    Then the corners are measured again with the devices and poses known, and adjusted once more.
    The board's print errors and bow are estimated as well (``adjust``). Every pose is left out in
    turn; where the rig then changes by more than its covariance says, the covariance is raised
    (``leave_poses_out``). Where there is evidence that a device deviates from Brown's model, a
    smooth field of it is estimated as well (``with_fields``).
    No homographies of patches are used.
    """
    need_opencv("a calibration")
    skipped = dict(skipped or {})
    check_poses(observations, board, skipped)
    check_orientation(observations)
    free = free_parameters(distortion)
    sightings = [sighting_of(o, board) for o in observations]
    first = observations[0]
    rig, poses = start(
        sightings, first.camera_size, first.projector_size, distortion=distortion != 0
    )
    adjusted = adjust(sightings, rig, poses, free=free)
    observations = [
        refined(o, board, adjusted.rig.camera, T)
        for o, T in zip(observations, adjusted.poses, strict=True)
    ]
    sightings = [sighting_of(o, board) for o in observations]
    adjusted = adjust(sightings, adjusted.rig, adjusted.poses, free=free)
    adjusted = with_smooth_board(sightings, adjusted, free=free)
    adjusted, left_out, fields = _as_needed(sightings, adjusted, free, distortion)
    inflation = left_out.inflation * fields.scatter_factor(sum(len(s.index) for s in sightings))
    structure = structures_px(sightings, adjusted)
    rig = fields.inflated(adjusted.rig, inflation)
    blur = camera_blur([o.view for o in observations], adjusted.poses, board, rig.camera.shape)
    return Calibration(
        rig=replace(rig, structure_px=in_projector_px(rig, structure), blur=blur),
        board=board,
        observations=tuple(observations),
        skipped=skipped,
        adjusted=adjusted,
        bow_mm=adjusted.shape.bow_mm,
        bow_sigma_mm=adjusted.bow_sigma_mm * inflation,
        predicted_px=left_out.predicted_px,
        inflation=inflation,
        structure_px=structure,
        field_px=fields.size_px,
        field_sigma_px=fields.sigma_px,
    )


def _as_needed(
    sightings: Sequence[Sighting], adjusted: Adjusted, free: BoolMap, distortion: int | None
) -> tuple[Adjusted, LeftOut, Fields]:
    """Add fields where there is evidence of them, or leave out k₃ where it is useless; neither
    where the number of coefficients is given.

    A field holds what k₃ leaves, so that nothing is gained by leaving it out beside one.
    """
    if distortion is not None:
        return adjusted, leave_poses_out(sightings, adjusted, free=free), Fields.none()
    adjusted, fields = with_fields(sightings, adjusted, free=free)
    if fields.any:
        return adjusted, leave_poses_out(sightings, adjusted, free=free), fields
    adjusted, left_out, _ = without_useless(sightings, adjusted, free)
    return adjusted, left_out, fields


def check_poses(observations: Sequence[Observation], board: Board, skipped: dict[str, str]) -> None:
    if len(observations) < MIN_POSES:
        raise InputError(
            f"calibration: expected the board in {MIN_POSES} poses or more, "
            f"got {len(observations)}{_reasons(skipped)}"
        )
    for size_name in ("camera_size", "projector_size"):
        sizes = {getattr(o, size_name) for o in observations}
        if len(sizes) > 1:
            raise InputError(
                f"calibration: expected one {size_name.replace('_', ' ')}, got "
                + ", ".join(f"{w} × {h}" for w, h in sorted(sizes))
            )
    groups = _same_poses(observations, board)
    if len(groups) < MIN_POSES:
        same = "; ".join(" and ".join(group) for group in groups if len(group) > 1)
        raise InputError(
            f"calibration: expected {MIN_POSES} or more different poses, got {len(groups)}: the "
            f"board did not move between {same}"
        )


def _reasons(skipped: dict[str, str]) -> str:
    """Every skipped pose with its reason; poses of one reason together."""
    poses: dict[str, list[str]] = {}
    for name, reason in skipped.items():
        poses.setdefault(reason.removeprefix(f"{name}: "), []).append(name)
    return "".join(f"; {', '.join(names)}: {reason}" for reason, names in poses.items())


def unmoved(observations: Sequence[Observation], board: Board) -> list[list[str]]:
    """Return the names of poses between which the board did not move, one list for each place."""
    return [group for group in _same_poses(observations, board) if len(group) > 1]


def _same_poses(observations: Sequence[Observation], board: Board) -> list[list[str]]:
    """Names of all poses, those that are the same in one list."""
    n = len(board.points_mm)
    groups: list[tuple[FloatMap, list[str]]] = []
    for o in observations:
        corners = np.full((n, 2), np.nan)
        corners[o.view.index] = o.view.pixels
        for first_corners, names in groups:
            distance = np.linalg.norm(corners - first_corners, axis=1)
            if np.isfinite(distance).any() and np.nanmedian(distance) < SAME_POSE_PX:
                names.append(o.name)
                break
        else:
            groups.append((corners, [o.name]))
    return [names for _, names in groups]


def check_orientation(observations: Sequence[Observation]) -> None:
    """Refuse mirrored poses: seen from its front, a board has one orientation in both devices."""
    mirrored = []
    for o in observations:
        by_pixel = o.found.by_pixel
        determinant = by_pixel[:, 0, 0] * by_pixel[:, 1, 1] - by_pixel[:, 0, 1] * by_pixel[:, 1, 0]
        if np.nanmedian(determinant) < 0:
            mirrored.append(o.name)
    if mirrored:
        names = "all poses" if len(mirrored) == len(observations) else ", ".join(mirrored)
        raise InputError(
            f"calibration: the projector's image is mirrored in {names}: its columns and rows are "
            "swapped in the plan, or one of the axes (or the camera's image) is reversed; a plan "
            'says of a projector that shows columns from right to left: mirrored = ["x"]'
        )


def sighting_of(o: Observation, board: Board) -> Sighting:
    """Return the corners of an observation that have projector coordinates."""
    lit = o.found.read
    return Sighting(
        board.points_mm[o.view.index[lit]],
        o.view.pixels[lit],
        o.found.projector_px[lit],
        o.found.by_pixel[lit],
        o.view.index[lit],
    )


def refined(o: Observation, board: Board, camera: Pinhole, T: FloatMap) -> Observation:
    """Return an observation with its corners measured again, for a camera and pose nearly known."""
    view = refined_view(o.image, board, o.view, camera, T)
    # Corners move by less than a pixel, over which the projector coordinate is linear.
    shift = np.einsum("nij,nj->ni", o.found.by_pixel, view.pixels - o.view.pixels)
    return replace(o, view=view, found=replace(o.found, projector_px=o.found.projector_px + shift))
