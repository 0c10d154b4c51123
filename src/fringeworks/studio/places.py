"""Addresses of the page: every step, capture and view has one, so that Back and bookmarks work."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import parse_qsl, quote, unquote, urlencode, urlsplit

STEPS = (
    *("start", "set up", "calibrate", "scan", "captures", "look"),
    *("batch", "certify", "export", "learn", "history"),
)
"""The steps in the order of the navigation; their addresses have a hyphen for a space."""
MOST_LETTERS = 2000
"""Longest address that is read, characters."""


@dataclass(frozen=True)
class Place:
    """What a page shows: a step, and in *Look* the source and how it is measured."""

    step: str
    source: str = ""
    """Name of a capture or file in the studio's folder; empty for none."""
    method: str = ""
    """Empty for the usual one."""
    options: dict[str, Any] = field(default_factory=dict)
    """Options of the method that were changed."""

    @property
    def address(self) -> str:
        """The path of its address, with what is asked for."""
        if self.step == STEPS[0]:
            return "/"
        path = f"/{self.step.replace(' ', '-')}"
        if self.source:
            path += f"/{quote(self.source)}"
        asked = [("method", self.method)] if self.method else []
        asked += [(name, json.dumps(value)) for name, value in self.options.items()]
        return f"{path}?{urlencode(asked)}" if asked else path


def place_of(address: str) -> Place | None:
    """Return the place of an address; None where there is none.

    Parameters
    ----------
    address : str
        Path and query, as of ``Place.address``.
    """
    if not isinstance(address, str) or len(address) > MOST_LETTERS:
        return None
    try:
        parts = urlsplit(address)
    except ValueError:
        return None
    slug, _, source = parts.path.removeprefix("/").partition("/")
    step = slug.replace("-", " ") if slug else STEPS[0]
    if step not in STEPS or (source and step != "look"):
        return None
    asked = dict(parse_qsl(parts.query)) if source else {}
    method = asked.pop("method", "")
    return Place(step, unquote(source), method, {n: _value(v) for n, v in asked.items()})


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text
