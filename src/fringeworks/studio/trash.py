"""The trash of a studio's folder: what clicks delete or replace is kept there for undoing."""

from __future__ import annotations

import json
import os
import shutil
import threading
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

from fringeworks.files.atomic import write_text
from fringeworks.studio.workspace import RESERVED, Workspace
from fringeworks.types import FileProblem, InputError

KEPT_DAYS = 30
"""Days after which what lies in the trash is deleted: as long as mail programs and file managers
keep theirs."""
ENTRY_FILE = "entry.json"
"""File in an entry's folder that says what was done."""
STAMP = "%Y%m%dT%H%M%S"
"""Beginning of the name of an entry's folder: when it was made, in UTC."""
MOST_ENTRIES = 2000
"""Entries that are listed; older ones wait for their deletion."""
DIGITS = 4
"""Digits of the number of an entry."""


@dataclass(frozen=True)
class Entry:
    """One thing that a click did, and what it takes to undo it."""

    name: str
    """Of its folder in the trash."""
    what: str
    """What was done, such as ``delete pose-03``."""
    names: tuple[str, ...] = ()
    """Paths in the studio's folder that it deleted or replaced."""
    kept: tuple[str, ...] = ()
    """Those of them that the trash holds; the others did not exist before."""
    renamed: tuple[str, str] | None = None
    """Name before and after, where something was renamed."""
    again: bool = False
    """Whether it is the undoing of another entry."""

    @property
    def when(self) -> datetime:
        """When it was done, in UTC."""
        return datetime.strptime(self.name.partition("-")[0], STAMP).replace(tzinfo=UTC)


@dataclass
class Trash:
    """Deletes and replaces files so that this can be undone for 30 days.

    Parameters
    ----------
    space : Workspace
    """

    space: Workspace
    _known: tuple[int, list[Entry]] = field(default=(-1, []), init=False)
    """Entries with the time of the trash folder, because pages ask twice a second."""
    _lock: threading.RLock = field(default_factory=threading.RLock, init=False)

    def entries(self) -> list[Entry]:
        """What can be undone, the latest first."""
        try:
            stamp = self.space.trash.stat().st_mtime_ns
        except OSError:
            return []
        if self._known[0] != stamp:
            names = sorted((p.name for p in self.space.trash.iterdir()), reverse=True)
            found = (self._read(name) for name in names[:MOST_ENTRIES])
            self._known = stamp, [entry for entry in found if entry is not None]
        return self._known[1]

    def last(self) -> Entry | None:
        """What *Undo* undoes: the latest entry that is no undoing itself."""
        return next((entry for entry in self.entries() if not entry.again), None)

    def delete(self, name: str, what: str) -> Entry:
        """Move a file or folder to the trash.

        Raises
        ------
        InputError for one that is not there; FileProblem where it cannot be moved.
        """
        if not self.space.inside(name).exists():
            raise InputError(f"{name}: expected a file or folder of the studio, got none")
        return self._put(what, (name,), moved=(name,))

    def clear(self, names: Sequence[str], what: str) -> Entry:
        """Move several files and folders to the trash at once; missing ones are passed over."""
        there = tuple(name for name in names if self.space.inside(name).exists())
        return self._put(what, there, moved=there)

    def before(self, names: Sequence[str], what: str) -> Entry:
        """Keep files as they are before they are replaced; missing ones are noted as such."""
        return self._put(what, tuple(names))

    def rename(self, old: str, new: str) -> Entry:
        """Give a file or folder another name.

        Raises
        ------
        InputError where the new name is taken.
        """
        self._move_to_free(old, new)
        entry = self._new(f"rename {old} to {new}", renamed=(old, new))
        self._write(entry)
        return entry

    def undo(self, entry: Entry | None = None) -> str:
        """Undo an entry, by default the latest; what it was, in words.

        What takes its place now is kept in the trash, so that undoing can be undone.

        Raises
        ------
        InputError where there is nothing to undo, or the place of a folder is taken.
        """
        with self._lock:
            entry = entry or self.last()
            if entry is None:
                raise InputError("There is nothing to undo.")
            if entry.renamed is not None:
                self._move_to_free(entry.renamed[1], entry.renamed[0])
            else:
                self._refuse_taken(entry)
                if any(self.space.inside(name).exists() for name in entry.names):
                    # Others may read a file at any moment: it is never missing between the two.
                    moved = set(entry.names) - {n for n in entry.kept if self._is_file(entry, n)}
                    self._put(f"undone: {entry.what}", entry.names, moved=moved, again=True)
                for name in entry.kept:
                    target = self.space.inside(name)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    kept = self._folder(entry) / name
                    os.replace(kept, target) if kept.is_file() else shutil.move(kept, target)
            self._forget(entry)
            return f"Undone: {entry.what}."

    def purge(self) -> None:
        """Delete what has lain in the trash for 30 days."""
        oldest = datetime.now(UTC) - timedelta(days=KEPT_DAYS)
        for entry in self.entries():
            if entry.when < oldest:
                self._forget(entry)

    def _forget(self, entry: Entry) -> None:
        shutil.rmtree(self._folder(entry), ignore_errors=True)
        self._known = (-1, [])

    def _is_file(self, entry: Entry, name: str) -> bool:
        """Whether an entry holds a file of a name, and the studio's folder has one as well."""
        return (self._folder(entry) / name).is_file() and self.space.inside(name).is_file()

    def _refuse_taken(self, entry: Entry) -> None:
        """Captures are not pushed aside by older ones of the same name."""
        for name in entry.kept:
            if self.space.inside(name).exists() and name not in RESERVED:
                raise InputError(f"The folder has another {name!r} now: rename or delete it first.")

    def _move_to_free(self, old: str, new: str) -> None:
        source, target = self.space.inside(old), self.space.inside(new)
        if target.exists():
            raise InputError(f"The folder has {new!r} already: choose another name.")
        if not source.exists():
            raise InputError(f"{old}: expected a file or folder of the studio, got none")
        try:
            source.rename(target)
        except OSError as error:
            raise FileProblem(f"{old}: could not be renamed: {error.strerror}") from error

    def _put(
        self,
        what: str,
        names: tuple[str, ...],
        *,
        moved: Collection[str] = (),
        again: bool = False,
    ) -> Entry:
        """Keep files in the trash: some are moved there, the others copied."""
        with self._lock:
            kept = tuple(name for name in names if self.space.inside(name).exists())
            entry = self._new(what, names=names, kept=kept, again=again)
            try:
                for name in kept:
                    place = self._folder(entry) / name
                    place.parent.mkdir(parents=True, exist_ok=True)
                    # What is being replaced stays where it is until the new one is complete.
                    keep = shutil.move if name in moved else shutil.copy2
                    keep(self.space.inside(name), place)
            except OSError as error:
                raise FileProblem(
                    f"{what}: could not be moved to the trash: {error.strerror}"
                ) from error
            self._write(entry)
            return entry

    def _new(self, what: str, **given: object) -> Entry:
        """An entry with a folder of its own."""
        stamp = datetime.now(UTC).strftime(STAMP)
        try:
            self.space.trash.mkdir(exist_ok=True)
            for number in range(10**DIGITS):
                folder = self.space.trash / f"{stamp}-{number:0{DIGITS}d}"
                with suppress(FileExistsError):
                    folder.mkdir()
                    return Entry(folder.name, what, **given)  # type: ignore[arg-type]
        except OSError as error:
            raise FileProblem(f"{self.space.trash}: {error.strerror}") from error
        raise FileProblem(f"{self.space.trash}: expected fewer entries in one second")

    def _write(self, entry: Entry) -> None:
        write_text(self._folder(entry) / ENTRY_FILE, json.dumps(asdict(entry)))
        self._known = (-1, [])

    def _folder(self, entry: Entry) -> Path:
        return self.space.trash / entry.name

    def _read(self, name: str) -> Entry | None:
        """An entry; None for anything else in the folder, whoever wrote it."""
        try:
            given = json.loads((self.space.trash / name / ENTRY_FILE).read_text("utf-8"))
            renamed = given["renamed"]
            entry = Entry(
                name,
                str(given["what"]),
                tuple(map(str, given["names"])),
                tuple(map(str, given["kept"])),
                None if renamed is None else (str(renamed[0]), str(renamed[1])),
                bool(given["again"]),
            )
            paths = {*entry.names, *(entry.renamed or ())}
            plain = all(self._is_plain(path) for path in paths)
            known = plain and entry.when and set(entry.kept) <= set(entry.names)
            return entry if known else None
        except (OSError, ValueError, KeyError, TypeError, IndexError):
            return None

    def _is_plain(self, name: str) -> bool:
        """Whether a name is that of something in the studio's folder, not of the folder itself."""
        try:
            there = self.space.inside(name) != self.space.root
        except InputError:
            return False
        return there and not Path(name).is_absolute() and ".." not in Path(name).parts
