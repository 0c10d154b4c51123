"""The head of a report: for whom, of which part, and who signs."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from fringeworks.types.errors import InputError

HEAD_FIELDS: Mapping[str, str] = MappingProxyType(
    {
        "customer": "customer",
        "order": "order",
        "part": "part",
        "part_number": "part number",
        "serial": "serial number",
        "drawing": "drawing",
        "revision": "drawing revision",
        "device": "device",
        "inspector": "inspected by",
        "language": "language",
    }
)
"""Fields of a report's head, and their words on paper: those of the title block of a drawing
(ISO 7200:2004) with its language, the serial number, and who inspects with what."""
ENGLISH = "en"
"""Language of reports unless another is asked for."""
LANGUAGES = (ENGLISH, "de", "zh", "ja")
"""Languages of reports, as in ISO 639: English, German, Chinese, Japanese."""
LETTERS: Mapping[str, str] = MappingProxyType({"zh": "检", "ja": "検"})
"""A letter of the languages that most typefaces lack; each stands for "inspection"."""
PART_HEAD = ("customer", "order", "part", "part_number", "serial", "drawing", "revision")
"""Fields of a report that judges a part."""
DEVICE_HEAD = ("customer", "order", "device", "serial")
"""Fields of a report that judges a measuring device."""
MOST_LETTERS = 120
"""Letters of a field: two lines on paper."""


def headline(head: Mapping[str, str], name: str) -> str:
    """Return the title of a report on a part, for a capture of this name.

    Examples
    --------
    >>> headline({"part": "Bracket", "serial": "18"}, "capture-3")
    'Bracket, no. 18'
    >>> headline({"part": "Bracket"}, "capture-3"), headline({}, "capture-3")
    ('Bracket: capture-3', 'capture-3')
    """
    part = head.get("part") or head.get("part_number")
    if not part:
        return name
    return f"{part}, no. {head['serial']}" if head.get("serial") else f"{part}: {name}"


def checked_head(head: Mapping[str, str]) -> dict[str, str]:
    """Return the fields of a head.

    Raises
    ------
    InputError for an unknown field or language, and for text that is empty, longer than 120 letters
    or not in one line.
    """
    for name, text in head.items():
        if name not in HEAD_FIELDS:
            known = ", ".join(HEAD_FIELDS)
            raise InputError(f"head: expected fields of {known}, got {str(name)[:MOST_LETTERS]!r}")
        good = isinstance(text, str) and text.isprintable() and text.strip()
        if not good or len(text) > MOST_LETTERS:
            raise InputError(
                f"head: expected a line of 1 to {MOST_LETTERS} letters for {name}, got "
                f"{str(text)[:MOST_LETTERS]!r}"
            )
        if name == "language" and text not in LANGUAGES:
            raise InputError(f"head: expected a language of {', '.join(LANGUAGES)}, got {text!r}")
    return dict(head)
