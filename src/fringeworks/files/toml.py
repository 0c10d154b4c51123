"""TOML files, checked against a description of their content."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, TypeVar

from fringeworks.files.atomic import StrPath
from fringeworks.files.description import DescriptionFault, Field, Section
from fringeworks.files.limits import (
    MAX_DESCRIPTION_BYTES,
    MAX_LENGTH_PX,
    parsing,
    read_content,
    text_of,
    told,
)
from fringeworks.types import FileProblem

MAX_KEY_PARTS = 32
"""Largest number of parts of a dotted key. Ours have three; the parser's time grows with the square
of their number."""
LONG_KEY = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]++\s*+\.\s*+){{{MAX_KEY_PARTS}}}""")
"""A dotted key with more parts than that."""


MAX_DIGITS = 400
"""Number of digits from which on a number is refused: floats end below 310, and Python cannot print
integers of some thousands. Words of the letters a to f count as well; hashes have 64."""
LONG_NUMBER = re.compile(rf"[0-9a-fA-F_]{{{MAX_DIGITS}}}")
"""A number with as many digits."""


Length = Annotated[int, Field(ge=2, le=MAX_LENGTH_PX)]
Size = tuple[Length, Length]
"""Columns and rows of a device, px."""
Content = TypeVar("Content", bound=Section)


def read_toml(path: StrPath, kind: type[Content]) -> Content:
    """The content of a TOML file.

    Parameters
    ----------
    path : path
    kind : type
        Description of the content.

    Raises
    ------
    FileProblem that names the file and its first fault.
    """
    path = Path(path)
    with parsing(path, "TOML"):
        content = _load(path)
        try:
            return kind.checked(content)
        except DescriptionFault as fault:
            raise FileProblem(f"{told(path)}: {fault}") from fault


def _load(path: Path) -> dict[str, Any]:
    content = read_content(path, "TOML", MAX_DESCRIPTION_BYTES)
    with parsing(path, "TOML"):
        text = text_of(content)
        if LONG_KEY.search(text):
            raise FileProblem(f"expected keys of at most {MAX_KEY_PARTS} parts, got more")
        if LONG_NUMBER.search(text):
            raise FileProblem(f"expected numbers of fewer than {MAX_DIGITS} digits, got more")
        return tomllib.loads(text)


def kind_of(description: Path) -> str | None:
    """The kind that a description names; what is wrong in it is found when it is read."""
    try:
        kind = _load(description).get("kind")
    except FileProblem:
        return None
    return kind if isinstance(kind, str) else None
