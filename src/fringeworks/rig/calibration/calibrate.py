"""Calibration of a camera–projector pair from a flat board in several poses (theory §8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.bundle import (
    RIG,
    Adjusted,
    Sighting,
    adjust,
    board_bow,
    fit_pose,
    pinhole_of,
    relative_pose,
)
from fringeworks.rig.calibration.corners import LEAST, BoardView, find_board, refit
from fringeworks.rig.calibration.correspondence import Correspondence, projector_at, spacing
from fringeworks.rig.pinhole import pose, project, transform
from fringeworks.types import BoolMap, Decoded, FloatMap, InputError, Pinhole, Rig

MIN_POSES = 3
SAME_PX = 1.0
"""Poses whose corners lie nearer than this, median, are one pose taken twice."""
MIN_TILT_DEG = 5.0
"""Boards must be turned against each other by this much for focal lengths to be told."""
BEND = 0.25
"""Share of a field over which an edge's curvature is taken."""
RING = 48
"""Points of a circle when its centre of gravity is computed."""


@dataclass(frozen=True, eq=False)
class Observation:
    """A board in one pose, as camera and projector see it."""

    name: str
    """What reports call it, such as the folder."""
    image: NDArray[Any]
    """The board under even light, (h, w), counts."""
    view: BoardView
    """Corners in the camera."""
    found: Correspondence
    """The same places on the projector."""
    camera_size: tuple[int, int]
    """Columns and rows."""
    projector_size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated rig, and what it was calibrated from."""

    rig: Rig
    board: Board
    observations: tuple[Observation, ...]
    """Those that were used."""
    skipped: dict[str, str]
    """Poses that could not be used, and why."""
    adjusted: Adjusted
    bow_mm: FloatMap
    """(3,) how far x², x y and y² lift the board off its plane half a board from its middle."""
    bow_sigma_mm: FloatMap
    """(3,)"""
    predicted_px: tuple[float, ...]
    """Per pose: root mean square error of the projector's corners as predicted from the camera's
    by a calibration without that pose; empty where there are too few poses."""


def observe(
    image: NDArray[Any],
    decoded: Decoded,
    board: Board,
    *,
    projector_size: tuple[int, int],
    name: str = "pose",
) -> Observation:
    """Find a board's corners and where the projector lights them.

    Parameters
    ----------
    image : (h, w) array
        Grey picture of the board under even light, counts.
    decoded : Decoded
        Both axes of the projector, maps (h, w).
    board : Board
    projector_size : (columns, rows)
    name : str
        What errors and reports call this pose.

    Raises
    ------
    InputError, with the name, where the board or its coordinates are not found.
    """
    picture = np.asarray(image)
    for found in decoded.maps.values():
        if found.coordinate_px.shape != picture.shape:
            raise InputError(
                f"{name}: expected coordinates of shape {picture.shape}, "
                f"got {found.coordinate_px.shape}"
            )
    try:
        view = find_board(picture, board)
        read = projector_at(decoded, view.pixels, spacing(view.pixels))
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    lit = np.asarray(np.isfinite(read.projector_px).all(axis=1))
    if lit.sum() < LEAST:
        raise InputError(
            f"{name}: expected {LEAST} corners with projector coordinates or more, got {lit.sum()} "
            f"of {len(lit)} that the camera sees: the projector does not light the board"
        )
    height, width = picture.shape
    return Observation(name, picture, view, read, (width, height), projector_size)


def calibrate(
    observations: Sequence[Observation],
    board: Board,
    *,
    skipped: dict[str, str] | None = None,
    distortion: int = 5,
) -> Calibration:
    """Both devices and their relative pose, with the covariance of every parameter.

    Parameters
    ----------
    observations : sequence of Observation
        Three poses or more, turned against each other; ten are usual.
    board : Board
    skipped : dict, optional
        Poses that could not be observed, and why; named in errors and kept for reports.
    distortion : 0, 2, 4 or 5
        Coefficients per lens: none; k₁, k₂; and p₁, p₂; and k₃.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError that names the cause: too few poses, poses that are the same or parallel, rows and
    columns of the projector swapped, sizes that differ.

    Notes
    -----
    The projector's coordinates at the board's corners make it a camera (Zhang and Huang, Optical
    Engineering 45, 2006), each device alone gives a start (Zhang, IEEE PAMI 22, 2000), and bundle
    adjustment over all poses the result. No homographies of patches are used.
    """
    skipped = dict(skipped or {})
    _check_poses(observations, board, skipped)
    _check_orientation(observations)
    free = _free(distortion)
    sightings = [_sighting(o, board) for o in observations]
    start = _start(observations, sightings)
    adjusted = adjust(sightings, *start, free=free)
    # Now that the lens and the poses are nearly known, what they do to a corner's look is, too.
    observations = [
        _seen_again(o, board, adjusted.rig.camera, T)
        for o, T in zip(observations, adjusted.poses, strict=True)
    ]
    sightings = [_sighting(o, board) for o in observations]
    adjusted = adjust(sightings, adjusted.rig, adjusted.poses, free=free)
    bow, bow_covariance = board_bow(sightings, adjusted, free=free)
    return Calibration(
        rig=adjusted.rig,
        board=board,
        observations=tuple(observations),
        skipped=skipped,
        adjusted=adjusted,
        bow_mm=bow,
        bow_sigma_mm=np.sqrt(np.diag(bow_covariance)),
        predicted_px=_predictions(sightings, adjusted, free),
    )


def _free(distortion: int) -> BoolMap:
    if distortion not in (0, 2, 4, 5):
        raise InputError(f"distortion: expected 0, 2, 4 or 5 coefficients, got {distortion}")
    free = np.ones(RIG, bool)
    for first in (4, 13):
        free[first + distortion : first + 5] = False
    return free


def _check_poses(
    observations: Sequence[Observation], board: Board, skipped: dict[str, str]
) -> None:
    if len(observations) < MIN_POSES:
        why = "".join(f"; {reason}" for reason in skipped.values())
        raise InputError(
            f"calibration: expected the board in {MIN_POSES} poses or more, "
            f"got {len(observations)}{why}"
        )
    for what in ("camera_size", "projector_size"):
        sizes = {getattr(o, what) for o in observations}
        if len(sizes) > 1:
            raise InputError(
                f"calibration: expected one {what.replace('_', ' ')}, got "
                + ", ".join(f"{w} × {h}" for w, h in sorted(sizes))
            )
    groups = _alike(observations, board)
    if len(groups) < MIN_POSES:
        same = "; ".join(" and ".join(group) for group in groups if len(group) > 1)
        raise InputError(
            f"calibration: expected {MIN_POSES} poses or more that differ, got {len(groups)}: the "
            f"board did not move between {same}"
        )


def unmoved(observations: Sequence[Observation], board: Board) -> list[list[str]]:
    """Names of poses between which the board did not move, those of one place together."""
    return [group for group in _alike(observations, board) if len(group) > 1]


def _alike(observations: Sequence[Observation], board: Board) -> list[list[str]]:
    """Names of poses, those that are the same together."""
    n = len(board.points_mm)
    groups: list[tuple[FloatMap, list[str]]] = []
    for o in observations:
        whole = np.full((n, 2), np.nan)
        whole[o.view.index] = o.view.pixels
        for place, names in groups:
            off = np.linalg.norm(whole - place, axis=1)
            if np.isfinite(off).any() and np.nanmedian(off) < SAME_PX:
                names.append(o.name)
                break
        else:
            groups.append((whole, [o.name]))
    return [names for _, names in groups]


def _check_orientation(observations: Sequence[Observation]) -> None:
    """Seen from the same side, a board has the same orientation in both devices."""
    mirrored = []
    for o in observations:
        by = o.found.by_pixel
        turn = by[:, 0, 0] * by[:, 1, 1] - by[:, 0, 1] * by[:, 1, 0]
        if np.nanmedian(turn) < 0:
            mirrored.append(o.name)
    if mirrored:
        all_of = "all poses" if len(mirrored) == len(observations) else ", ".join(mirrored)
        raise InputError(
            f"calibration: the projector's image is mirrored in {all_of}: its columns and rows are "
            "swapped in the plan, or one of the axes (or the camera's image) is reversed"
        )


def _sighting(o: Observation, board: Board) -> Sighting:
    good = np.isfinite(o.found.projector_px).all(axis=1)
    return Sighting(
        board.points_mm[o.view.index[good]],
        o.view.pixels[good],
        o.found.projector_px[good],
        o.found.by_pixel[good],
    )


def _seen_again(o: Observation, board: Board, camera: Pinhole, T: FloatMap) -> Observation:
    """The board's corners with what a first calibration knows of lens and pose."""
    points = board.points_mm[o.view.index]
    if board.kind in ("circles", "asymmetric-circles"):
        pixels = o.view.pixels + _circle_shift(o.view, points, board, camera, T)
        view = replace(o.view, pixels=pixels)
    else:
        view = refit(o.image, board, o.view, *_bent_edges(points, board, camera, T))
    # Corners move by a part of a pixel, over which what is read there changes evenly.
    shift = np.einsum("nij,nj->ni", o.found.by_pixel, view.pixels - o.view.pixels)
    return replace(o, view=view, found=replace(o.found, projector_px=o.found.projector_px + shift))


def _bent_edges(
    points: FloatMap, board: Board, camera: Pinhole, T: FloatMap
) -> tuple[FloatMap, FloatMap]:
    """Edges (n, 2, 2), px, and by how much the lens bends them, (n, 2), 1/px."""
    middle = project(camera, transform(T, points))
    edges, bends = [], []
    for step in BEND * board.pitch_mm * np.eye(3)[:2]:
        one = project(camera, transform(T, points + step)) - middle
        other = project(camera, transform(T, points - step)) - middle
        along = one - other
        length = np.linalg.norm(along, axis=1, keepdims=True)
        normal = np.column_stack((-along[:, 1], along[:, 0])) / length
        edges.append(along / (2.0 * BEND))
        bends.append(np.sum((one + other) * normal, axis=1) / (0.5 * length[:, 0] ** 2))
    return np.stack(edges, axis=1), np.stack(bends, axis=1)


def _circle_shift(
    view: BoardView, points: FloatMap, board: Board, camera: Pinhole, T: FloatMap
) -> FloatMap:
    """From the centre of gravity of a circle's image to its centre's: perspective parts them."""
    assert view.ink_px is not None
    steps = 0.01 * board.pitch_mm * np.eye(3)[:2]
    (ax, ay), (bx, by) = (
        (
            project(camera, transform(T, points + step))
            - project(camera, transform(T, points - step))
        ).T
        for step in steps
    )
    per_mm2 = np.abs(ax * by - ay * bx) / (0.02 * board.pitch_mm) ** 2
    radius = float(np.median(np.sqrt(view.ink_px / (np.pi * per_mm2))))
    angle = np.linspace(0.0, 2.0 * np.pi, RING, endpoint=False)
    ring = radius * np.column_stack((np.cos(angle), np.sin(angle), np.zeros(RING)))
    rim = project(camera, transform(T, points[:, None] + ring))
    after = np.roll(rim, -1, axis=1)
    wedge = rim[..., 0] * after[..., 1] - after[..., 0] * rim[..., 1]
    gravity = np.sum((rim + after) * wedge[..., None], axis=1) / (3.0 * wedge.sum(axis=1))[:, None]
    return np.asarray(project(camera, transform(T, points)) - gravity)


def _start(
    observations: Sequence[Observation], sightings: Sequence[Sighting]
) -> tuple[Rig, list[FloatMap]]:
    first = observations[0]
    camera, in_camera = _alone("camera", sightings, first.camera_size)
    projector, in_projector = _alone("projector", sightings, first.projector_size)
    _check_tilts(observations, in_camera)
    return Rig(camera, projector, relative_pose(in_camera, in_projector)), in_camera


def _alone(
    device: str, sightings: Sequence[Sighting], size: tuple[int, int]
) -> tuple[Pinhole, list[FloatMap]]:
    """A device by itself, as OpenCV calibrates a camera; and the board's poses before it."""
    pixels = [s.camera_px if device == "camera" else s.projector_px for s in sightings]
    points = [s.points_mm.astype(np.float32) for s in sightings]
    images = [p.astype(np.float32) for p in pixels]
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    try:
        _, K, d, turns, shifts = cv2.calibrateCamera(points, images, size, None, None, flags=flags)
    except cv2.error as error:
        raise InputError(
            f"calibration: no start for the {device}: {str(error).splitlines()[0]}"
        ) from error
    k = np.zeros(5)
    k[: min(5, d.size)] = d.ravel()[:5]
    values = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *k])
    if not np.isfinite(values).all() or min(K[0, 0], K[1, 1]) <= 0:
        raise InputError(
            f"calibration: no start for the {device}: its focal length came out as {K[0, 0]:g} px"
        )
    poses = [
        pose(np.asarray(cv2.Rodrigues(r)[0], np.float64), np.ravel(t))
        for r, t in zip(turns, shifts, strict=True)
    ]
    return pinhole_of(values, Pinhole(*size, (1.0, 1.0), (0.0, 0.0))), poses


def tilts_deg(poses: Sequence[FloatMap]) -> FloatMap:
    """Angles between the normals of boards, (n, n), degrees."""
    normals = np.stack([T[:3, 2] for T in poses])
    return np.degrees(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)))


def _check_tilts(observations: Sequence[Observation], poses: Sequence[FloatMap]) -> None:
    largest = float(tilts_deg(poses).max())
    if largest < MIN_TILT_DEG:
        raise InputError(
            f"calibration: expected boards turned against each other by {MIN_TILT_DEG:g}° or more, "
            f"got {len(observations)} that are parallel to {largest:.1f}°: they do not tell focal "
            "lengths from distances"
        )


def _predictions(
    sightings: Sequence[Sighting], adjusted: Adjusted, free: BoolMap
) -> tuple[float, ...]:
    if len(sightings) <= MIN_POSES:
        return ()
    found = []
    for k, left_out in enumerate(sightings):
        others = [s for n, s in enumerate(sightings) if n != k]
        poses = [T for n, T in enumerate(adjusted.poses) if n != k]
        try:
            rig = adjust(others, adjusted.rig, poses, free=free).rig
        except InputError:
            found.append(float("nan"))
            continue
        used = adjusted.used[k]
        part = Sighting(*(getattr(left_out, f)[used] for f in Sighting.__dataclass_fields__))
        if len(part.points_mm) < LEAST:
            found.append(float("nan"))
            continue
        T = fit_pose(part, rig, adjusted.poses[k])
        seen = transform(rig.T_projector_camera, transform(T, part.points_mm))
        off = part.projector_px - project(rig.projector, seen)
        found.append(float(np.sqrt(np.mean(np.sum(off**2, axis=1)))))
    return tuple(found)
