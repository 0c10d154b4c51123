"""``fringeworks rig``: rig files of other programs, and for them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import size_of

SECTION = "Stacks and rigs"


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks rig rig.xml --projector-size 1024x768 --out rig.toml",
)
def rig(
    source: Annotated[Path, typer.Argument(help="Rig file: .toml, or .xml, .yml (OpenCV).")],
    out: Annotated[Path, typer.Option("--out", help="Rig file of another kind.")],
    projector_size: Annotated[
        str | None,
        typer.Option(help="Columns x rows, as 1024x768, where a file of OpenCV has none."),
    ] = None,
    camera_size: Annotated[
        str | None, typer.Option(help="The same for the camera, as 1280x1024.")
    ] = None,
    unit_mm: Annotated[
        float | None, typer.Option(help="Unit of OpenCV's file in mm, such as 1000 for metres.")
    ] = None,
) -> None:
    """Convert a rig file, to and from OpenCV's XML and YAML."""
    from fringeworks.rig.point_findings import unit_notes

    words = output.Output(out)
    output.check(out, "rig")
    sizes = [
        None if given is None else size_of(given, name)
        for name, given in (("camera-size", camera_size), ("projector-size", projector_size))
    ]
    with output.target(out, ".toml") as place:
        found = fw.read_rig(source, camera_size=sizes[0], projector_size=sizes[1], unit_mm=unit_mm)
        fw.write_rig(place, found)
    for note in unit_notes(found):
        words.say(f"note: {note}")
    words.wrote(out)
