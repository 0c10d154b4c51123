"""Folders that are written as a whole: captures, patterns, reports."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from fringeworks.files.atomic import TEMPORARY, StrPath, write_text
from fringeworks.files.limits import is_file, is_folder
from fringeworks.types import FileProblem

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

MANIFEST = ".fringeworks"
"""File in a folder that lists what fringeworks has written there: a line each, hash and name."""
UNFINISHED = "-"
"""Stands in place of the hash until the folder is complete."""
HASH_DIGITS = 16
"""Hexadecimal digits of a hash in the manifest: 64 bits, enough to notice an edited file."""
NAMED = 3
"""Foreign names that a message lists; enough to recognise the folder."""

Manifest = dict[str, str]
"""Hash or ``UNFINISHED`` by name; the kind of the folder under ``KIND``."""
KIND = "kind"
"""First word of the manifest's line that says what kind of result the folder holds."""


class FolderInUse(FileProblem):
    """An output folder holds things that fringeworks did not write."""


class FolderWriter:
    """Hands out the names of a folder's files; see ``replacing_folder``."""

    def __init__(self, folder: Path, kind: str, before: Sequence[str], kept: Sequence[str]) -> None:
        self.folder = folder
        self._kind = kind
        self._before = [name for name in before if name not in kept]
        self._kept = kept
        self._written: list[str] = list(kept)
        self._started = False

    def file(self, name: str) -> Path:
        """The path of a file, or of a folder inside, that is about to be written."""
        if not self._started:
            self._start()
        self._written.append(name)
        # The name is listed before the file is there: after a kill, everything is still known.
        with (self.folder / MANIFEST).open("a", encoding="utf-8") as manifest:
            manifest.write(f"{UNFINISHED} {name}\n")
        return self.folder / name

    def keeps(self, name: str) -> bool:
        """Whether a file of the earlier result stays as it is."""
        return name in self._kept

    def remove(self, name: str) -> None:
        """Delete a file that was written."""
        self._written.remove(name)
        (self.folder / name).unlink(missing_ok=True)

    def _start(self) -> None:
        """Delete the earlier result."""
        self._started = True
        listed = dict.fromkeys([*self._before, *self._kept], UNFINISHED)
        _write_manifest(self.folder, self._kind, listed)
        # Descriptions go first, so that nothing reads half of the folder.
        for name in sorted(self._before, key=lambda name: not name.endswith(".toml")):
            earlier = self.folder / name
            if is_file(earlier):
                earlier.unlink(missing_ok=True)
            elif is_folder(earlier) and not foreign_names(earlier):
                shutil.rmtree(earlier, ignore_errors=True)
        for unfinished in self.folder.glob(f"{TEMPORARY}*"):
            unfinished.unlink(missing_ok=True)

    def finish(self) -> None:
        """List what the folder holds now."""
        content = {name: _hash(self.folder / name) for name in self._written}
        _write_manifest(self.folder, self._kind, content)


@contextmanager
def replacing_folder(
    path: StrPath,
    kind: str,
    *,
    index: Sequence[str] = (),
    force: bool = False,
    kept: Sequence[str] = (),
) -> Iterator[FolderWriter]:
    """Write a folder as a whole.

    The folder is made, or an earlier result in it is replaced: its descriptions (TOML) are deleted
    first, then its other files, and the caller writes the new description last. Whoever reads the
    folder in between, or after the program was killed, finds no description and thus no result.

    Parameters
    ----------
    path : path
    kind : str
        What the folder holds, one word. A folder of another kind is not replaced unless forced.
    index : names
        Files that make the folder a result, such as ``capture.toml``.
    force : bool
        Write into a folder with other things in it, too. Files of the same names are replaced, all
        others stay.
    kept : names
        Files of the earlier result that stay as they are and belong to the new one.

    Raises
    ------
    FolderInUse where the folder holds things that fringeworks did not write, or that were changed
    since, unless forced. FileProblem where it cannot be made or written to, and where another
    program is writing it.
    """
    folder = make_folder(path)
    with locked(folder):
        yield from _replacing(folder, kind, index, force, kept)


def _replacing(
    folder: Path, kind: str, index: Sequence[str], force: bool, kept: Sequence[str]
) -> Iterator[FolderWriter]:
    own = _read_manifest(folder)
    before = own.pop(KIND, kind)
    foreign = foreign_names(folder)
    if not force:
        _refuse(folder, foreign, own, "" if before == kind else before)
    before_names = [name for name in own if name not in foreign]
    before_names += [name for name in index if name in foreign]
    writer = FolderWriter(folder, kind, before_names, kept)
    try:
        yield writer
        writer.finish()
    except OSError as error:
        raise FileProblem(f"{folder}: could not be written: {error.strerror or error}") from error


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder alone, as long as this program runs; systems without ``flock`` hold nothing.

    Raises
    ------
    FileProblem where another program holds it.
    """
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise FileProblem(
                f"{folder}: expected a folder that nothing else writes, got one that another "
                "capture or command is writing: wait for it, or choose another folder"
            ) from error
        except OSError:
            pass  # file systems of some networks have no locks
        yield
    finally:
        os.close(handle)


def _refuse(folder: Path, foreign: Sequence[str], own: Manifest, kind: str) -> None:
    expected = f"{folder}: expected a new or empty folder, or one that fringeworks wrote"
    if foreign:
        shown = [f"{name} (changed since)" if name in own else name for name in foreign[:NAMED]]
        more = f" and {len(foreign) - NAMED} more" if len(foreign) > NAMED else ""
        raise FolderInUse(f"{expected}; it holds {', '.join(shown)}{more}")
    if kind:
        raise FolderInUse(f"{expected} as a result of the same kind; it holds a result: {kind}")


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
    """Names in a folder that fringeworks did not write, or whose files were changed since.

    Names that begin with a dot do not count.
    """
    own = _read_manifest(folder)
    own.pop(KIND, None)
    try:
        names = [entry.name for entry in folder.iterdir() if not entry.name.startswith(".")]
    except OSError as error:
        raise FileProblem(f"{folder}: could not be read: {error.strerror}") from error
    return sorted(
        name
        for name in names
        if name not in own or own[name] not in (UNFINISHED, _hash(folder / name))
    )


def incomplete(folder: Path) -> bool:
    """Whether fringeworks has begun to write a folder and not finished it."""
    return UNFINISHED in _read_manifest(folder).values()


def _hash(path: Path) -> str:
    """The hash of a file; of a folder its kind, since it has a manifest of its own."""
    if is_folder(path):
        return "folder"
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:HASH_DIGITS]
    except OSError:
        return UNFINISHED


def _read_manifest(folder: Path) -> Manifest:
    try:
        lines = (folder / MANIFEST).read_text("utf-8").splitlines()
    except (OSError, ValueError):
        return {}
    pairs = [line.partition(" ") for line in lines]
    kinds = {state: name for state, _, name in pairs if state == KIND}
    found = {name: state for state, _, name in pairs if state != KIND and name != KIND}
    # Plain names only: a forged list must not lead out of the folder.
    return kinds | {n: s for n, s in found.items() if n and n != ".." and not {"/", "\\"} & set(n)}


def _write_manifest(folder: Path, kind: str, content: Manifest) -> None:
    lines = [f"{KIND} {kind}", *(f"{state} {name}" for name, state in content.items())]
    write_text(folder / MANIFEST, "".join(f"{line}\n" for line in lines))
