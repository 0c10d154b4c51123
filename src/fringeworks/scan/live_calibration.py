"""Calibration while the board is moved: every pose is judged as soon as it is taken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

from fringeworks.files.atomic import StrPath
from fringeworks.files.stack import pose_paths, read_stack
from fringeworks.pipeline.boards import calibrate_stacks, observe_stack, why_unused
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.rig.calibration.calibrate import Calibration, Observation
from fringeworks.rig.calibration.diagnosis import few_corners
from fringeworks.scan.bench import Bench, Take, take
from fringeworks.scan.frames import Progress
from fringeworks.scan.poses import PoseJudgement, judge_poses
from fringeworks.stack.options import DecodeOptions
from fringeworks.types import FileProblem, Frozen, InputError
from fringeworks.types.packages import need_opencv

MOST_POSES = 40
"""Largest number of poses that are taken. Twelve to twenty are enough for someone who follows the
words."""


@dataclass(frozen=True, eq=False, repr=False)
class TakenPose(Frozen):
    """A pose of the board that was taken, and what it is good for."""

    name: str
    """Name of the pose, and of its folder."""
    corners: int
    """Number of corners that both devices see; 0 where the board was not found."""
    problem: str
    """Why the pose cannot be used; empty where it can."""
    judgement: PoseJudgement
    """Of all poses so far, with what is still missing."""
    few: tuple[str, ...] = ()
    """How many corners lack projector coordinates, and why; empty where most have them."""

    def __str__(self) -> str:
        seen = self.problem or "; ".join(self.few) or f"{self.name}: {self.corners} corners"
        return f"{seen}; {self.judgement}"


def calibrate_live(
    bench: Bench,
    board: Board | str,
    folder: StrPath,
    *,
    ready: Callable[[PoseJudgement], bool],
    taken: Callable[[TakenPose], None] = lambda _: None,
    how: Take | None = None,
    distortion: int | None = None,
    **options: Unpack[DecodeOptions],
) -> Calibration:
    """Take poses of a board one after another until they are enough, and calibrate.

    Parameters and errors as ``take_poses``; ``distortion`` as for ``calibrate``.

    Returns
    -------
    Calibration from all poses in the folder.
    """
    need_opencv("a calibration")
    board = parse_board(board) if isinstance(board, str) else board
    take_poses(bench, board, folder, ready=ready, taken=taken, how=how, **options)
    return calibrate_stacks(folder, board, distortion=distortion, **options)


def take_poses(
    bench: Bench,
    board: Board | str,
    folder: StrPath,
    *,
    ready: Callable[[PoseJudgement], bool],
    taken: Callable[[TakenPose], None] = lambda _: None,
    how: Take | None = None,
    **options: Unpack[DecodeOptions],
) -> PoseJudgement:
    """Take poses of a board one after another until they are enough.

    Parameters
    ----------
    bench : Bench
        Its plan has both axes.
    board : Board or str
    folder : path
        A folder with a capture for each pose. Poses that lie there already count: an interrupted
        calibration goes on.
    ready : callable
        Called with the judgement so far before each pose; returns when the board rests in its next
        place. False ends the taking of poses.
    taken : callable
        Called after each pose.
    how : Take, optional
        As for ``take``, with a single exposure.
    **options
        Of ``decode``.

    Returns
    -------
    PoseJudgement of all poses in the folder.

    Raises
    ------
    InputError for a plan with one axis; DeviceProblem where frames do not come.
    """
    need_opencv("a calibration")
    poses = PoseTaker(folder, board, **options)
    while not poses.enough and ready(poses.judgement):
        taken(poses.take(bench, how))
    return poses.judgement


class PoseTaker:
    """The poses of a board in a folder: takes further ones, and judges them all.

    Parameters
    ----------
    folder : path
        A folder with a capture for each pose. Poses that lie there already count.
    board : Board or str
    **options
        Of ``decode``.
    """

    def __init__(
        self, folder: StrPath, board: Board | str, **options: Unpack[DecodeOptions]
    ) -> None:
        self._folder = Path(folder)
        self._board = parse_board(board) if isinstance(board, str) else board
        self._options = options
        self._found = _before(self._folder, self._board, options)
        self.judgement = judge_poses(list(self._found.values()), self._board)
        """Of all poses so far."""

    @property
    def enough(self) -> bool:
        """Whether no further pose is needed, or no more may be taken."""
        return self.judgement.enough or len(self._found) >= MOST_POSES

    def take(
        self, bench: Bench, how: Take | None = None, *, progress: Progress = lambda _: None
    ) -> TakenPose:
        """Take a pose; parameters and errors as for ``take_poses``."""
        if bench.plan.axes != ("x", "y"):
            raise InputError(
                "plan: expected fringes or Gray code along x and y, got "
                f"{', '.join(bench.plan.axes)} only"
            )
        name = _next_name(self._folder, self._found)
        # A pose that could not be used is taken again: its folder is replaced.
        folder = take(
            bench, self._folder / name, replace(how or Take(), force=True), progress=progress
        )
        problem = ""
        try:
            self._found[name] = observe_stack(
                read_stack(folder), self._board, name=name, **self._options
            )
        except FileProblem:
            raise
        except InputError as error:
            problem = why_unused(error)
        self.judgement = judge_poses(list(self._found.values()), self._board)
        if problem:
            return TakenPose(name, 0, problem, self.judgement)
        seen = self._found[name]
        few = tuple(found.text for found in few_corners([seen]))
        return TakenPose(name, int(seen.found.read.sum()), "", self.judgement, few)


def _before(folder: Path, board: Board, options: DecodeOptions) -> dict[str, Observation]:
    """The poses that lie in the folder already and can be used."""
    found: dict[str, Observation] = {}
    if not folder.is_dir() or not any(path.is_dir() for path in folder.iterdir()):
        return found
    for path in pose_paths(folder):
        try:
            found[path.name] = observe_stack(read_stack(path), board, name=path.name, **options)
        except InputError:
            # It is taken again under its name.
            continue
    return found


def _next_name(folder: Path, found: dict[str, Observation]) -> str:
    """The first name that no usable pose has."""
    names = (f"pose-{n:02d}" for n in range(1, 2 * MOST_POSES))
    return next(name for name in names if name not in found and not (folder / name).is_file())
