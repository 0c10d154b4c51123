"""The folder of a studio: what lies in it, and nothing outside of it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fringeworks.files.atomic import StrPath
from fringeworks.files.exposures import is_exposures
from fringeworks.files.folder import make_folder
from fringeworks.files.pair import CAPTURE_FILE
from fringeworks.types import FileProblem

NAME = re.compile(r"[\w][\w .-]{0,59}", re.UNICODE)
"""Names that users give: letters, digits, spaces, dots and dashes; no separators."""
RESULTS = (".ply", ".npz", ".tif", ".tiff", ".x3p", ".gsf", ".xyz")
"""Suffixes of results that can be looked at."""
DEEPEST = 2
"""Levels of folders that are searched for captures."""
MOST_LISTED = 500
"""Entries of a list; more would not be read."""


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
    def poses(self) -> Path:
        """The folder of the board's poses."""
        return self.root / "board"

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
        FileProblem for a name with other letters than words have, and as ``inside``.
        """
        if not NAME.fullmatch(name) or name.endswith((".", " ")):
            raise FileProblem(
                f"name: expected letters, digits, spaces, dots or dashes, got {name!r}"
            )
        return self.inside(name + suffix)

    def captures(self) -> list[str]:
        """Names of the captures, those of the board's poses left out."""
        return sorted(self._captures(self.root, DEEPEST))[:MOST_LISTED]

    def has_captures(self) -> bool:
        """Whether there is any; pages ask twice a second."""
        return next(self._captures(self.root, DEEPEST), None) is not None

    def _captures(self, folder: Path, levels: int) -> Iterator[str]:
        for entry in folder.iterdir():
            hidden = entry.name.startswith(".") or entry == self.poses
            if hidden or entry.is_symlink() or not entry.is_dir():
                continue
            if (entry / CAPTURE_FILE).is_file() or is_exposures(entry):
                yield entry.relative_to(self.root).as_posix()
            elif levels > 1:
                yield from self._captures(entry, levels - 1)

    def results(self) -> list[str]:
        """Names of the files that hold results."""
        return sorted(
            entry.name
            for entry in self.root.iterdir()
            if entry.suffix.lower() in RESULTS and entry.is_file() and not entry.is_symlink()
        )[:MOST_LISTED]

    def taken_poses(self) -> list[str]:
        """Names of the board's poses that lie in the folder."""
        if not self.poses.is_dir():
            return []
        return sorted(p.name for p in self.poses.iterdir() if (p / CAPTURE_FILE).is_file())


def open_workspace(folder: StrPath) -> Workspace:
    """Return the workspace of a folder, which is made where it is missing.

    Raises
    ------
    FileProblem where that is not possible.
    """
    return Workspace(make_folder(folder).resolve())
