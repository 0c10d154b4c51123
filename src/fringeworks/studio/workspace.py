"""The folder of a studio: what lies in it, and nothing outside of it; words that open devices."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from fringeworks.files.atomic import StrPath
from fringeworks.files.folder import make_folder
from fringeworks.files.pair import CAPTURE_FILE
from fringeworks.files.toml import kind_of
from fringeworks.types import FileProblem, InputError

NAME = re.compile(r"[\w][\w .-]{0,59}", re.UNICODE)
"""Names that users give; no separators of paths."""
NAME_RULE = "1 to 60 letters, digits, spaces, _ . or -, with a letter, digit or _ first"
"""The same in words."""
RESULTS = (
    *(".ply", ".npz", ".tif", ".tiff", ".x3p", ".gsf", ".xyz"),
    *(".pcd", ".csv", ".e57", ".las", ".laz"),
)
"""Suffixes of results that can be looked at."""
DRAWINGS = (".stl", ".obj", ".off", ".ply")
"""Suffixes of drawings that parts are compared with."""
SUMMARY = "summary.csv"
"""Name of the summary in a folder of a batch's results."""
POSE = re.compile(r"pose-\d+")
"""Names of the board's poses."""
RESERVED = (
    "setup.toml",
    "setup.plan.toml",
    "setup.png",
    "rig.toml",
    "rig.png",
    "cameras.toml",
    "recipe.toml",
    "board",
    "dissertation",
    "trash",
    "history.jsonl",
    "notes.json",
    "phone.json",
    "rig-checks.csv",
    "rig-watch.jsonl",
)
"""Names of the studio's own files and folders."""
CHECKS = "rig-checks.csv"
"""Table of the checks of the rig."""
WATCH_LOG = "rig-watch.jsonl"
"""Log of the scans of parts by which the rig is watched."""
MOST_VISITED = 5000
"""Entries of a folder that are looked at."""
DEEPEST = 2
"""Levels of folders that are searched for captures."""
MOST_LISTED = 500
"""Entries of a list; more would not be read."""
MOST_LETTERS = 200
"""Characters of a field that are kept."""
FOLDERS = ("folder", "memory")
"""Kinds of devices whose words name a folder."""


@dataclass(frozen=True)
class Workspace:
    """A folder that a studio reads and writes."""

    root: Path
    """Its path, resolved."""

    @property
    def setup(self) -> Path:
        """The set-up file."""
        return self.root / "setup.toml"

    @property
    def rig(self) -> Path:
        """The rig file."""
        return self.root / "rig.toml"

    @property
    def cameras(self) -> Path:
        """The rig file of several cameras."""
        return self.root / "cameras.toml"

    @property
    def recipe(self) -> Path:
        """The file of areas and tolerances."""
        return self.root / "recipe.toml"

    @property
    def trash(self) -> Path:
        """The folder of what was deleted or replaced."""
        return self.root / "trash"

    @property
    def history(self) -> Path:
        """The file of what was done."""
        return self.root / "history.jsonl"

    @property
    def notes(self) -> Path:
        """The file of verdicts and findings by capture."""
        return self.root / "notes.json"

    @property
    def figures_folder(self) -> Path:
        """The folder of the dissertation's figures."""
        return self.root / "dissertation"

    def figures(self) -> list[str]:
        """Names of the dissertation's figures that were drawn."""
        folder = self.figures_folder
        return sorted(p.name for p in folder.glob("*.svg")) if folder.is_dir() else []

    @property
    def poses(self) -> Path:
        """The folder of the board's poses."""
        return self.root / "board"

    @property
    def writable(self) -> bool:
        """Whether files can be written into the folder."""
        return os.access(self.root, os.W_OK)

    def inside(self, name: str) -> Path:
        """Return the path of something in the folder.

        Raises
        ------
        FileProblem for a path that leads out of the folder, also by a link.
        """
        if "\0" in name:
            raise FileProblem("name: expected a path in the studio's folder, got a byte of zero")
        path = (self.root / name).resolve()
        if not path.is_relative_to(self.root):
            raise FileProblem(f"{name}: expected a path in the studio's folder, got one outside")
        return path

    def new(self, name: str, suffix: str = "") -> Path:
        """Return the path of something new, by the name that a user gave it.

        Raises
        ------
        FileProblem for a name with characters that names may not have, and as ``inside``.
        """
        if not isinstance(name, str) or not NAME.fullmatch(name) or name.endswith((".", " ")):
            raise FileProblem(f"name: expected {NAME_RULE}, got {name!r}")
        if (name + suffix).lower() in RESERVED:
            raise FileProblem(f"name: expected one that the studio does not use, got {name!r}")
        return self.inside(name + suffix)

    def free(self, name: str, suffix: str) -> str:
        """Return a name, or the same with a number, that no file with this suffix has.

        Raises
        ------
        As ``new``.
        """
        names = (name if k == 1 else f"{name}-{k}" for k in range(1, MOST_VISITED))
        return next(n for n in names if not self.new(n, suffix).exists())

    def check_writable(self) -> None:
        """Refuse to write where that is not possible, before anything is measured.

        Raises
        ------
        FileProblem for a folder that can be looked at only.
        """
        if not self.writable:
            raise FileProblem(
                f"{self.root.name}: expected a folder that can be written to, got a read-only one: "
                "its captures can be looked at"
            )

    def check(self) -> None:
        """Refuse links in place of the studio's own files: they would lead out of the folder.

        Raises
        ------
        FileProblem with the name of such a link.
        """
        for name in RESERVED:
            if (self.root / name).is_symlink():
                raise FileProblem(f"{name}: expected a file or folder of the studio's, got a link")

    def captures(self) -> list[str]:
        """Names of the captures, those of the board's poses left out."""
        return sorted(islice(self._captures(self.root, DEEPEST), MOST_LISTED))

    def has_captures(self) -> bool:
        """Whether there is any."""
        return next(self._captures(self.root, DEEPEST), None) is not None

    def _captures(self, folder: Path, levels: int) -> Iterator[str]:
        for entry in _folders(folder):
            path = Path(entry.path)
            if path in (self.poses, self.figures_folder, self.trash):
                continue
            if _is_file(path / CAPTURE_FILE):
                yield path.relative_to(self.root).as_posix()
            elif levels > 1:
                yield from self._captures(path, levels - 1)

    def results(self) -> list[str]:
        """Names of the files that hold results."""
        return [name for name in self._files(RESULTS) if name != CHECKS]

    def drawings(self) -> list[str]:
        """Names of the files that hold drawings or meshes."""
        return self._files(DRAWINGS)

    def of_kind(self, kind: str) -> list[str]:
        """Names of the descriptions (TOML) of a kind, such as ``recipe``."""
        return [
            name
            for name in self._files((".toml",))
            if kind_of(self.root / name) == kind and name != CAPTURE_FILE
        ]

    def tables(self) -> list[str]:
        """Names of the tables (CSV), the summaries of batches among them."""
        return self._files((".csv",)) + [
            f"{folder.name}/{SUMMARY}"
            for folder in _folders(self.root)
            if _is_file(Path(folder.path) / SUMMARY)
        ]

    def reports(self) -> list[str]:
        """Names of the reports that lie in the folder, those of parts left out."""
        return self._files((".html",))

    def folders_of_captures(self) -> list[str]:
        """The folder itself and those in it that hold captures; ``.`` is the folder itself."""
        found = {name.rpartition("/")[0] or "." for name in self.captures()}
        return sorted(found)

    def _files(self, suffixes: tuple[str, ...]) -> list[str]:
        return sorted(
            entry.name
            for entry in _entries(self.root)
            if Path(entry.name).suffix.lower() in suffixes and _is_file(Path(entry.path))
        )[:MOST_LISTED]

    def taken_poses(self) -> list[str]:
        """Names of the board's poses that lie in the folder."""
        return sorted(
            entry.name
            for entry in _folders(self.poses)
            if POSE.fullmatch(entry.name) and _is_file(Path(entry.path) / CAPTURE_FILE)
        )


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    """Entries of a folder that have a name to show; none where it cannot be read."""
    try:
        with os.scandir(folder) as found:
            return [entry for entry in islice(found, MOST_VISITED) if _shown(entry.name)]
    except OSError:
        return []


def _folders(folder: Path) -> Iterator[os.DirEntry[str]]:
    """Folders in a folder; links to folders are passed over."""
    for entry in _entries(folder):
        with suppress(OSError):
            if entry.is_dir(follow_symlinks=False):
                yield entry


def _shown(name: str) -> bool:
    """Whether a name can be shown, and cannot be taken for an option."""
    return not name.startswith((".", "-")) and name.isprintable()


def _is_file(path: Path) -> bool:
    """Whether a path is a file itself, and no link, pipe or device."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except (OSError, ValueError):
        return False


def open_workspace(folder: StrPath) -> Workspace:
    """Return the workspace of a folder, which is made where it is missing.

    A folder that can be read and not written to can be looked at.

    Raises
    ------
    FileProblem where that is not possible.
    """
    path = Path(folder)
    if path.is_dir() and os.access(path, os.R_OK | os.X_OK):
        return Workspace(path.resolve())
    return Workspace(make_folder(folder).resolve())


def checked_words(words: str, space: Workspace) -> str:
    """Return the words that open a device, with folders as paths in the studio's folder.

    Raises
    ------
    InputError for webcams that are no number, which would read files and addresses; FileProblem
    for folders outside of the studio's.
    """
    kind, colon, which = checked_text(words, "device").partition(":")
    if kind == "webcam" and colon and not which.isdecimal():
        raise InputError(f"webcam: expected a number in the studio, got {which!r}")
    if kind == "phone":
        return f"{kind}:{space.root}"
    return f"{kind}:{space.inside(which)}" if kind in FOLDERS else words


def checked_text(text: object, what: str) -> str:
    """Return the content of a field.

    Raises
    ------
    InputError for anything but a text of at most 200 characters.
    """
    if not isinstance(text, str) or len(text) > MOST_LETTERS:
        got = f"{len(text)} characters" if isinstance(text, str) else type(text).__name__
        raise InputError(f"{what}: expected a text of at most {MOST_LETTERS} characters, got {got}")
    return text


class Words:
    """A field of the studio that a page sets: only texts of usual length are kept."""

    def __set_name__(self, owner: type, name: str) -> None:
        """Remember where the text is kept."""
        self._place = f"_{name}"

    def __get__(self, instance: object, owner: type) -> str:
        """Return the text."""
        return str(getattr(instance, self._place, ""))

    def __set__(self, instance: object, text: object) -> None:
        """Keep a text; anything else is ignored, because the studio's own page never sends it."""
        if isinstance(text, str) and len(text) <= MOST_LETTERS:
            setattr(instance, self._place, text)
