"""Plans on disk: a small TOML file that can be written by hand, and folders of pictures."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tifffile
import tomli_w
from pydantic import Field

from fringeworks.files.atomic import make_folder, replacing, write_frame, write_text
from fringeworks.files.toml import Section, read_toml
from fringeworks.patterns.encode import encode
from fringeworks.patterns.plan import (
    Block,
    GrayCode,
    PatternPlan,
    PhaseSteps,
    Uniform,
    equal_steps,
)
from fringeworks.types import Axis, InputError

PLAN_FILE = "plan.toml"
STACK_FILE = "patterns.tif"


class PhaseEntry(Section):
    """N shifted fringes; period or number of fringes, number of equal steps or their shifts."""

    kind: Literal["phase"]
    axis: Axis
    period_px: float | None = None
    fringes: float | None = None
    """Periods across the projector, instead of ``period_px``."""
    steps: int | None = None
    shifts_deg: list[float] | None = None
    """δ of every frame, I = ½ + ½ cos(2π x / p − δ), instead of ``steps`` equal ones from 0."""


class GrayEntry(Section):
    """Gray code."""

    kind: Literal["gray"]
    axis: Axis
    step_px: float = 1.0
    inverse: bool = False
    """Whether each bit is followed by its inverse."""


class LevelEntry(Section):
    """One white or black frame."""

    kind: Literal["white", "black"]


Entry = Annotated[PhaseEntry | GrayEntry | LevelEntry, Field(discriminator="kind")]


class PlanFile(Section):
    """The whole of a plan file; unknown keys are refused."""

    kind: Literal["plan"]
    projector: tuple[int, int]
    """Columns and rows."""
    bits: int = 8
    gamma: float = 1.0
    dither: bool = False
    sequence: list[Entry] = Field(min_length=1)


def read_plan(path: Path) -> PatternPlan:
    """Read a plan.

    Raises
    ------
    InputError where there is no such file, or it is no plan; the file and the entry are named.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: expected a plan file (TOML), got no such file")
    content = read_toml(path, PlanFile)
    width, height = content.projector
    blocks = []
    for number, entry in enumerate(content.sequence, 1):
        try:
            blocks.append(_block(entry, width, height))
        except InputError as error:
            raise InputError(f"{path}: entry {number} of the sequence: {error}") from error
    try:
        return PatternPlan(
            width, height, tuple(blocks), content.bits, content.gamma, content.dither
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _block(entry: PhaseEntry | GrayEntry | LevelEntry, width: int, height: int) -> Block:
    if isinstance(entry, LevelEntry):
        return Uniform(entry.kind)
    length = width if entry.axis == "x" else height
    if isinstance(entry, GrayEntry):
        return GrayCode(entry.axis, entry.step_px, length, entry.inverse)
    if (entry.period_px is None) == (entry.fringes is None):
        raise InputError("expected either period_px or fringes")
    if (entry.steps is None) == (entry.shifts_deg is None):
        raise InputError("expected either steps or shifts_deg")
    if entry.fringes is not None and not entry.fringes > 0:
        raise InputError(f"fringes: expected > 0, got {entry.fringes}")
    period = entry.period_px if entry.fringes is None else length / entry.fringes
    if entry.shifts_deg is None:
        shifts = equal_steps(entry.steps or 0)
    else:
        shifts = tuple(math.radians(d) for d in entry.shifts_deg)
    return PhaseSteps(entry.axis, period or 0.0, shifts)


def format_plan(plan: PatternPlan) -> str:
    """A plan as TOML."""
    sequence: list[dict[str, Any]] = []
    for block in plan.blocks:
        if isinstance(block, Uniform):
            sequence.append({"kind": block.kind})
        elif isinstance(block, GrayCode):
            entry = {"kind": "gray", "axis": block.axis, "step_px": float(block.step_px)}
            sequence.append(entry | ({"inverse": True} if block.inverse else {}))
        else:
            n = len(block.shifts_rad)
            entry = {"kind": "phase", "axis": block.axis, "period_px": float(block.period_px)}
            if np.allclose(block.shifts_rad, equal_steps(n), atol=1e-12):
                sequence.append(entry | {"steps": n})
            else:
                degrees = [round(math.degrees(d), 9) for d in block.shifts_rad]
                sequence.append(entry | {"shifts_deg": degrees})
    content: dict[str, Any] = {"kind": "plan", "projector": [plan.width_px, plan.height_px]}
    content |= {"bits": plan.bits, "gamma": float(plan.gamma), "dither": plan.dither}
    return tomli_w.dumps(content | {"sequence": sequence})


def write_plan(path: Path, plan: PatternPlan) -> Path:
    """Write a plan as TOML, whole or not at all."""
    write_text(path, format_plan(plan))
    return Path(path)


def write_patterns(
    folder: Path,
    plan: PatternPlan,
    *,
    stack: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Path]:
    """The pictures of a plan as PNG files, or one TIFF stack, with the plan beside them.

    Returns
    -------
    Paths of the pictures, in the order in which they are to be sent; the plan is written last, so
    that a folder that has one is complete.
    """
    folder = make_folder(folder)
    labels = plan.labels()
    digits = len(str(len(labels) - 1))
    written = []
    if stack:
        path = folder / STACK_FILE
        with replacing(path) as temporary, tifffile.TiffWriter(temporary) as writer:
            for label, picture in zip(labels, encode(plan), strict=True):
                progress(label)
                writer.write(picture, contiguous=True, description=label, metadata=None)
        written.append(path)
    else:
        for k, (label, picture) in enumerate(zip(labels, encode(plan), strict=True)):
            progress(label)
            path = folder / f"{k:0{digits}d}-{label}.png"
            write_frame(path, picture)
            written.append(path)
    write_plan(folder / PLAN_FILE, plan)
    return written
