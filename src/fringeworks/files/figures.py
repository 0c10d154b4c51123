"""Numerical results on disk: JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.files.atomic import StrPath, check_target, write_text
from fringeworks.files.limits import parsing, read_content
from fringeworks.types import FileProblem, InputError


def to_json(content: Any) -> str:
    """The JSON text of results. NaN, which JSON does not have, becomes null."""

    def clean(value: Any) -> Any:
        if isinstance(value, dict):
            return {k: clean(v) for k, v in value.items()}
        if isinstance(value, (list, tuple)):
            return [clean(v) for v in value]
        if isinstance(value, np.ndarray | np.generic):
            return clean(value.tolist())
        return None if isinstance(value, float) and not np.isfinite(value) else value

    try:
        return json.dumps(clean(content), indent=2, allow_nan=False) + "\n"
    except (TypeError, ValueError) as error:
        raise InputError(
            f"content: expected numbers, text, lists and dictionaries, got others: {error}"
        ) from error


def write_figures(path: StrPath, figures: dict[str, Any]) -> Path:
    """Write numerical results as ``.json``, whole or not at all."""
    check_target(path, (".json",))
    return write_text(path, to_json(figures))


def read_figures(path: StrPath) -> dict[str, Any]:
    """Read numerical results that a command wrote with ``--json``.

    Raises
    ------
    FileProblem for a missing or damaged file, and for one that holds another value than a
    dictionary.
    """
    path = Path(path)
    with parsing(path, "numerical results (JSON)"):
        content = json.loads(read_content(path, "numerical results (JSON)"))
        # Half a surrogate pair is no letter, and no page can hold it.
        json.dumps(content, ensure_ascii=False).encode("utf-8")
        if not isinstance(content, dict):
            raise FileProblem("expected the numerical results of a command, got another JSON value")
        return content
