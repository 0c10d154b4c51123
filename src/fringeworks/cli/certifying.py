"""``fringeworks certificate``: the acceptance test of a scanner after VDI/VDE 2634."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.inspecting import EXIT_CODES
from fringeworks.cli.options import HeadOption, JsonFile

SECTION = "Results"


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks certificate test.toml --report certificate.pdf",
)
def certificate(
    test: Annotated[
        Path, typer.Argument(help="Acceptance test (TOML): artefacts, volume, limits, scans.")
    ],
    positions: Annotated[
        bool, typer.Option("--positions", help="List the positions to scan, and end.")
    ] = False,
    report: Annotated[
        Path | None, typer.Option(help="Write a report: a page to hand on, .html or .pdf.")
    ] = None,
    paper: Annotated[str, typer.Option(help="Paper: A4 or letter, for a PDF.")] = "A4",
    head: HeadOption = None,
    json_file: JsonFile = None,
) -> None:
    """Test a scanner by scans of a ball bar and a plane (VDI/VDE 2634).

    Exit code 0 pass, 3 fail, 4 undecided.
    """
    words = output.Output(report, json_file)
    output.check(report, "report")
    fields = output.head_fields(head)
    known = fw.files.read_acceptance_test(test)
    if positions:
        if report is not None or json_file is not None:
            raise fw.InputError("--positions cannot be combined with --report or --json")
        _list(words, known)
        return
    with output.progress() as progress:
        found = fw.evaluate.certify(known, progress=progress)
    figures = fw.report.summarise(found)
    words.tell(found, figures)
    if report is not None:
        with output.target(report, ".html") as place:
            fw.write_report(place, {f"Certificate: {test.stem}": found}, paper=paper, head=fields)
    output.write_json(json_file, figures)
    words.wrote(report, json_file)
    raise typer.Exit(EXIT_CODES[found.verdict])


def _list(words: output.Output, test: fw.evaluate.AcceptanceTest) -> None:
    """Tell the planned positions, and what the artefacts lack."""
    from fringeworks.evaluate.acceptance.positions import artefact_faults
    from fringeworks.files.rig import read_rig
    from fringeworks.report.kinds.certify import PLACE_COLUMNS, place_rows

    rig = None if test.rig is None or isinstance(test.rig, fw.Rig) else read_rig(test.rig)
    planned = fw.evaluate.plan_positions(test, rig)
    words.table(PLACE_COLUMNS, place_rows(planned))
    for fault in artefact_faults(test):
        words.say(f"incomplete: {fault}")
