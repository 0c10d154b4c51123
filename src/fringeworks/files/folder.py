"""Folders that are written as a whole: captures, patterns, reports."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from fringeworks.files.atomic import TEMPORARY, StrPath, write_text
from fringeworks.types import FileProblem

MANIFEST = ".fringeworks"
"""File in a folder that lists, a line each, the names that fringeworks has written there."""
NAMED = 3
"""Foreign names that a message lists; enough to recognise the folder."""


class FolderInUse(FileProblem):
    """An output folder holds things that fringeworks did not write."""


class FolderWriter:
    """Hands out the names of a folder's files; see ``replacing_folder``."""

    def __init__(self, folder: Path, index: Sequence[str], before: list[str]) -> None:
        self.folder = folder
        self._index = index
        self._before = before
        self._written: list[str] = []
        self._started = False

    def file(self, name: str) -> Path:
        """The path of a file, or of a folder inside, that is about to be written."""
        if not self._started:
            self._start()
        self._written.append(name)
        # The name is listed before the file is there: after a kill, everything is still known.
        with (self.folder / MANIFEST).open("a", encoding="utf-8") as manifest:
            manifest.write(f"{name}\n")
        return self.folder / name

    def _start(self) -> None:
        """Take the earlier result away: its index first, so that nothing reads half of it."""
        self._started = True
        _write_manifest(self.folder, self._before)
        for name in [*(n for n in self._index if n in self._before), *self._before]:
            if (self.folder / name).is_file():
                (self.folder / name).unlink(missing_ok=True)
        for left in self.folder.glob(f"{TEMPORARY}*"):
            left.unlink(missing_ok=True)

    def finish(self) -> None:
        """List what the folder holds now; folders of an earlier result go."""
        for name in set(self._before) - set(self._written):
            inside = self.folder / name
            if inside.is_dir() and not foreign_names(inside):
                shutil.rmtree(inside, ignore_errors=True)
        _write_manifest(self.folder, self._written)


@contextmanager
def replacing_folder(
    path: StrPath, *, index: Sequence[str] = (), force: bool = False
) -> Iterator[FolderWriter]:
    """Write a folder as a whole.

    The folder is made, or an earlier result in it is replaced: its index is deleted first, then
    its other files, and the caller writes the new index last. Whoever reads the folder in between,
    or after the program was killed, finds no index and thus no result, never a mixture.

    Parameters
    ----------
    path : path
    index : names
        Files that make the folder a result, such as ``capture.toml``.
    force : bool
        Write into a folder with other things in it, too. Files of the same names are replaced, all
        others stay.

    Raises
    ------
    FolderInUse where the folder holds things that fringeworks did not write, unless forced.
    FileProblem where it cannot be made or written to.
    """
    folder = make_folder(path)
    foreign = foreign_names(folder)
    if foreign and not force:
        more = f" and {len(foreign) - NAMED} more" if len(foreign) > NAMED else ""
        raise FolderInUse(
            f"{folder}: expected a new or empty folder, or one that fringeworks wrote; it holds "
            f"{', '.join(foreign[:NAMED])}{more}"
        )
    writer = FolderWriter(folder, index, _read_manifest(folder) + _foreign_index(folder, index))
    try:
        yield writer
        writer.finish()
    except OSError as error:
        raise FileProblem(f"{folder}: could not be written: {error.strerror or error}") from error


def make_folder(path: StrPath) -> Path:
    """Make an output folder where there is none.

    Raises
    ------
    FileProblem where that is not possible.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileProblem(
            f"{folder}: expected a folder that can be written to, got: {error.strerror}"
        ) from error
    if not os.access(folder, os.W_OK):
        raise FileProblem(
            f"{folder}: expected a folder that can be written to, got a read-only one"
        )
    return folder


def foreign_names(folder: Path) -> list[str]:
    """Names in a folder that fringeworks did not write, but for those that begin with a dot."""
    own = set(_read_manifest(folder))
    try:
        names = [entry.name for entry in folder.iterdir()]
    except OSError as error:
        raise FileProblem(f"{folder}: could not be read: {error.strerror}") from error
    return sorted(n for n in names if n not in own and not n.startswith("."))


def _foreign_index(folder: Path, index: Sequence[str]) -> list[str]:
    """Index files of others, which a forced write has to take away first as well."""
    own = _read_manifest(folder)
    return [name for name in index if (folder / name).is_file() and name not in own]


def incomplete(folder: Path) -> bool:
    """Whether fringeworks has begun to write a folder."""
    return (folder / MANIFEST).is_file()


def _read_manifest(folder: Path) -> list[str]:
    try:
        lines = (folder / MANIFEST).read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return []
    # Plain names only: a forged list must not lead out of the folder.
    return [n for n in lines if n and n not in (".", "..") and "/" not in n and "\\" not in n]


def _write_manifest(folder: Path, names: Sequence[str]) -> None:
    write_text(folder / MANIFEST, "".join(f"{name}\n" for name in dict.fromkeys(names)))
