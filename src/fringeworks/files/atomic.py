"""Files appear whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fringeworks.types import FileProblem

StrPath = str | os.PathLike[str]
TEMPORARY = ".fringeworks-"
"""Beginning of the names of unfinished files. Readers pass over names that begin with a dot."""


@contextmanager
def replacing(path: StrPath) -> Iterator[Path]:
    """A temporary path beside ``path`` that takes its name when the block ends without error.

    Raises
    ------
    FileProblem where the folder does not exist, cannot be written to, or the disk is full.
    """
    target = Path(path)
    temporary = target.with_name(f"{TEMPORARY}{secrets.token_hex(6)}{target.suffix}")
    if os.path.isdir(target):
        raise FileProblem(f"{target}: expected the name of a file, got a folder")
    try:
        _create(temporary, target)
        yield temporary
        # On the disk before the name is: a power cut leaves the old file or the new one.
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(target)
        _keep(target.parent)
    except OSError as error:
        raise FileProblem(f"{target}: could not be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):  # a read-only disk has none, and refuses to look
            temporary.unlink(missing_ok=True)


def _create(temporary: Path, target: Path) -> None:
    """Create an empty file, so that it has the permissions that the user's umask gives."""
    try:
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        raise FileProblem(f"{target}: expected a writable folder, got: {error.strerror}") from error


def _keep(folder: Path) -> None:
    """Write a folder's list of names to the disk, where the system can do that."""
    try:
        place = os.open(folder, os.O_RDONLY)
    except OSError:  # Windows opens no folders
        return
    try:
        os.fsync(place)
    except OSError:  # some network file systems refuse; the file itself is on the disk
        pass
    finally:
        os.close(place)


def write_text(path: StrPath, text: str) -> Path:
    """Write a text file, whole or not at all; return its path."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


def check_target(path: StrPath, suffixes: Iterable[str], advice: str = "") -> None:
    """Refuse a result file of unknown kind or in no folder, before anything is computed for it.

    Raises
    ------
    FileProblem that says which kinds there are, or that the folder is missing.
    """
    path = Path(path)
    known = tuple(suffixes)
    if path.suffix.lower() not in known:
        raise FileProblem(
            f"{path}: expected {'one of ' if len(known) > 1 else ''}{', '.join(known)}, "
            f"got {path.suffix or 'no suffix'}" + (f"; {advice}" if advice else "")
        )
    if not os.path.isdir(path.parent):
        raise FileProblem(f"{path}: expected a writable folder, got none at {path.parent}")


def refuse_overwrite(target: StrPath, *sources: object) -> None:
    """Refuse, before anything is computed, to write to what the same call reads.

    Parameters
    ----------
    target : path
    *sources : object
        Inputs of the call; those that are no path do not count.

    Raises
    ------
    FileProblem where a source is the target.
    """
    there = os.path.realpath(target)
    for source in sources:
        if isinstance(source, str | os.PathLike) and os.path.realpath(source) == there:
            raise FileProblem(f"{target}: it would replace what the same call reads")
