"""Stacks of several cameras that saw one projector → a calibrated rig, and points."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.multi_rig import read_multi_rig
from fringeworks.patterns.plan import PatternPlan
from fringeworks.pipeline.boards import ObservedPoses, observe_poses
from fringeworks.pipeline.decoding import decoded_exposures, given_options
from fringeworks.pipeline.inputs import inputs_of, stacks_of
from fringeworks.pipeline.scene_colour import scene_brightness
from fringeworks.pipeline.stacks import check_projector
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.rig.calibration.cameras import MultiCalibration, calibrate_cameras
from fringeworks.rig.camera_findings import camera_findings, uncertainty_findings
from fringeworks.rig.camera_points import CameraPoints, camera_points, joined_points
from fringeworks.rig.coded_points import coded_points
from fringeworks.rig.device_pairs import camera_pair
from fringeworks.rig.stereo_match import CoordinateField
from fringeworks.rig.triangulate import triangulate
from fringeworks.stack.frames import Stack
from fringeworks.stack.options import DecodeOptions
from fringeworks.types import (
    Axis,
    BoolMap,
    Decoded,
    Finding,
    Frozen,
    InputError,
    MultiRig,
    Noted,
    Plotted,
    Points,
    Reason,
    RigMismatch,
    found_before,
    made_by,
    numbered,
)


@dataclass(frozen=True, eq=False, repr=False)
class MultiMeasurement(Noted, Plotted, Frozen):
    """The points of a scene that several cameras saw."""

    points: Points
    """All points in coordinates of the first camera. A place that several cameras see appears once,
    on the first camera that sees it. Within three pixels of an edge nothing is matched; there it
    appears in every camera."""
    cameras: tuple[CameraPoints, ...]
    """Per camera: the points on its pixels, in its own coordinates, with all pairs and how far they
    disagree. Without a calibrated projector the pairs are those with other cameras."""
    decoded: tuple[Decoded, ...]
    """Projector coordinates of every camera."""
    findings: tuple[Finding, ...]
    """What was found in the frames of the cameras and in how they agree."""
    seconds: float
    """Time that decoding and triangulation took."""


def calibrate_camera_stacks(
    cameras: Sequence[Iterable[tuple[str, Stack]] | StrPath],
    board: Board | str,
    *,
    plan: PatternPlan | StrPath | None = None,
    distortion: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
    **options: Unpack[DecodeOptions],
) -> MultiCalibration:
    """Calibrate several cameras and one projector from stacks of a board in several poses.

    Parameters
    ----------
    cameras : sequence, one entry per camera
        Each as ``stacks`` of ``calibrate_stacks``: a folder with a stack per pose, or pairs of name
        and Stack. Stacks with one name are of one pose of the board. A camera need not see all
        poses, but must have one in common with an earlier camera; two or more are advisable.
    board, plan, distortion, progress, **options
        As for ``calibrate_stacks``.

    Returns
    -------
    MultiCalibration, in coordinates of the first camera.

    Raises
    ------
    InputError for no camera, where too few poses are left, and as ``calibrate_cameras``.
    """
    if not cameras:
        raise InputError("cameras: expected the poses of one camera or more, got none")
    board = parse_board(board) if isinstance(board, str) else board
    seen: list[ObservedPoses] = []
    for number, stacks in enumerate(cameras, 1):
        seen.append(observe_poses(stacks, board, plan, _prefixed(progress, number), options))
    progress("adjusting …")
    skipped = {
        f"camera {number}, {name}": f"camera {number}, {why}"
        for number, one in enumerate(seen, 1)
        for name, why in one.skipped.items()
    }
    with found_before(numbered("camera", seen)):
        found = calibrate_cameras(
            [one.observations for one in seen], board, skipped=skipped, distortion=distortion
        )
    plans = list(dict.fromkeys(p for one in seen for p in one.plans))
    origin = made_by(
        "calibrate",
        options={"board": board, "distortion": distortion, **options},
        inputs=tuple(
            replace(source, name=f"camera {number}: {source.name}")
            for number, one in enumerate(seen, 1)
            for source in one.inputs
        ),
        plan=plans[0] if len(plans) == 1 else tuple(plans),
    )
    return replace(found, rig=replace(found.rig, provenance=origin))


def _prefixed(progress: Callable[[str], None], number: int) -> Callable[[str], None]:
    """``progress`` with the number of a camera before every text."""
    return lambda text: progress(f"camera {number}: {text}")


def measure_cameras(
    stacks: Sequence[Stack | Sequence[Stack] | StrPath],
    rig: MultiRig | StrPath,
    *,
    axis: Axis | None = None,
    **options: Unpack[DecodeOptions],
) -> MultiMeasurement:
    """Measure the points of a scene that several cameras saw under the same patterns.

    Parameters
    ----------
    stacks : sequence, one entry per camera of the rig
        Each as ``stack`` of ``measure``, of the same plan.
    rig : MultiRig or path
    axis : "x" or "y", optional
        Use this axis of the projector only.
    **options
        Of ``decode``, for all cameras.

    Returns
    -------
    MultiMeasurement

    Raises
    ------
    InputError for another number of stacks than cameras and for different plans; RigMismatch where
    rig and stacks do not belong together; and as ``decode``.

    Notes
    -----
    Every camera gives points with the projector, and with every other camera by equal projector
    coordinates. ``camera_points`` merges them. Pixels that fit no surface through their neighbours
    are kept where another camera confirms them. A projector that is not calibrated only codes: the
    points are then those of the pairs of cameras (``coded_points``).
    """
    if not isinstance(rig, MultiRig):
        rig = read_multi_rig(rig)
    if isinstance(stacks, Stack):
        raise InputError(
            f"stacks: expected one for each of the rig's {len(rig.cameras)} cameras, got one Stack"
        )
    shots = [stacks_of(one) for one in stacks]
    _check_shots(shots, rig)
    started = time.perf_counter()
    if rig.projector is None:
        # No point with the projector can be confirmed: isolated pixels stay left out.
        decoded = _strict(shots, options)
        doubtful: list[BoolMap | None] = []
    else:
        decoded, doubtful = _decoded(shots, options)
    told = numbered("camera", decoded)
    with found_before(told):
        seen = _merged(decoded, doubtful, shots, rig, axis)
    seconds = time.perf_counter() - started
    origin = made_by(
        "measure",
        options={"axis": axis, **given_options(shots[0][0], options)},
        inputs=tuple(
            replace(source, name=f"camera {number}: {source.name}")
            for number, one in enumerate(shots, 1)
            for source in inputs_of(*one)
        ),
        plan=shots[0][0].plan,
        rig=rig,
    )
    seen = [replace(c, points=replace(c.points, provenance=origin)) for c in seen]
    findings = (*told, *camera_findings(seen), *uncertainty_findings(rig))
    points = replace(joined_points(rig, seen), provenance=origin, findings=findings)
    return MultiMeasurement(points, tuple(seen), tuple(decoded), findings, seconds)


def _merged(
    decoded: Sequence[Decoded],
    doubtful: Sequence[BoolMap | None],
    shots: Sequence[Sequence[Stack]],
    rig: MultiRig,
    axis: Axis | None,
) -> list[CameraPoints]:
    """The points of every camera, by all pairs of devices."""
    axes: tuple[Axis, ...] = tuple(decoded[0].maps) if axis is None else (axis,)
    if rig.projector is None:
        return _by_code(decoded, shots, rig, axes)
    alone = [
        triangulate(d, camera_pair(rig, k), axis=axis, colour=scene_brightness(shots[k], d))
        for k, d in enumerate(decoded)
    ]
    fields = {k: CoordinateField.of(d, axes) for k, d in enumerate(decoded)}
    seen: list[CameraPoints] = []
    for k, (found, cloud) in enumerate(zip(decoded, alone, strict=True)):
        others = {other: field for other, field in fields.items() if other != k}
        seen.append(camera_points(rig, k, found, cloud, others, axes, doubtful=doubtful[k]))
    return seen


def _by_code(
    decoded: Sequence[Decoded],
    shots: Sequence[Sequence[Stack]],
    rig: MultiRig,
    axes: tuple[Axis, ...],
) -> list[CameraPoints]:
    """The points of every camera, by the codes that it shares with the others."""
    fields = [CoordinateField.of(d, axes) for d in decoded]
    seen: list[CameraPoints] = []
    for k, found in enumerate(decoded):
        others = {other: field for other, field in enumerate(fields) if other != k}
        colour = scene_brightness(shots[k], found)
        seen.append(coded_points(rig, k, decoded, others, axes, colour=colour))
    return seen


def _check_shots(shots: Sequence[Sequence[Stack]], rig: MultiRig) -> None:
    """Refuse stacks that do not belong to the rig or to each other."""
    if len(shots) != len(rig.cameras):
        raise InputError(
            f"stacks: expected one for each of the rig's {len(rig.cameras)} cameras, "
            f"got {len(shots)}"
        )
    for number, one in enumerate(shots, 1):
        if rig.projector is None:
            _check_frames(rig, number, one[0])
        else:
            check_projector(camera_pair(rig, number - 1), one[0])
        if one[0].plan != shots[0][0].plan:
            raise InputError(f"camera {number}: expected the plan of camera 1, got another")


def _check_frames(rig: MultiRig, number: int, stack: Stack) -> None:
    """Refuse frames of another size than the camera's."""
    h, w = rig.cameras[number - 1].shape
    rows, columns = stack.frames[0].shape[:2]
    if (rows, columns) != (h, w):
        raise RigMismatch(
            f"camera {number}: the rig is for frames of {w} × {h} px, got {columns} × {rows} px"
        )


def _strict(shots: Sequence[Sequence[Stack]], options: DecodeOptions) -> list[Decoded]:
    """Coordinates of every camera."""
    decoded = []
    for number, one in enumerate(shots, 1):
        try:
            decoded.append(decoded_exposures(one, options))
        except InputError as error:
            raise error.at(f"camera {number}") from error
    return decoded


def _decoded(
    shots: Sequence[Sequence[Stack]], options: DecodeOptions
) -> tuple[list[Decoded], list[BoolMap | None]]:
    """Coordinates of every camera with isolated pixels, and where these are."""
    decoded: list[Decoded] = []
    doubtful: list[BoolMap | None] = []
    for number, one in enumerate(shots, 1):
        try:
            if not options.get("remove_isolated", True):
                decoded.append(decoded_exposures(one, options))
                doubtful.append(None)
                continue
            strict = decoded_exposures(one, options)
            every: Any = options | {"remove_isolated": False}
            loose = decoded_exposures(one, every)
        except InputError as error:
            raise error.at(f"camera {number}") from error
        removed = [m.reason == Reason.ISOLATED for m in strict.maps.values()]
        decoded.append(replace(loose, findings=strict.findings))
        doubtful.append(np.logical_or.reduce(removed))
    return decoded, doubtful
