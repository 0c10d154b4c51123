"""Sections *Returns*, *Yields* and *Raises* of docstrings are sentences, not lists of types."""

from __future__ import annotations

import re
from typing import Any

import griffe

SECTION = re.compile(r"^(Returns|Yields|Raises)\n-+\n", re.M)


class Prose(griffe.Extension):
    """Gives these sections another title, so that the parser keeps their text as it is."""

    def on_instance(self, *, obj: Any, **_: Any) -> None:
        """Change the docstring of an object that was just read."""
        if obj.docstring:
            obj.docstring.value = SECTION.sub(lambda m: f"{m[1]}:\n--------\n", obj.docstring.value)
