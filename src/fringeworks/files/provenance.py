"""Where a result comes from, as the files write and read it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from fringeworks.files.atomic import StrPath
from fringeworks.files.description import Field, Section
from fringeworks.files.limits import told
from fringeworks.types import FileProblem, Provenance, Source, provenance_from

KEY = "provenance"
"""Name of the entry that holds it, in JSON, TOML, NPZ, TIFF and comments."""
LINE_LETTERS = 400
"""Letters of a comment line. Common PLY readers (rply) refuse lines of 1024 and more."""


class SourceSection(Section):
    """One input."""

    name: str
    sha256: str


class ProvenanceSection(Section):
    """``[provenance]`` of a TOML file."""

    call: str
    version: str
    date: str
    options: dict[str, Any] = Field(default_factory=dict)
    inputs: list[SourceSection] = Field(default_factory=list)
    plan_sha256: str | None = None
    rig_sha256: str | None = None

    def as_provenance(self) -> Provenance:
        """The frozen type."""
        return provenance_from(self.as_dict())


def toml_section(provenance: Provenance | None) -> dict[str, Any]:
    """``{"provenance": …}`` for a TOML file, without what is unknown; empty for None."""
    if provenance is None:
        return {}
    content = provenance.as_dict()
    return {KEY: {name: value for name, value in content.items() if value is not None}}


def json_line(provenance: Provenance | None) -> str | None:
    """The provenance as one line of ASCII JSON; None where there is none."""
    if provenance is None:
        return None
    return json.dumps(provenance.as_dict(), sort_keys=True)


def comment_lines(provenance: Provenance | None) -> list[str]:
    """The provenance as lines of a header of comments; empty where there is none."""
    text = json_line(provenance)
    if text is None:
        return []
    pieces = [text[k : k + LINE_LETTERS] for k in range(0, len(text), LINE_LETTERS)]
    return [f"{KEY} {piece}" for piece in pieces]


def from_comments(lines: Iterable[str]) -> Provenance | None:
    """What ``comment_lines`` wrote, found among other comments; None where there is none."""
    start = f"{KEY} "
    return from_json("".join(line[len(start) :] for line in lines if line.startswith(start)))


def from_json(text: str | None) -> Provenance | None:
    """What ``json_line`` wrote; None for None and for text that holds no provenance."""
    if not text:
        return None
    try:
        return ProvenanceSection.checked(json.loads(text)).as_provenance()
    except (ValueError, RecursionError):  # no JSON, numbers too long, or of other fields
        return None


def source_of(path: StrPath) -> Source:
    """A file as an input: its name, with that of its folder, and the hash of its bytes."""
    path = Path(path)
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise FileProblem(f"{told(path)}: could not be read: {why}") from error
    folder = path.resolve().parent.name
    return Source(f"{folder}/{path.name}" if folder else path.name, digest)
