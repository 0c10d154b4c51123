"""``fringeworks selftest``: what the documentation promises, measured on this machine."""

from __future__ import annotations

from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import JsonFile

COLUMNS = {
    "way": "way",
    "body": "body",
    "disturbance": "disturbance",
    "unit": "unit",
    "measured": "measured",
    "bias": "bias",
    "deviation": "s.d.",
    "typical": "typical",
    "sigma": "σ",
    "bound": "bound",
    "within_1_sigma": "in 1 σ",
    "within_2_sigma": "in 2 σ",
    "gross": "gross",
}
"""Columns of the table by the fields of a case."""
BROKEN = 1
"""Exit code where a promise is not kept."""


@app.command(
    rich_help_panel="Simulation",
    epilog="Example: fringeworks selftest --json selftest.json, or fringeworks selftest --quick",
)
def selftest(
    quick: Annotated[
        bool, typer.Option("--quick", help="Three scenes and two methods: about ten seconds.")
    ] = False,
    json_file: JsonFile = None,
    seed: Annotated[int, typer.Option(help="Seed of the noise; others give other frames.")] = 0,
) -> None:
    """Measure known bodies, and check the promised accuracy; exit code 1 if a promise is broken."""
    words = output.Output(json_file)
    with output.progress() as progress:
        found = fw.selftest(quick=quick, seed=seed, progress=progress)
    output.write_json(json_file, found.as_dict())
    rows = [{title: row[name] for name, title in COLUMNS.items()} for row in found.rows()]
    words.say(fw.report.format_table(rows))
    for one in found.judged:
        words.say(one.sentence)
    kept = sum(one.kept is True for one in found.judged)
    tested = sum(one.kept is not None for one in found.judged)
    words.say(f"\n{kept} of {tested} promises are kept, after {found.seconds:.0f} s")
    words.wrote(json_file)
    for one in found.broken:
        typer.echo(f"fringeworks: {one.sentence}", err=True)
    if not found.passed:
        raise typer.Exit(BROKEN)
