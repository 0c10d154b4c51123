"""``fringeworks report``: results as a page to hand on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import HeadOption

SECTION = "Results"
OUT_OF_TOLERANCE = 3
"""Exit code of results that do not keep their tolerances."""


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks report part.npz --rig rig.toml "
    "--tolerance 'median_sigma_mm<=0.05' --out part.html",
)
def report(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT...",
            help="Points, heights, coordinates, rigs, set-ups, or figures that --json wrote.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Report to write: .html or .pdf.")],
    title: Annotated[str, typer.Option(help="Title; by default the first file's name.")] = "",
    note: Annotated[
        list[str] | None, typer.Option(help="Line below the title; repeatable.")
    ] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(help="Limit on a figure, as 'median_sigma_mm<=0.05'; repeatable."),
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file of `calibrate`; the page is then smaller.")
    ] = None,
    thin: Annotated[int, typer.Option(help="Show every THIN-th column and row only.")] = 1,
    pdf: Annotated[Path | None, typer.Option(help="Write a PDF beside the page.")] = None,
    paper: Annotated[str, typer.Option(help="Paper: A4 or letter, for a PDF.")] = "A4",
    head: HeadOption = None,
) -> None:
    """Write results with their pictures, findings, tolerances and origin into one file."""
    words = output.Output(out)
    output.check(out, "report")
    fields = output.head_fields(head)
    with output.target(out, ".html") as place:
        written = fw.write_report(
            place,
            list(results),
            title=title,
            notes=note or (),
            tolerances=tolerance or (),
            rig=rig,
            every=thin,
            pdf=pdf,
            paper=paper,
            head=fields,
        )
    words.wrote(out, pdf)
    if not written.kept:
        words.say("not all tolerances are kept")
        raise typer.Exit(OUT_OF_TOLERANCE)
