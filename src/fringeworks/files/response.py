"""A measured response on disk: a small TOML file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tomli_w

from fringeworks.files.atomic import StrPath, check_target, write_text
from fringeworks.files.description import Field, Section
from fringeworks.files.limits import existing_file, told
from fringeworks.files.provenance import ProvenanceSection, toml_section
from fringeworks.files.toml import read_toml
from fringeworks.patterns.plan import MAX_STEPS
from fringeworks.signal.phase_table import TABLE_BINS
from fringeworks.signal.response import Response
from fringeworks.types import FileProblem


class ResponseFile(Section):
    """The whole of a response file; unknown keys are refused."""

    kind: Literal["response"]
    camera: str = Field(min_length=1)
    projector: str = Field(min_length=1)
    gamma: float = Field(gt=0)
    steps: int = Field(ge=3, le=MAX_STEPS)
    pattern_exponent: float = Field(gt=0)
    residual_rad: float = Field(ge=0)
    offset_rad: float = 0.0
    brightness: list[float] = Field(min_length=1)
    table_rad: list[Annotated[list[float], Field(min_length=TABLE_BINS, max_length=TABLE_BINS)]] = (
        Field(min_length=1)
    )
    provenance: ProvenanceSection | None = None


def write_response(path: StrPath, response: Response) -> Path:
    """Write a response as TOML, whole or not at all.

    Raises
    ------
    FileProblem for another suffix, and where the folder cannot be written to.
    """
    check_target(path, (".toml",))
    content = {
        "kind": "response",
        "camera": response.camera,
        "projector": response.projector,
        "gamma": float(response.gamma),
        "steps": int(response.steps),
        "pattern_exponent": float(response.pattern_exponent),
        "residual_rad": float(response.residual_rad),
        "offset_rad": float(response.offset_rad),
        "brightness": [round(float(v), 3) for v in response.brightness],
        "table_rad": [[round(float(v), 7) for v in row] for row in response.table_rad],
    }
    write_text(path, tomli_w.dumps(content | toml_section(response.provenance)))
    return Path(path)


def read_response(path: StrPath) -> Response:
    """Read a response.

    Raises
    ------
    FileProblem where there is no such file, or it is no response.
    """
    path = existing_file(path, "a response file")
    content = read_toml(path, ResponseFile)
    rising = np.all(np.diff(content.brightness) > 0)
    if len(content.brightness) != len(content.table_rad) or not rising:
        raise FileProblem(
            f"{path}: expected a rising brightness for each of {len(content.table_rad)} tables, "
            f"got {told(content.brightness)}"
        )
    origin = content.provenance
    return Response(
        camera=content.camera,
        projector=content.projector,
        gamma=content.gamma,
        steps=content.steps,
        pattern_exponent=content.pattern_exponent,
        table_rad=np.asarray(content.table_rad),
        brightness=tuple(content.brightness),
        residual_rad=content.residual_rad,
        offset_rad=content.offset_rad,
        provenance=None if origin is None else origin.as_provenance(),
    )
