"""What is said of requests with wrong fields, in place of pydantic's words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fringeworks.service.models import NUMBER, WORD

MOST_TOLD = 300
"""Letters of what is said of a request: it may repeat what it was given."""
MOST_GIVEN = 40
"""Letters of a wrong value that are repeated."""
ROUTES = "GET /openapi.json lists all routes"
"""Where a program finds what it may ask for."""
WRONG = {
    "extra_forbidden": "there is no such field; GET /openapi.json lists them",
    "missing": "expected this field, got none",
    "model_attributes_type": "expected a JSON object, got something else",
    "model_type": "expected a JSON object, got something else",
    "json_invalid": "expected JSON, got something else",
    "literal_error": "expected {expected}, got {given}",
    "enum": "expected {expected}, got {given}",
    "greater_than_equal": "expected {ge} or more, got {given}",
    "less_than_equal": "expected {le} or less, got {given}",
    "string_too_short": "expected {min_length} or more letters, got {given}",
    "string_too_long": "expected {max_length} letters or fewer, got {given}",
    "too_long": "expected {max_length} or fewer, got {actual_length}",
    "string_pattern_mismatch": "expected {pattern}, got {given}",
    "string_type": "expected text, got {given}",
    "list_type": "expected a list, got {given}",
    "bool_type": "expected true or false, got {given}",
    "bool_parsing": "expected true or false, got {given}",
    "int_type": "expected a whole number, got {given}",
    "int_parsing": "expected a whole number, got {given}",
    "int_from_float": "expected a whole number, got {given}",
    "int_parsing_size": "expected a smaller whole number, got {given}",
    "float_type": "expected a number, got {given}",
    "float_parsing": "expected a number, got {given}",
}
"""Sentences by pydantic's types of errors. Others keep pydantic's own words."""
PATTERNS = {
    WORD: "letters and digits, with . _ and - between them",
    NUMBER: "the number of a job, or last",
}
"""Patterns in words."""
NO_TYPE = "expected the header Content-Type: application/json, got {kind}"
"""What is said of bodies that are not read as JSON."""


PLAIN = {
    "Not Found": "{path}: there is no such route; " + ROUTES,
    "Method Not Allowed": "{method} {path}: there is no such request; " + ROUTES,
    "There was an error parsing the body": "request: expected JSON, got something else",
}
"""Sentences in place of the framework's words."""


def plain_words(detail: str, method: str, path: str) -> str:
    """What is said of a request that no route takes, or the detail that a route gave."""
    said = PLAIN.get(detail)
    return detail if said is None else said.format(method=method, path=path)


def wrong_field(fault: Mapping[str, Any], kind: str | None) -> str:
    """Where a request is wrong, what was expected there and what came.

    Parameters
    ----------
    fault : mapping
        One of pydantic's errors.
    kind : str or None
        The type of the body, as its header says; None without a header.

    Examples
    --------
    >>> wrong_field({"type": "less_than_equal", "loc": ("body", "hdr"), "input": 99,
    ...              "ctx": {"le": 8}}, "application/json")
    'hdr: expected 8 or less, got 99'
    """
    where = ".".join(str(part) for part in fault["loc"][1:])
    if not where and isinstance(fault.get("input"), bytes | str) and "json" not in (kind or ""):
        return f"request: {NO_TYPE.format(kind=_told(kind) if kind else 'none')}"
    said = WRONG.get(str(fault["type"]))
    if said is None:
        text = str(fault["msg"])
    else:
        known = dict(fault.get("ctx", {}))
        known["pattern"] = PATTERNS.get(str(known.get("pattern")), known.get("pattern"))
        text = said.format(**known, given=_told(fault.get("input")))
    return f"{where or 'request'}: {text}"[:MOST_TOLD]


def _told(given: Any) -> str:
    """A wrong value, not all of it where it is long."""
    if given is None or given == "":
        return "none"
    text = str(given) if isinstance(given, str | int | float) else type(given).__name__
    return text if len(text) <= MOST_GIVEN else f"{text[:MOST_GIVEN]}… ({len(text)} letters)"
