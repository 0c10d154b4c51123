"""Boards before a calibrated rig → whether it still holds, and a corrected rig."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Unpack

from fringeworks.files.atomic import StrPath
from fringeworks.files.rig import read_rig
from fringeworks.pipeline.boards import observe_stack
from fringeworks.pipeline.inputs import inputs_of, stack_of
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.rig.calibration.calibrate import Observation
from fringeworks.rig.calibration.drift import RigCheck, adjust_to, check_observations
from fringeworks.stack.frames import Stack
from fringeworks.stack.options import DecodeOptions
from fringeworks.types import Provenance, Rig, Source, fingerprint, made_by
from fringeworks.types.packages import need_opencv


def check_rig(
    rig: Rig | StrPath,
    stack: Stack | StrPath | Sequence[Stack | StrPath],
    board: Board | str,
    **options: Unpack[DecodeOptions],
) -> RigCheck:
    """Check whether a calibrated rig still holds, by one pose of a board or several.

    Parameters
    ----------
    rig : Rig or path
    stack : Stack, path, or a sequence of them
        The board in one pose, with both axes of the projector; each further pose makes the check
        sharper.
    board : Board or str
        A board, or its short form, as for ``parse_board``. It need not be that of the calibration.
    **options
        Of ``decode``.

    Returns
    -------
    RigCheck: the verdict, the drift in mm and px with σ, its likely causes, flatness and scale of
    the measured board. ``print(check)`` shows it in words.

    Raises
    ------
    BoardNotFound where the board is not found; RigMismatch for frames of other sizes; InputError
    as ``decode``.
    """
    need_opencv("the check of a rig")
    rig = rig if isinstance(rig, Rig) else read_rig(rig)
    seen, known, origin = _observed("check_rig", rig, stack, board, options)
    return replace(check_observations(rig, seen, known), provenance=origin)


def adjust_rig(
    rig: Rig | StrPath,
    stack: Stack | StrPath | Sequence[Stack | StrPath],
    board: Board | str,
    **options: Unpack[DecodeOptions],
) -> Rig:
    """Correct a rig that has changed, by a board in one pose or more.

    Parameters
    ----------
    rig, stack, board, **options
        As for ``check_rig``.

    Returns
    -------
    Rig with the covariance of all parameters. Rotation, translation and focal lengths are corrected
    as far as the evidence supports it, and the covariance holds the differences of causes that the
    poses cannot tell apart. The calibration is the prior of all parameters.

    Raises
    ------
    As ``check_rig``.
    """
    need_opencv("the check of a rig")
    rig = rig if isinstance(rig, Rig) else read_rig(rig)
    seen, known, origin = _observed("adjust_rig", rig, stack, board, options)
    return replace(adjust_to(rig, seen, known), provenance=origin)


def _observed(
    name: str,
    rig: Rig,
    stack: Stack | StrPath | Sequence[Stack | StrPath],
    board: Board | str,
    options: DecodeOptions,
) -> tuple[list[Observation], Board, Provenance]:
    """The board in every pose, and how the result is made."""
    board = parse_board(board) if isinstance(board, str) else board
    one = isinstance(stack, (str, os.PathLike, Stack))
    given: Sequence[Stack | StrPath] = [stack] if one else stack  # type: ignore[assignment, list-item]
    stacks = [stack_of(each) for each in given]
    seen = [
        observe_stack(one, board, name=f"pose {number}", **options)
        for number, one in enumerate(stacks, 1)
    ]
    inputs = tuple(
        Source(o.name, fingerprint(tuple(s.sha256 for s in inputs_of(one))))
        for o, one in zip(seen, stacks, strict=True)
    )
    plans = tuple(dict.fromkeys(one.plan for one in stacks))
    origin = made_by(
        name,
        options={"board": board, **options},
        inputs=inputs,
        plan=plans[0] if len(plans) == 1 else plans,
        rig=rig,
    )
    return seen, board, origin
