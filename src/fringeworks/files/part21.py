"""STEP files as text (ISO 10303-21): the entities, and what they say about faces."""

from __future__ import annotations

import re
from dataclasses import dataclass

from fringeworks.types import FileProblem

MOST_ENTITIES = 5_000_000
"""Largest number of entities of a file: far more than drawings have; 2 GB of memory."""
ENTITY = re.compile(r"#(\d+)\s*=\s*((?:[^;']++|'[^']*+')*+);")
"""An entity: its number, and what it is, with strings that may hold semicolons. A doubled quote
reads as two strings. Nothing is tried twice: a quote that is missing would take for ever."""
COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
"""A comment."""
RECORD = re.compile(r"([A-Z][A-Z0-9_]*)\s*\(")
"""Beginning of a record: its type."""
TOKEN = re.compile(r"'(?:[^']|'')*'|#\d+|[(),]|[^\s(),']+")
"""Pieces of the parameters of a record."""
WIDE = re.compile(r"\\X2\\((?:[0-9A-F]{4})+)\\X0\\")
"""Letters beyond ASCII in a string, UTF-16 in hexadecimal digits."""


@dataclass(frozen=True)
class Reference:
    """A parameter that names another entity."""

    number: int


@dataclass(frozen=True)
class Entity:
    """An entity: parameters by the names of its types; complex ones have several."""

    number: int
    records: dict[str, list[object]]

    @property
    def kind(self) -> str:
        """The type, or the first of several."""
        return next(iter(self.records), "")


def parse_part21(text: str) -> dict[int, Entity]:
    """Return the entities of a STEP file by their numbers.

    Raises
    ------
    FileProblem for a text that is no STEP file, one with too many entities, and strings without an
    end, which would hide what follows.
    """
    if "ISO-10303-21" not in text[:1000]:
        raise FileProblem("expected a STEP file (ISO 10303-21), got another text")
    found: dict[int, Entity] = {}
    plain = COMMENT.sub("", text)
    if plain.count("'") % 2:
        raise FileProblem("expected quotes in pairs, got a string without an end")
    for one in ENTITY.finditer(plain):
        if len(found) >= MOST_ENTITIES:
            raise FileProblem(f"expected at most {MOST_ENTITIES:,} entities, got more")
        number = int(one[1])
        found[number] = Entity(number, _records(one[2].strip()))
    return found


def face_names(entities: dict[int, Entity]) -> list[tuple[int, str]]:
    """Return the entity's number and the name of every face, in the order of the shells."""
    shells = [e for e in entities.values() if {"CLOSED_SHELL", "OPEN_SHELL"} & e.records.keys()]
    found, seen = [], set()
    for shell in shells:
        parameters = next(iter(shell.records.values()))
        for one in references(parameters):
            face = entities.get(one)
            if face is not None and "ADVANCED_FACE" in face.records and one not in seen:
                seen.add(one)
                name = face.records["ADVANCED_FACE"][0]
                found.append((one, name.strip() if isinstance(name, str) else ""))
    return found


def references(value: object) -> list[int]:
    """Return the numbers of the entities that parameters name, in their order."""
    if isinstance(value, Reference):
        return [value.number]
    if isinstance(value, list):
        return [number for one in value for number in references(one)]
    return []


def _records(text: str) -> dict[str, list[object]]:
    """Parameters by type; a complex entity is a list of records in brackets."""
    found: dict[str, list[object]] = {}
    place = 1 if text.startswith("(") else 0
    while (head := RECORD.search(text, place)) is not None:
        parameters, place = _parameters(text, head.end())
        found[head[1]] = parameters
        if not text.startswith("("):
            break
    return found


def _parameters(text: str, start: int) -> tuple[list[object], int]:
    """The parameters after an opening bracket, and the place after the closing one."""
    stack: list[list[object]] = [[]]
    for token in TOKEN.finditer(text, start):
        word = token[0]
        if word == "(":
            stack.append([])
        elif word == ")":
            done = stack.pop()
            if not stack:
                return done, token.end()
            stack[-1].append(done)
        elif word != ",":
            stack[-1].append(_value(word))
    raise FileProblem("expected brackets in pairs, got an open one")


def _value(word: str) -> object:
    if word.startswith("#"):
        return Reference(int(word[1:]))
    if word.startswith("'"):
        return WIDE.sub(_letters, word[1:-1].replace("''", "'"))
    try:
        return float(word)
    except ValueError:
        return word if word.startswith(".") else None if word in "$*" else word


def _letters(found: re.Match[str]) -> str:
    return bytes.fromhex(found[1]).decode("utf-16-be", "replace")
