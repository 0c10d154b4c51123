"""``fringeworks evaluate``: errors of what was measured."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import JsonFile, items

SECTION = "Results"


class BodyName(StrEnum):
    """Bodies that are fitted to points."""

    plane = "plane"
    sphere = "sphere"
    cylinder = "cylinder"


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks evaluate ball.ply --fit sphere --diameter-mm 50",
)
def evaluate(
    points: Annotated[
        Path,
        typer.Argument(
            help="Points (.ply, .xyz, .npz), or heights in mm (.tif, .npz, .x3p, .gsf)."
        ),
    ],
    fit: Annotated[BodyName, typer.Option(help="Body that is fitted.")],
    diameter_mm: Annotated[
        float | None, typer.Option(help="Calibrated diameter, mm: probing error size PS.")
    ] = None,
    count: Annotated[int, typer.Option(help="Spheres to find; 2 for their spacing.")] = 1,
    spacing_mm: Annotated[
        float | None, typer.Option(help="Calibrated distance of two spheres, mm: error SD.")
    ] = None,
    within: Annotated[
        str | None,
        typer.Option(help="Region: points in a ball, x,y,z,radius in mm; all by default."),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Fit a body to points: form and size errors in the terms of VDI/VDE 2634."""
    ball: Any = None if within is None else tuple(items(float, within, "within"))
    found = fw.fit(
        points,
        fit.value,
        diameter_mm=diameter_mm,
        count=count,
        spacing_mm=spacing_mm,
        within=ball,
    )
    figures = fw.report.summarise(found)
    output.write_json(json_file, figures)
    output.Output(json_file).tell(found, figures)
