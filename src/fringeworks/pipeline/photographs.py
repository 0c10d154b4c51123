"""Photographs of a board by two cameras → a rig whose projector only codes."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from fringeworks.files.atomic import StrPath
from fringeworks.files.images import IMAGE_SUFFIXES, TIFF_SUFFIXES, read_frame
from fringeworks.files.plan import PLAN_FILE
from fringeworks.files.provenance import source_of
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.rig.calibration.board_view import BoardView
from fringeworks.rig.calibration.calibrate import Observation
from fringeworks.rig.calibration.cameras import MultiCalibration
from fringeworks.rig.calibration.cameras_alone import calibrate_cameras_alone, observe_pair
from fringeworks.rig.calibration.corners import find_board
from fringeworks.types import FileProblem, FloatMap, InputError, Source, made_by
from fringeworks.types.packages import need_opencv

CAMERAS = 2
"""Number of cameras that are calibrated without a projector."""


def holds_photographs(folder: StrPath) -> bool:
    """Whether a folder holds single photographs and neither captures nor stacks of frames."""
    folder = Path(folder)
    if not folder.is_dir() or (folder / PLAN_FILE).exists():
        return False
    seen = [path for path in folder.iterdir() if not path.name.startswith(".")]
    files = [path for path in seen if path.suffix.lower() in (*IMAGE_SUFFIXES, *TIFF_SUFFIXES)]
    if not files or any(path.is_dir() for path in seen):
        return False
    pages = [path for path in files if path.suffix.lower() in TIFF_SUFFIXES]
    return not pages or _is_single(pages[0])


def _is_single(path: Path) -> bool:
    """Whether a TIFF has one page."""
    import tifffile  # 15 ms, for those only who bring TIFF

    try:
        with tifffile.TiffFile(path) as file:
            return len(file.pages) == 1
    except (tifffile.TiffFileError, OSError, ValueError):
        return False


def calibrate_photographs(
    folders: Sequence[StrPath],
    board: Board | str,
    *,
    distortion: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> MultiCalibration:
    """Calibrate two cameras from photographs of a board, without a projector.

    Parameters
    ----------
    folders : two paths
        One for each camera, with one photograph for each pose of the board. Photographs of one pose
        have the same name, or names that end in the same number.
    board : Board or str
        A board, or its short form, as for ``parse_board``.
    distortion : 0, 2, 4 or 5, optional
        As for ``calibrate``.
    progress : callable
        Called with the name of each pose.

    Returns
    -------
    MultiCalibration, whose rig has no projector.

    Raises
    ------
    InputError where too few poses are left, with the reason of every skipped pose, for photographs
    whose names tell no pairs, and as ``calibrate``.
    """
    need_opencv("a calibration")
    board = parse_board(board) if isinstance(board, str) else board
    if len(folders) != CAMERAS:
        raise InputError(
            f"photographs: expected folders of {CAMERAS} cameras, got {len(folders)}; more cameras "
            "are calibrated with captures of the projector's frames"
        )
    seen: list[tuple[Observation, Observation]] = []
    skipped: dict[str, str] = {}
    inputs: list[Source] = []
    for name, paths in photograph_pairs(Path(folders[0]), Path(folders[1])).items():
        progress(f"{name} …")
        inputs += [source_of(path) for path in paths]
        try:
            found = [_view(path, board) for path in paths]
        except FileProblem:
            raise
        except InputError as error:
            skipped[name] = f"{name}: {error}"
            continue
        (one, first), (other, second) = found
        seen.append(observe_pair(name, (one, other), (first, second)))
    progress("adjusting …")
    result = calibrate_cameras_alone(seen, board, skipped=skipped, distortion=distortion)
    origin = made_by(
        "calibrate", options={"board": board, "distortion": distortion}, inputs=tuple(inputs)
    )
    return replace(result, rig=replace(result.rig, provenance=origin))


def _view(path: Path, board: Board) -> tuple[FloatMap, BoardView]:
    """A photograph and the corners in it."""
    image, _ = read_frame(path)
    try:
        return image, find_board(image, board)
    except InputError as error:
        raise error.at(f"{path.parent.name}/{path.name}") from error


def photograph_pairs(first: Path, second: Path) -> dict[str, tuple[Path, Path]]:
    """Photographs of two folders by pose: by equal names, or by the number at their end.

    Raises
    ------
    InputError where neither tells pairs.
    """
    own, other = (_photographs(folder) for folder in (first, second))
    both = {name: (own[name], other[name]) for name in own if name in other}
    if both:
        return both
    numbers = [_by_number(files) for files in (own, other)]
    if None not in numbers:
        one, two = (n for n in numbers if n is not None)
        both = {one[n].stem: (one[n], two[n]) for n in sorted(one) if n in two}
    if not both:
        raise InputError(
            f"photographs: expected equal names in {first} and {second}, or names that end in the "
            f"number of the pose, got {', '.join(list(own)[:2])} and {', '.join(list(other)[:2])}"
        )
    return both


def _photographs(folder: Path) -> dict[str, Path]:
    """The photographs of a folder by their names without suffix."""
    known = (*IMAGE_SUFFIXES, *TIFF_SUFFIXES)
    paths = [p for p in sorted(folder.iterdir()) if p.suffix.lower() in known]
    return {path.stem: path for path in paths if not path.name.startswith(".")}


def _by_number(files: dict[str, Path]) -> dict[int, Path] | None:
    """Photographs by the last number in their names; None where it is not unique."""
    found: dict[int, Path] = {}
    for name, path in files.items():
        digits = re.findall(r"\d+", name)
        if not digits or int(digits[-1]) in found:
            return None
        found[int(digits[-1])] = path
    return found
