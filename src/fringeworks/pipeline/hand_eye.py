"""Robot poses and board views → where the camera is on the robot."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath
from fringeworks.files.images import read_frame
from fringeworks.files.limits import is_file, is_folder
from fringeworks.files.plan import PLAN_FILE
from fringeworks.files.robot_poses import read_robot_poses
from fringeworks.files.stack import images_of, read_poses
from fringeworks.patterns.plan import PatternPlan
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.rig.calibration.board_view import BoardView
from fringeworks.rig.calibration.calibrate import Observation
from fringeworks.rig.calibration.corners import find_board
from fringeworks.rig.calibration.refine import refined_view
from fringeworks.rig.robot.board_views import view_pose
from fringeworks.rig.robot.hand_eye import HandEye, hand_eye_of
from fringeworks.rig.robot.readings import RobotPoses
from fringeworks.stack.even_light import texture
from fringeworks.stack.frames import Stack
from fringeworks.types import (
    FileProblem,
    Finding,
    FloatMap,
    InputError,
    Mount,
    Rig,
    RobotNoise,
    made_by,
)
from fringeworks.types.packages import need_opencv

MOST_NAMES = 4
"""Names of views that a message lists."""
Shown = BoardView | Observation | Stack | NDArray[Any]
"""A board as a view: its corners, an observation, frames of a plan, or a grey photograph."""


def hand_eye(
    robot_poses: RobotPoses | FloatMap | StrPath,
    board_views: Sequence[Shown] | StrPath,
    board: Board | str,
    rig: Rig,
    *,
    mount: Mount,
    noise: RobotNoise | tuple[float, float] | None = None,
    names: Sequence[str] = (),
    plan: PatternPlan | StrPath | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> HandEye:
    """Calibrate where the camera is on a robot, from poses in which it sees a board.

    Parameters
    ----------
    robot_poses : RobotPoses, (n, 4, 4) array, or path
        One pose for each view: as they were written (``robot_poses``, ``read_robot_poses``), or
        T_base_flange in mm.
    board_views : sequence of BoardView, Observation, Stack or (h, w) arrays, or path
        The board as the camera sees it in each pose: corners, observations of a calibration, frames
        of a plan, or photographs under even light, counts. A folder holds a capture for each pose,
        or photographs; poses with names are found by those, others by their order. Views of a
        folder in which the board is not found are left out and named.
    board : Board or str
        A board, or its short form, as for ``parse_board``.
    rig : Rig
        The camera, with the covariance of its parameters.
    mount : "hand" or "base"
        "hand": the camera moves with the flange, and the board stands still. "base": the camera
        stands beside the robot, and the board moves with the flange.
    noise : RobotNoise or (mm, degrees), optional
        Standard deviations of the robot's poses: every coordinate, and the rotation about every
        axis. Where left out, it is estimated from the residuals.
    names : sequence of str, optional
        A name for every pose; by default those of the robot poses, or "pose 1" and so on.
    plan : PatternPlan or path, optional
        Of the captures of a folder, where none lies there.
    progress : callable
        Called with the name of each view in which the board is looked for.

    Returns
    -------
    HandEye
        ``T_flange_camera`` or ``T_base_camera`` with its covariance, and poses that stand out.

    Raises
    ------
    BoardNotFound
        Where a view does not show the board.
    InputError
        That names the cause: too few poses, no rotation or rotations about one axis only, poses
        that contradict the views, and readings of the poses that the views cannot tell apart.
    MissingPackage
        Without OpenCV (the extra ``calibration``), for views that are no corners.

    Notes
    -----
    Every pose tells M = X⁻¹ G Y: the board before the camera (M), the robot (G), the camera on its
    side (X) and the board on the other (Y). X and Y, the errors of all robot poses, of the board's
    poses by the scatter of their corners, and of the camera's parameters by the rig's covariance
    are unknowns of one adjustment (maximum likelihood, errors in all variables). It starts from
    closed forms of small sets of poses (Park and Martin, IEEE Transactions on Robotics and
    Automation 10, 1994, doi:10.1109/70.326576), of which the one with the least median of squares
    is taken. A pose that the others contradict is left out and named. Noise that is not stated is
    estimated by restricted maximum likelihood, and σ is widened by Student's distribution.

    Where poses can be read in several ways, all are tried. The views decide, or both readings are
    named.

    Examples
    --------
    >>> import numpy as np
    >>> import fringeworks as fw
    >>> fw.rig.hand_eye(np.eye(4)[None], [], "chessboard:11x8:12", fw.simulate.standard_rig(),
    ...                 mount="hand")
    Traceback (most recent call last):
    ...
    fringeworks.types.errors.InputError: hand-eye: expected a robot pose for each of the 0 ...
    """
    board = parse_board(board) if isinstance(board, str) else board
    poses: Any = robot_poses
    if isinstance(poses, (str, os.PathLike)):
        poses = read_robot_poses(poses)
    left_out: list[Finding] = []
    if isinstance(board_views, (str, os.PathLike)):
        if names or not isinstance(poses, RobotPoses):
            raise InputError(
                "board_views: expected views with transforms or names, got a folder; give the "
                "poses with their names (robot_poses)"
            )
        seen = _of_folder(Path(board_views), plan, board, rig, progress)
        poses, views, names = _paired(poses, seen, left_out)
        board_views = views
    elif plan is not None:
        raise InputError("plan: expected with a folder of captures, got it with views")
    stated = noise if isinstance(noise, RobotNoise) or noise is None else _noise(noise)
    views = [
        _view(shown, board, rig, names[k] if k < len(names) else f"pose {k + 1}", progress)
        for k, shown in enumerate(board_views)
    ]
    found = hand_eye_of(poses, views, board, rig, mount=mount, noise=stated, names=names)
    options = {"board": board, "mount": mount, "noise": noise}
    return replace(
        found,
        findings=(*left_out, *found.findings),
        provenance=made_by("hand_eye", options=options, rig=rig),
    )


def _noise(given: Sequence[float]) -> RobotNoise:
    try:
        translation_mm, rotation_deg = given
    except (TypeError, ValueError) as error:
        raise InputError(
            f"noise: expected standard deviations in mm and degrees, got {given!r}"
        ) from error
    return RobotNoise(translation_mm, rotation_deg)


def _of_folder(
    folder: Path,
    plan: PatternPlan | StrPath | None,
    board: Board,
    rig: Rig,
    progress: Callable[[str], None],
) -> dict[str, BoardView | InputError]:
    """The corners in the captures or photographs of a folder by their names, or why not."""
    found: dict[str, BoardView | InputError] = {}
    for name, shown in _shown(folder, plan):
        try:
            found[name] = _view(shown, board, rig, name, progress)
        except FileProblem:
            raise
        except InputError as error:
            found[name] = error
    return found


def _shown(
    folder: Path, plan: PatternPlan | StrPath | None
) -> Iterator[tuple[str, Stack | NDArray[Any]]]:
    if not is_folder(folder):
        raise FileProblem(f"{folder}: expected a folder with the board views, got none")
    stacks = plan is not None or is_file(folder / PLAN_FILE)
    if stacks or any(is_folder(p) for p in folder.iterdir() if not p.name.startswith(".")):
        yield from read_poses(folder, plan)
        return
    for path in images_of(folder):
        yield path.name, read_frame(path)[0]


def _paired(
    poses: RobotPoses, seen: dict[str, BoardView | InputError], left_out: list[Finding]
) -> tuple[RobotPoses, list[BoardView], tuple[str, ...]]:
    """The poses of the views that show the board, with their names."""
    stems = {name: Path(name).stem for name in seen}
    number = {name: k for k, name in enumerate(poses.names)}
    at = {name: number.get(name, number.get(stem)) for name, stem in stems.items()}
    unknown = [name for name, k in at.items() if k is None]
    if len(unknown) == len(seen):
        # None of the names is that of a view: they are in the order of the views.
        if len(poses) != len(seen):
            raise InputError(
                f"hand-eye: expected a robot pose for each of the {len(seen)} views, or poses with "
                f"the names of the views, got {len(poses)}"
            )
        at = {name: k for k, name in enumerate(seen)}
    elif unknown:
        raise InputError(
            f"hand-eye: expected a robot pose with the name of every view, got none for "
            f"{', '.join(unknown[:MOST_NAMES])}"
        )
    else:
        _check_once(poses.names, [poses.names[k] for k in at.values() if k is not None])
    kept = [name for name, view in seen.items() if isinstance(view, BoardView)]
    for name, view in seen.items():
        if isinstance(view, InputError):
            text = str(view).removeprefix(f"{name}: ")
            left_out.append(Finding("view", f"{name} was left out: {text}", frames=(name,)))
    views = [view for view in seen.values() if isinstance(view, BoardView)]
    return poses.at([at[name] or 0 for name in kept]), views, tuple(kept)


def _check_once(names: Sequence[str], wanted: Sequence[str]) -> None:
    """Refuse names of views that several poses have: nothing tells which one was meant."""
    twice = [name for name in wanted if names.count(name) > 1]
    if twice:
        raise InputError(
            f"hand-eye: expected one robot pose with the name {twice[0]}, got "
            f"{names.count(twice[0])}: delete those that are not of the view"
        )


def _view(
    shown: Shown, board: Board, rig: Rig, name: str, progress: Callable[[str], None]
) -> BoardView:
    """The corners that a view shows, measured with the camera known where it is a picture."""
    if isinstance(shown, BoardView):
        return shown
    if isinstance(shown, Observation):
        return shown.view
    need_opencv("a hand-eye calibration")
    progress(f"{name} …")
    try:
        image = texture(shown.frames, shown.plan) if isinstance(shown, Stack) else np.asarray(shown)
        if image.shape != rig.camera.shape:
            h, w = rig.camera.shape
            raise InputError(f"expected frames of the rig's {w} × {h} px, got shape {image.shape}")
        view = find_board(image, board)
        pose = view_pose(view, board, rig.camera, name)
    except InputError as error:
        raise error.at(name) from error
    return refined_view(image, board, view, rig.camera, pose)
