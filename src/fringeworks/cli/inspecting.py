"""``fringeworks inspect``: parts measured by a recipe, and judged by its tolerances."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.grouped import grouped
from fringeworks.cli.options import Ply, PlyOption
from fringeworks.cli.showing import ShowOptions

SECTION = "Results"
EXIT_CODES = {"pass": 0, "fail": 3, "undecided": 4}
"""Exit code of each verdict; 2 is bad input."""
COLUMNS = ["tolerance", "value", "± σ", "limits", "verdict"]
"""Columns of the table."""


@app.command(
    "inspect",
    rich_help_panel=SECTION,
    epilog="Example: fringeworks inspect part/ --recipe recipe.toml --json part.json",
)
@grouped
def inspect_part(
    capture: Annotated[Path, typer.Argument(help="Capture: a pair, or frames of a plan.")],
    recipe: Annotated[Path, typer.Option(help="Recipe: method or rig, areas, tolerances.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Write the surface: .ply, .npz, .tif …")
    ] = None,
    ply: PlyOption = Ply.points,
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
        known = fw.read_recipe(recipe)
        found = fw.inspect(capture, known)
    if out is not None:
        with output.target(out, ".ply") as place:
            fw.write(place, found.surface, kind=ply.value)
    show.write(
        found.surface,
        fw.summarise(found),
        name=capture.name,
        provenance=found.surface.provenance,
        rig=None if known.rig is None else rig_of(known),
    )
    words.table(COLUMNS, [_row(check) for check in found.checks], lines=True)
    for note in found.notes:
        words.say(f"note: {note}")
    words.say(found.verdict if found.checks else "nothing is judged: the recipe has no tolerances")
    words.wrote(out, show.figure, show.report)
    raise typer.Exit(EXIT_CODES[found.verdict])


def _row(check: fw.Check) -> list[str]:
    one = check.tolerance
    low, high = ("" if v is None else f"{v:g}" for v in (one.low, one.high))
    measured = check.value == check.value  # not NaN
    return [
        one.name,
        f"{check.value:.5g} {check.unit}" if measured else "–",
        f"{check.sigma:.2g}" if measured else "–",
        f"{low} … {high}",
        f"{check.verdict}: {check.why}" if check.why else check.verdict,
    ]


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
