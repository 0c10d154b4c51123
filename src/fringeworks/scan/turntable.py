"""A part from all sides: the table turns, every side is captured, the views are merged."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from fringeworks.files.atomic import StrPath
from fringeworks.files.rig import read_rig
from fringeworks.pipeline.merging import MergedPart, merge
from fringeworks.pipeline.stacks import measure
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.types import BoardNotFound, InputError, PointCloud, Rig
from fringeworks.views.board_views import board_pose
from fringeworks.views.poses import ViewPose
from fringeworks.views.table_turns import refuse_other_turn

ANGLE_TOLERANCE = 1e-6
"""Largest difference of a turn from a whole number of steps, steps: rounding of 360/7."""
MIN_VIEWS = 3
"""Smallest number of views that close a loop."""


def scan_turntable(
    take: Callable[[Path], object],
    turn: Callable[[float], object],
    folder: StrPath,
    rig: Rig | StrPath,
    *,
    step_deg: float,
    board: Board | str | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> MergedPart:
    """Capture a part at every step of a turntable, measure the views and merge them.

    Parameters
    ----------
    take : callable
        Called with a folder; captures the part into it, as ``take`` does.
    turn : callable
        Called with an angle in degrees before each view but the first; returns when the table
        stands there. It may ask somebody to turn the table by hand.
    folder : path
        Gets a folder for each view: ``view_00``, ``view_01`` …
    rig : Rig or path
    step_deg : float
        Angle between two views, degrees; a turn has a whole number of steps, three or more.
    board : Board or str, optional
        Board that turns with the part. Poses then come from the table's angle and the axis that the
        board shows, and the error of blur is removed. Without a board they come from the shape.
    progress : callable
        Called with what is done next.

    Returns
    -------
    MergedPart

    Raises
    ------
    InputError for steps that do not divide a turn; after two views, for a board that neither shows
    and a table that turns by another angle; and as ``measure`` and ``merge``.
    """
    count = round(360.0 / abs(step_deg)) if step_deg else 0
    if count < MIN_VIEWS or abs(360.0 / abs(step_deg) - count) > ANGLE_TOLERANCE:
        raise InputError(
            f"step_deg: expected a whole number of steps in 360°, {MIN_VIEWS} or more, got "
            f"{step_deg:g}°"
        )
    board = parse_board(board) if isinstance(board, str) else board
    rig = rig if isinstance(rig, Rig) else read_rig(rig)
    views: list[PointCloud] = []
    shown: dict[int, ViewPose] = {}
    for k in range(count):
        if k:
            turn(k * step_deg)
        place = Path(folder) / f"view_{k:02d}"
        progress(f"view {k + 1} of {count} …")
        take(place)
        views.append(measure(place, rig).points)
        if board is not None and k < 2:
            shown = _shown(views, board, shown, step_deg)
    if board is None:
        return merge(views, poses="shape", step_deg=step_deg, progress=progress)
    return merge(
        views, poses="turntable", board=board, step_deg=step_deg, rig=rig, progress=progress
    )


def _shown(
    views: list[PointCloud], board: Board, shown: dict[int, ViewPose], step_deg: float
) -> dict[int, ViewPose]:
    """The boards that the first views show; refused where there is none, or the table turns by
    another angle: the further views would be in vain."""
    k = len(views) - 1
    try:
        found = {**shown, k: board_pose(views[-1], board).pose}
    except BoardNotFound as error:
        if k and not shown:
            raise error.at("views 1 and 2") from error
        return shown
    refuse_other_turn(found, step_deg)
    return found
