"""Plans on disk: a small TOML file that can be written by hand, and folders of pictures."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomli_w
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath, check_target, replacing, write_text
from fringeworks.files.description import Field, Section
from fringeworks.files.folder import replacing_folder
from fringeworks.files.images import write_frame
from fringeworks.files.limits import existing_file, parsing, told
from fringeworks.files.toml import Size, read_toml
from fringeworks.patterns.chain_search import COMMENSURATE
from fringeworks.patterns.encode import encode
from fringeworks.patterns.order_chain import repeat_distance
from fringeworks.patterns.plan import (
    Block,
    GrayCode,
    LightColour,
    PatternPlan,
    PhaseSteps,
    Uniform,
    equal_steps,
)
from fringeworks.types import Axis, Finding, InputError

PLAN_FILE = "plan.toml"
"""Plan in the folder of its pictures or frames."""
PATTERNS_FILE = "patterns.tif"
"""Pictures of a plan as one stack."""
MAX_BLOCKS = 1000
"""Largest number of entries of a sequence. Plans have 3 to 20."""


StrictInt = Annotated[int, Field(strict=True)]
"""A whole number, and neither true nor 2.0."""


class PhaseEntry(Section):
    """N shifted fringes; period or number of fringes, number of equal steps or their shifts."""

    kind: Literal["phase"]
    axis: Axis
    period_px: float | None = None
    fringes: float | None = None
    """Periods across the projector, instead of ``period_px``."""
    steps: int | None = None
    """Number of equal steps, δ_n = start_deg + sign · 360° n / steps."""
    sign: int | None = None
    """1, or −1 for programs whose steps add to the phase."""
    start_deg: float | None = None
    """δ of the first frame; 0 where left out."""
    shifts_deg: list[float] | None = None
    """δ of every frame, I = ½ + ½ cos(2π x / p − δ), instead of ``steps`` equal ones."""
    line_px: float | None = None
    """Width of a bright line in every period, instead of a cosine."""


class GrayEntry(Section):
    """Gray code."""

    kind: Literal["gray"]
    axis: Axis
    step_px: float = 1.0
    inverse: bool = False
    """Whether each bit is followed by its inverse."""
    offset_px: float = 0.0
    """Start of the first cell from the projector's edge; ≤ 0."""
    levels: int = 2
    """Levels of brightness."""
    inverted: bool | list[StrictInt] = False
    """Whether light stands for dark: in all bits, or in a list of them from 0 on."""
    unused: StrictInt = 0
    """Number of finest bits that are not decoded."""
    least_first: bool = False
    """Whether the least significant bit is projected first."""
    inverses_last: bool = False
    """Whether the inverses follow after all bits."""


class UniformEntry(Section):
    """One white or black frame, or one that is not decoded."""

    kind: Literal["white", "black", "unused"]


Entry = Annotated[PhaseEntry | GrayEntry | UniformEntry, Field(discriminator="kind")]


class PlanFile(Section):
    """The whole of a plan file; unknown keys are refused."""

    kind: Literal["plan"]
    projector: Size
    """Columns and rows."""
    bits: int = 8
    gamma: float = 1.0
    dither: bool = False
    mirrored: tuple[Axis, ...] = ()
    """Axes along which the projector mirrors its pictures."""
    colours: bool = False
    """Whether red, green and blue of a picture show three frames."""
    bits_in_turn: bool = False
    """Whether bits of the Gray codes along x and y alternate."""
    channel: LightColour | None = None
    """Colour of the light, and channel of colour images that is decoded."""
    sequence: list[Entry] = Field(min_length=1, max_length=MAX_BLOCKS)


def read_plan(path: StrPath) -> PatternPlan:
    """Read a plan.

    Raises
    ------
    InputError where there is no such file, or it is no plan; the file and the entry are named.
    """
    path = existing_file(path, "a plan file (TOML)")
    content = read_toml(path, PlanFile)
    width, height = content.projector
    blocks = []
    with parsing(path, "a plan"):
        for number, entry in enumerate(content.sequence, 1):
            try:
                blocks.append(_block(entry, width, height))
            except InputError as error:
                raise InputError(f"entry {number} of the sequence: {told(error)}") from error
        return PatternPlan(
            width,
            height,
            tuple(blocks),
            content.bits,
            content.gamma,
            content.dither,
            content.mirrored,
            content.colours,
            content.bits_in_turn,
            content.channel,
        )


def _block(entry: PhaseEntry | GrayEntry | UniformEntry, width: int, height: int) -> Block:
    if isinstance(entry, UniformEntry):
        return Uniform(entry.kind)
    length = width if entry.axis == "x" else height
    if isinstance(entry, GrayEntry):
        inverted = entry.inverted if isinstance(entry.inverted, bool) else tuple(entry.inverted)
        return GrayCode(
            entry.axis,
            entry.step_px,
            length,
            entry.inverse,
            entry.offset_px,
            entry.levels,
            inverted,
            entry.unused,
            entry.least_first,
            entry.inverses_last,
        )
    if (entry.period_px is None) == (entry.fringes is None):
        raise InputError("expected either period_px or fringes")
    if (entry.steps is None) == (entry.shifts_deg is None):
        raise InputError("expected either steps or shifts_deg")
    if entry.fringes is not None and not entry.fringes > 0:
        raise InputError(f"fringes: expected > 0, got {entry.fringes}")
    period = entry.period_px if entry.fringes is None else length / entry.fringes
    return PhaseSteps(entry.axis, period or 0.0, _shifts(entry), entry.line_px)


def _shifts(entry: PhaseEntry) -> tuple[float, ...]:
    """Shifts of an entry, rad, from equal steps or a list."""
    if entry.shifts_deg is None:
        start = math.radians(entry.start_deg or 0.0)
        return equal_steps(
            entry.steps or 0, start_rad=start, sign=1 if entry.sign is None else entry.sign
        )
    if entry.sign is not None or entry.start_deg is not None:
        raise InputError("sign, start_deg: expected together with steps; shifts_deg says it all")
    return tuple(math.radians(d) for d in entry.shifts_deg)


def _steps_entry(shifts_rad: tuple[float, ...]) -> dict[str, Any]:
    """Shifts as an entry holds them: as equal steps where they are, or else as a list."""
    start = round(math.degrees(shifts_rad[0]), 9)
    for sign in (1, -1):
        equal = equal_steps(len(shifts_rad), start_rad=math.radians(start), sign=sign)
        if np.allclose(shifts_rad, equal, rtol=0.0, atol=1e-10):
            entry: dict[str, Any] = {"steps": len(shifts_rad)}
            entry |= {"sign": sign} if sign < 0 else {}
            return entry | ({"start_deg": start} if start else {})
    return {"shifts_deg": [round(math.degrees(d), 9) for d in shifts_rad]}


def format_plan(plan: PatternPlan) -> str:
    """A plan as TOML."""
    sequence: list[dict[str, Any]] = []
    for block in plan.blocks:
        if isinstance(block, Uniform):
            sequence.append({"kind": block.kind})
        elif isinstance(block, GrayCode):
            entry: dict[str, Any] = {
                "kind": "gray",
                "axis": block.axis,
                "step_px": float(block.step_px),
            }
            entry |= {"inverse": True} if block.inverse else {}
            entry |= {"offset_px": float(block.offset_px)} if block.offset_px else {}
            entry |= {"levels": block.levels} if block.levels != 2 else {}
            entry |= {"inverted": block.inverted} if block.inverted else {}
            entry |= {"unused": block.unused} if block.unused else {}
            entry |= {"least_first": True} if block.least_first else {}
            sequence.append(entry | ({"inverses_last": True} if block.inverses_last else {}))
        else:
            entry = {"kind": "phase", "axis": block.axis, "period_px": float(block.period_px)}
            entry |= {} if block.line_px is None else {"line_px": float(block.line_px)}
            sequence.append(entry | _steps_entry(block.shifts_rad))
    content: dict[str, Any] = {"kind": "plan", "projector": [plan.width_px, plan.height_px]}
    content |= {"bits": plan.bits, "gamma": float(plan.gamma), "dither": plan.dither}
    content |= {"mirrored": list(plan.mirrored)} if plan.mirrored else {}
    content |= {"colours": True} if plan.colours else {}
    content |= {"bits_in_turn": True} if plan.bits_in_turn else {}
    content |= {} if plan.channel is None else {"channel": plan.channel}
    return tomli_w.dumps(content | {"sequence": sequence})


def holds_plan(path: Path, plan: PatternPlan) -> bool:
    """Whether a file is the description of this plan, letter by letter."""
    try:
        return path.read_text("utf-8") == format_plan(plan)
    except (OSError, UnicodeDecodeError):
        return False


def write_plan(path: StrPath, plan: PatternPlan) -> Path:
    """Write a plan as TOML, whole or not at all; ``FileProblem`` for another suffix than .toml."""
    check_target(path, (".toml",))
    write_text(path, format_plan(plan))
    return Path(path)


def check_resolvable(plan: PatternPlan) -> None:
    """Refuse a plan whose fringe orders cannot be resolved, before it is projected.

    Coordinates that repeat are no reason: a rig and a range of depths resolve them.
    """
    for axis in plan.axes:
        if plan.phase_sets(axis):
            plan.chain(axis, absolute=plan.gray_code(axis) is not None)


def repeating(plan: PatternPlan) -> tuple[Finding, ...]:
    """What is to be known of a plan whose coordinates repeat: a finding for each such axis."""
    told = []
    for axis in plan.axes:
        periods = [block.period_px for _, block in plan.phase_sets(axis)]
        length = plan.length_px(axis)
        if not periods or plan.gray_code(axis) is not None:
            continue
        distance = repeat_distance(periods, length)
        if distance < length * (1.0 - COMMENSURATE):
            told.append(
                Finding(
                    "whole periods",
                    f"coordinates along {axis} repeat after {distance:.4g} px, but the projector "
                    f"has {length} px",
                    advice="measure with a rig and a range of depths, or take a plan with more "
                    "periods or a Gray code",
                    axis=axis,
                    figures={"repeats_px": distance},
                )
            )
    return tuple(told)


def frame_names(plan: PatternPlan, suffix: str) -> list[str]:
    """A file name for every picture of a plan: its number and its label."""
    labels = plan.picture_labels()
    digits = len(str(len(labels) - 1))
    return [f"{k:0{digits}d}-{label}{suffix}" for k, label in enumerate(labels)]


def shown(picture: NDArray[Any], plan: PatternPlan) -> NDArray[Any]:
    """Return a picture as it is stored: those of 1 bit as black and white of 8 bit."""
    return 255 * picture if plan.bits == 1 else picture


def write_patterns(
    folder: StrPath,
    plan: PatternPlan,
    *,
    stack: bool = False,
    force: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Path]:
    """Write the pictures of a plan as PNG files, or as one TIFF stack, with the plan beside them.

    Parameters
    ----------
    folder : path
        New, empty, or an earlier result, which is replaced as a whole.
    plan : PatternPlan
    stack : bool
        One TIFF stack instead of PNG files.
    force : bool
        Write into a folder with other things in it, too; see ``replacing_folder``.
    progress : callable
        Called with the label of each picture.

    Returns
    -------
    Paths of the pictures in the order of projection. ``plan.toml`` is written last.

    Raises
    ------
    InputError for a plan whose fringe orders not even a range of depths resolves; FileProblem where
    the folder holds other things or cannot be written to.
    """
    check_resolvable(plan)
    labels = plan.picture_labels()
    with replacing_folder(folder, "patterns", index=(PLAN_FILE,), force=force) as writer:
        written = []
        if stack:
            import tifffile  # 15 ms, for those only who write TIFF

            written.append(writer.file(PATTERNS_FILE))
            with replacing(written[0]) as temporary, tifffile.TiffWriter(temporary) as pages:
                for label, picture in zip(labels, encode(plan), strict=True):
                    progress(label)
                    pages.write(
                        shown(picture, plan), contiguous=True, description=label, metadata=None
                    )
        else:
            names = frame_names(plan, ".png")
            for label, name, picture in zip(labels, names, encode(plan), strict=True):
                progress(label)
                written.append(writer.file(name))
                write_frame(written[-1], shown(picture, plan))
        write_plan(writer.file(PLAN_FILE), plan)
        return written
