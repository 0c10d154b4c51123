"""Captures on disk, a pair or a stack: whichever lies there is read."""

from __future__ import annotations

from pathlib import Path

from fringeworks.files.atomic import StrPath
from fringeworks.files.limits import is_file, is_folder, parsing, told
from fringeworks.files.pair import (
    CAPTURE_FILE,
    CaptureFile,
    missing_description,
    read_pair_file,
    read_pair_folder,
)
from fringeworks.files.plan import PLAN_FILE
from fringeworks.files.stack import STACK_SUFFIXES, captures_in, read_stack
from fringeworks.files.toml import kind_of, read_toml
from fringeworks.stack.frames import Stack
from fringeworks.types import FileProblem, Pair

PAIR_SUFFIXES = (".npz", ".mat")
"""Single files that hold a pair."""


def read_capture(path: StrPath) -> Pair | Stack:
    """Read a capture: a pair of frames, or a stack with its plan.

    Parameters
    ----------
    path : path
        A folder with ``capture.toml`` (of the kind "pair" or "stack") or with ``plan.toml`` (a
        stack); a ``.npz`` or ``.mat`` file with two frames; a TIFF, ``.npy`` or ``.npz`` stack with
        a plan beside it.

    Returns
    -------
    Pair or Stack, with frames as stored.

    Raises
    ------
    FileProblem for anything missing, unreadable or unknown, naming the file and the field.
    """
    path = Path(path)
    if is_folder(path):
        description = path / CAPTURE_FILE
        if not is_file(description):
            if is_file(path / PLAN_FILE):
                return read_stack(path)
            raise missing_description(path, f"{CAPTURE_FILE} or {PLAN_FILE}", captures_in(path))
        if kind_of(description) in ("stack", "exposures"):
            return read_stack(path)  # which says how several exposures are read
        content = read_toml(description, CaptureFile)
        with parsing(path, "a pair of frames"):
            return read_pair_folder(path, content)
    if not is_file(path):
        raise FileProblem(
            f"{told(path)}: expected a capture folder or one of {_suffixes()}, got nothing there"
        )
    suffix = path.suffix.lower()
    if suffix in STACK_SUFFIXES and (
        suffix not in PAIR_SUFFIXES or is_file(path.parent / PLAN_FILE)
    ):
        return read_stack(path)
    if suffix in PAIR_SUFFIXES:
        return read_pair_file(path)
    raise FileProblem(
        f"{path}: expected a capture folder or one of {_suffixes()}, got {suffix or path.name}"
    )


def _suffixes() -> str:
    return ", ".join(dict.fromkeys((*PAIR_SUFFIXES, *STACK_SUFFIXES)))
