"""What was found of each capture: its verdict and its findings, also after a restart."""

from __future__ import annotations

import json
import threading
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

from fringeworks.files.atomic import write_text
from fringeworks.studio.workspace import Workspace
from fringeworks.types import FileProblem

MOST_BYTES = 5_000_000
"""Longest file of notes that is read, bytes: some hundred for each capture."""
MOST_CODES = 50
"""Findings of a capture that are kept."""


@dataclass(frozen=True)
class Note:
    """What was found of a capture when it was measured or judged last."""

    verdict: str = ""
    """``pass``, ``fail`` or ``undecided``; empty where it was not judged."""
    findings: tuple[str, ...] = ()
    """Codes of the findings that are more than notes."""
    measured: bool = False


class Notes:
    """The notes of a studio's folder, by the name of the capture."""

    def __init__(self, space: Workspace) -> None:
        self._space = space
        self._lock = threading.Lock()
        self._notes = self._read()

    def of(self, name: str) -> Note:
        """The note of a capture or result; an empty one where there is none."""
        return self._notes.get(name, Note())

    def measured(self, name: str, figures: dict[str, Any]) -> None:
        """Note the findings of a measurement."""
        note = replace(self.of(name), findings=_codes(figures), measured=True)
        self._keep(name, note)

    def judged(self, name: str, figures: dict[str, Any]) -> None:
        """Note a verdict."""
        note = replace(self.of(name), verdict=str(figures["verdict"]), measured=True)
        self._keep(name, note)

    def renamed(self, old: str, new: str) -> None:
        """Give the note of a capture to its new name."""
        if old in self._notes:
            self._keep(new, self._notes.pop(old))

    def forget(self, name: str) -> None:
        """Drop the note of a capture that is taken anew."""
        if self._notes.pop(name, None) is not None:
            self._write()

    def _keep(self, name: str, note: Note) -> None:
        self._notes[name] = note
        self._write()

    def _write(self) -> None:
        with self._lock:
            text = json.dumps({name: asdict(note) for name, note in self._notes.items()})
            # Where the folder cannot be written to, notes end with the studio.
            with suppress(FileProblem):
                write_text(self._space.notes, text)

    def _read(self) -> dict[str, Note]:
        path = self._space.notes
        try:
            if path.is_symlink() or path.stat().st_size > MOST_BYTES:
                return {}
            given = json.loads(path.read_text("utf-8"))
            return {
                str(name): Note(
                    str(note["verdict"]), tuple(map(str, note["findings"])), bool(note["measured"])
                )
                for name, note in given.items()
            }
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return {}


def _codes(figures: dict[str, Any]) -> tuple[str, ...]:
    """Codes of the findings of a result that are warnings or errors."""
    found = (one for one in figures.get("findings", ()) if one.get("severity") != "note")
    return tuple(dict.fromkeys(str(one["code"]) for one in found))[:MOST_CODES]
