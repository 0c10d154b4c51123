"""TOML files, checked against a description of their content."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from fringeworks.files.atomic import StrPath
from fringeworks.types import FileProblem


class Section(BaseModel):
    """A table of a TOML file; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


Content = TypeVar("Content", bound=BaseModel)


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
    try:
        return kind.model_validate(tomllib.loads(path.read_text("utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FileProblem(f"{path}: expected TOML, got: {error}") from error
    except OSError as error:
        raise FileProblem(f"{path}: could not be read: {error.strerror}") from error
    except ValidationError as error:
        raise FileProblem(f"{path}: {_first_fault(error)}") from error


def _first_fault(error: ValidationError) -> str:
    fault = error.errors()[0]
    where = ".".join(str(part) for part in fault["loc"])
    if fault["type"] == "extra_forbidden":
        return f"unknown key {where}"
    if fault["type"] == "missing":
        return f"missing key {where}"
    return f"{where}: {fault['msg']}, got {fault['input']!r}"


def kind_of(description: Path) -> str | None:
    """The kind that a description names; what is wrong in it is found when it is read."""
    try:
        kind = tomllib.loads(description.read_text("utf-8")).get("kind")
    except (tomllib.TOMLDecodeError, UnicodeDecodeError):
        return None
    return kind if isinstance(kind, str) else None
