"""Options that several commands share. A name means one thing everywhere."""

from __future__ import annotations

import re
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, TypeVar

import typer

import fringeworks as fw
from fringeworks.cli.output import is_there, want_json

Folder = Annotated[Path, typer.Option("--out", help="Folder to write.", show_default=False)]
Force = Annotated[
    bool, typer.Option("--force", help="Write into a folder with other things in it, too.")
]
JsonFile = Annotated[
    Path | None,
    typer.Option(
        "--json", help="Write the numerical results as JSON to this file.", callback=want_json
    ),
]
HeadOption = Annotated[
    list[str] | None,
    typer.Option(
        "--head",
        help="Field of the report's head, as serial=18: customer, order, part, part_number, "
        "serial, drawing, revision, device, inspector, language (en, de, zh, ja); repeatable.",
    ),
]
Figure = Annotated[
    Path | None, typer.Option("--figure", help="Draw a picture: .png, .pdf or .svg.")
]
PlanFile = Annotated[
    Path | None, typer.Option("--plan", help="Plan file; for stacks that have none.")
]
ResponseFile = Annotated[
    Path | None, typer.Option("--response", help="Response file; the response is corrected.")
]


def _name(option: typer.CallbackParam, text: str | None) -> str | None:
    """The name of a device, as captures and responses store it; words that open one are refused."""
    if text is not None and re.match(r"[a-z][\w-]*:\S", text):
        raise fw.InputError(
            f"{option.opts[0]}: expected a name such as left, got {text!r}, which opens a device; "
            f"{option.opts[0].removesuffix('-name')} of `capture`, `scan` and `calibrate --live` "
            "takes it"
        )
    return text


CameraName = Annotated[
    str | None,
    typer.Option("--camera-name", callback=_name, help="Name of the camera, for its response."),
]
ProjectorName = Annotated[
    str | None,
    typer.Option(
        "--projector-name", callback=_name, help="Name of the projector, for its response."
    ),
]
ProjectorWords = Annotated[
    str | None,
    typer.Option("--projector", help="screen, screen:NAME, memory:FOLDER or virtual[:SCENE]."),
]
CameraWords = Annotated[
    str | None,
    typer.Option(
        "--camera",
        help="webcam:NUMBER, genicam[:NAME], gentl[:NAME], folder:PATH, virtual[:SCENE].",
    ),
]
Size = Annotated[int, typer.Option("--size", help="Side of the frames, px.")]


class AxisName(StrEnum):
    """Direction along the columns or along the rows."""

    x = "x"
    y = "y"


class DenoiserName(StrEnum):
    """How frames are denoised before they are analysed."""

    emd = "emd"
    emd2d = "emd2d"
    bemd = "bemd"


class ZeroName(StrEnum):
    """What tells where the displacement of two frames is 0."""

    rim = "rim"
    reference = "reference"


class Ply(StrEnum):
    """Content of a file of points."""

    points = "points"
    normals = "normals"
    mesh = "mesh"
    frame = "frame"


PlyOption = Annotated[
    Ply,
    typer.Option(
        "--ply",
        help="Content of a file of points; mesh: .ply, .vtp; frame: all pixels, .pcd, .csv, .e57.",
    ),
]
DenoiseOption = Annotated[
    DenoiserName | None, typer.Option("--denoise", help="Remove noise from both frames first.")
]

ZeroOption = Annotated[
    ZeroName,
    typer.Option(
        "--zero",
        help="rim: remove the displacement that the background shows, as by a camera that moved; "
        "reference: compare the frames as they are.",
    ),
]

DepthOption = Annotated[
    str | None,
    typer.Option(
        "--depth",
        help="Smallest and largest depth of what is lit, mm, as 450:560. It resolves the fringe "
        "orders of plans that repeat; points outside are removed.",
    ),
]

Item = TypeVar("Item")


def items(kind: Callable[[str], Item], text: str, name: str) -> list[Item]:
    """The values of an option that are separated by commas."""
    try:
        found = [kind(part.strip()) for part in text.split(",") if part.strip()]
    except ValueError as error:
        raise fw.InputError(
            f"--{name}: expected values separated by commas, got {text!r}"
        ) from error
    if not found:
        raise fw.InputError(f"--{name}: expected at least one value, got {text!r}")
    return found


def axes_of(text: str) -> tuple[fw.patterns.Axis, ...]:
    """Axes of the projector from ``x,y``."""
    return tuple(axis.value for axis in items(AxisName, text, "axes"))


def size_of(text: str, name: str) -> tuple[int, int]:
    """Columns and rows from ``1920x1080``."""
    width, cross, height = text.lower().replace("×", "x").partition("x")
    if not (cross and width.strip().isdigit() and height.strip().isdigit()):
        raise fw.InputError(f"--{name}: expected columns x rows, as 1920x1080, got {text!r}")
    return int(width), int(height)


def region_of(text: str, name: str) -> fw.devices.Region:
    """Part of a frame from ``x,y,columns,rows``."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 4 or not all(part.isdigit() for part in parts):
        raise fw.InputError(
            f"--{name}: expected first column, first row, columns and rows, as 128,64,640,512, got "
            f"{text!r}"
        )
    return fw.devices.Region(*map(int, parts))


def depth_of(text: str | None) -> tuple[float, float] | None:
    """Smallest and largest depth in mm from ``450:560``; None for none."""
    if text is None:
        return None
    near, _, far = text.partition(":")
    try:
        return float(near), float(far)
    except ValueError as error:
        raise fw.InputError(
            f"--depth: expected two depths in mm as 450:560, got {text!r}"
        ) from error


def gains_of(text: str | None) -> tuple[float, float, float] | None:
    """Gains of red, green and blue from ``1.9,1,1.4``, or from a capture of a grey card."""
    if text is None:
        return None
    if is_there(text):
        return fw.stack.white_balance(fw.files.read_stack(text))
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError as error:
        raise fw.InputError(
            f"--white-balance: expected three gains, as 1.9,1,1.4, or a capture, got {text!r}"
        ) from error
    return red, green, blue
