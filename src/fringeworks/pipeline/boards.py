"""Boards in several poses → rig."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, Unpack

from fringeworks.files.atomic import StrPath
from fringeworks.files.stack import read_poses
from fringeworks.patterns.plan import PatternPlan
from fringeworks.pipeline.decoding import decoded
from fringeworks.pipeline.inputs import inputs_of
from fringeworks.pipeline.side_by_side import side_by_side
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.rig.calibration.calibrate import Calibration, Observation, calibrate, observe
from fringeworks.stack.even_light import texture
from fringeworks.stack.frames import Stack
from fringeworks.stack.options import DecodeOptions
from fringeworks.types import (
    FileProblem,
    Finding,
    InputError,
    Region,
    Source,
    fingerprint,
    found_before,
    made_by,
)
from fringeworks.types.packages import need_opencv


def calibrate_stacks(
    stacks: Iterable[tuple[str, Stack]] | StrPath,
    board: Board | str,
    *,
    plan: PatternPlan | StrPath | None = None,
    distortion: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
    **options: Unpack[DecodeOptions],
) -> Calibration:
    """Calibrate a rig from stacks of a board in several poses.

    Parameters
    ----------
    stacks : iterable of (name, Stack), or path
        Each with both axes of the projector; or a folder with a stack per pose. A pose in which
        the board is not found, or that cannot be decoded, is skipped; the result says why.
    board : Board or str
        A board, or its short form, as for ``parse_board``.
    plan : PatternPlan or path, optional
        Plan of a folder's stacks, where none lies there.
    distortion : 0, 2, 4 or 5, optional
        Coefficients of lens distortion for each device; by default those that are useful.
    progress : callable
        Called with the name of each pose.
    **options
        Of ``decode``.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError where too few poses are left, with the reason of every skipped pose; where a stack
    cannot be read; and as ``calibrate``.
    """
    need_opencv("a calibration")
    board = parse_board(board) if isinstance(board, str) else board
    seen = observe_poses(stacks, board, plan, progress, options)
    progress("adjusting …")
    with found_before(seen.findings):
        found = calibrate(seen.observations, board, skipped=seen.skipped, distortion=distortion)
    plans = seen.plans
    origin = made_by(
        "calibrate",
        options={"board": board, "distortion": distortion, **options},
        inputs=seen.inputs,
        plan=plans[0] if len(plans) == 1 else plans,
    )
    return replace(found, rig=replace(found.rig, provenance=origin, region=seen.region))


@dataclass(frozen=True, eq=False)
class ObservedPoses:
    """The poses of a board that one camera saw."""

    observations: list[Observation]
    skipped: dict[str, str]
    """Names of the poses that could not be observed, with the reason."""
    inputs: tuple[Source, ...]
    """Every pose, by the hashes of its files."""
    plans: tuple[PatternPlan, ...]
    """The plans of the stacks, each once."""
    region: Region | None
    """The part of the camera's sensor that all stacks show; None where one does not say."""
    findings: tuple[Finding, ...]
    """What was found in the frames of the poses that could not be observed."""


def observe_poses(
    stacks: Iterable[tuple[str, Stack]] | StrPath,
    board: Board,
    plan: PatternPlan | StrPath | None,
    progress: Callable[[str], None],
    options: DecodeOptions,
) -> ObservedPoses:
    """Find a board in all poses of one camera; the options are those of ``calibrate_stacks``."""
    need_opencv("a calibration")
    poses = read_poses(stacks, plan) if isinstance(stacks, (str, os.PathLike)) else stacks
    observations: list[Observation] = []
    skipped: dict[str, str] = {}
    findings: list[Finding] = []
    inputs: list[Source] = []
    plans: dict[PatternPlan, None] = {}
    regions: set[Region | None] = set()
    taken = _announced(poses, progress)
    for name, seen in side_by_side(taken, lambda pose: (pose[0], _seen(*pose, board, options))):
        regions.add(seen.region)
        inputs.append(Source(name, seen.digest))
        plans[seen.plan] = None
        if isinstance(seen.found, InputError):
            skipped[name] = why_unused(seen.found)
            findings += seen.found.findings
        else:
            observations.append(seen.found)
    return ObservedPoses(
        observations, skipped, tuple(inputs), tuple(plans), _one_region(regions), tuple(findings)
    )


class _Seen(NamedTuple):
    """What a pose showed, without its frames."""

    found: Observation | InputError
    digest: str
    """Of the hashes of its files, so that it is one line of a rig file, which people read."""
    plan: PatternPlan
    region: Region | None


def _seen(name: str, stack: Stack, board: Board, options: DecodeOptions) -> _Seen:
    """Observe one pose; problems of the capture itself are raised."""
    digest = fingerprint(tuple(source.sha256 for source in inputs_of(stack)))
    found: Observation | InputError
    try:
        found = observe_stack(stack, board, name=name, **options)
    except FileProblem:
        raise  # it concerns the capture, not the pose
    except InputError as error:
        found = error
    return _Seen(found, digest, stack.plan, stack.region)


def _announced(
    poses: Iterable[tuple[str, Stack]], progress: Callable[[str], None]
) -> Iterator[tuple[str, Stack]]:
    for name, stack in poses:
        progress(f"{name} …")
        yield name, stack


def _one_region(regions: set[Region | None]) -> Region | None:
    """The part of the sensor that all poses show; they cannot show several of one size."""
    told = [r for r in regions if r is not None]
    if len(told) > 1:
        places = sorted(f"column {r.x_px}, row {r.y_px}" for r in told)
        raise InputError(
            "poses: expected one part of the camera's sensor in all, got several, from "
            f"{' and '.join(places)} on"
        )
    return told[0] if regions == set(told) and told else None


def why_unused(error: InputError) -> str:
    """Why a pose cannot be used, with the likeliest cause that the worst finding names."""
    worst = max((f.rank for f in error.findings if f.causes), default=0)
    causes = [f.causes[0] for f in error.findings if f.causes and f.rank == worst > 0]
    return str(error) if not causes else f"{error}; likely {causes[0]}"


def observe_stack(
    stack: Stack, board: Board, *, name: str = "pose", **options: Unpack[DecodeOptions]
) -> Observation:
    """Find a board in the frames of one pose, and read the projector coordinates of its corners.

    Parameters
    ----------
    stack : Stack
        Both axes of the projector.
    board : Board
    name : str
        Name of the pose in errors and reports.
    **options
        Of ``decode``.

    Raises
    ------
    BoardNotFound where the board is not found; InputError as ``decode``, with the name.
    """
    need_opencv("a calibration")
    size = (stack.plan.width_px, stack.plan.height_px)
    try:
        image = texture(stack.frames, stack.plan)
        coordinates = decoded(stack, options)
    except InputError as error:
        raise error.at(name) from error
    return observe(image, coordinates, board, projector_size=size, name=name)
