"""``fringeworks inspect``: parts measured by a recipe, and judged by its tolerances."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import Ply, PlyOption
from fringeworks.cli.showing import ShowOptions

SECTION = "Results"
EXIT_CODES = {"pass": 0, "fail": 3, "undecided": 4}
"""Exit code of each verdict; 2 is bad input."""


@app.command(
    "inspect",
    rich_help_panel=SECTION,
    epilog="Example: fringeworks inspect part/ --recipe recipe.toml --json part.json",
)
def inspect_part(
    capture: Annotated[Path, typer.Argument(help="Capture: a pair, or frames of a plan.")],
    recipe: Annotated[Path, typer.Option(help="Recipe: method or rig, areas, tolerances.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Write the surface: .ply, .npz, .tif …")
    ] = None,
    ply: PlyOption = Ply.points,
    monte_carlo: Annotated[
        int,
        typer.Option(help="Draws of a Monte Carlo beside each uncertainty budget; 0 for none."),
    ] = 0,
    title: Annotated[
        str,
        typer.Option(help="Title; by default part and serial number of the head, or the capture."),
    ] = "",
    *,
    show: ShowOptions,
) -> None:
    """Judge a part by the tolerances of a recipe; exit code 0 pass, 3 fail, 4 undecided."""
    words = output.Output(out, *show.targets)
    from fringeworks.evaluate.inspect import rig_of

    output.check(out, "surface", "points")
    show.check()
    with output.progress() as progress:
        progress("measuring …")
        known = fw.files.read_recipe(recipe)
        found = fw.inspect(capture, known, draws=monte_carlo)
    if out is not None:
        with output.target(out, ".ply") as place:
            fw.write(place, found.surface, kind=ply.value)
    figures = fw.report.summarise(found)
    show.write(
        found,
        figures,
        name=title or capture.name,
        title=title,
        provenance=found.surface.provenance,
        rig=None if known.rig is None else rig_of(known),
    )
    words.tell(found, figures)
    words.wrote(out, show.figure, show.report)
    raise typer.Exit(EXIT_CODES[found.verdict])


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks recipe part.step --rig rig.toml --out recipe.toml",
)
def recipe(
    drawing: Annotated[
        Path, typer.Argument(help="Drawing with tolerances: STEP AP242, or a QIF 3 document.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Write the recipe: .toml beside the drawing.")],
    rig: Annotated[
        Path | None, typer.Option(help="Rig file of `calibrate`; it lies beside the recipe.")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(help="Drawing: .step; its faces are those that a QIF document names."),
    ] = None,
) -> None:
    """Begin a recipe with the tolerances of a drawing; says which ones it cannot take."""
    from dataclasses import replace

    from fringeworks.types.numbers import limit  # when it is used

    words = output.Output()
    found = fw.files.read_tolerances(drawing, model=model)
    fw.files.write_recipe(out, replace(found.recipe, rig=rig))
    columns = ("tolerance", "quantity", "faces", "datums", "largest / mm")
    rows = [
        [
            one.name,
            one.quantity,
            ", ".join(one.areas),
            ", ".join(one.zone.datums),
            limit(one.high),
        ]
        for one in found.recipe.tolerances
    ]
    if rows:
        words.table(columns, rows)
    else:
        words.say("the drawing has no tolerance that a recipe has")
    for one in found.left_out:
        words.say(one.line)
    words.wrote(out)


@app.command(rich_help_panel=SECTION, epilog="Example: fringeworks convert part.npz part.x3p")
def convert(
    source: Annotated[Path, typer.Argument(help="Points or heights that were written before.")],
    target: Annotated[Path, typer.Argument(help="File of another format, such as .ply or .x3p.")],
    ply: PlyOption = Ply.points,
) -> None:
    """Write a result in another format."""
    kind = {} if ply is Ply.points else {"kind": ply.value}
    fw.write(target, fw.read(source), **kind)
    output.Output().wrote(target)
