"""``fringeworks scan --until``: captures until the tolerances of a recipe are decided."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output

if TYPE_CHECKING:
    from fringeworks.cli.options import Ply
    from fringeworks.cli.showing import ShowOptions

EXIT_CODES = {"pass": 0, "fail": 3, "undecided": 4}
"""As those of ``inspect``."""


@dataclass(frozen=True)
class UntilOptions:
    """When a scan has enough frames."""

    until: Annotated[
        Path | None,
        typer.Option(
            "--until",
            help="Recipe: captures are taken until its tolerances are decided; exit code 0 pass, "
            "3 fail, 4 undecided.",
        ),
    ] = None
    most_captures: Annotated[
        int, typer.Option(min=1, max=64, help="Largest number of captures, with --until.")
    ] = 8


def scan_part(
    words: output.Output,
    rig: Path,
    out: Path,
    folder: Path,
    devices: AbstractContextManager[fw.scan.Bench],
    taking: dict[str, Any],
    until: UntilOptions,
    ply: Ply,
    show: ShowOptions,
) -> None:
    """Scan a part until its tolerances are decided, write its points, and tell the verdicts."""
    output.check(out, "points", content=ply.value)
    show.check()
    assert until.until is not None
    known = fw.files.read_rig(rig)
    recipe = replace(fw.files.read_recipe(until.until), rig=known)

    from fringeworks.types.numbers import number  # when it is used

    def tell(step: fw.evaluate.ScanStep) -> None:
        if step.kind == "stop":
            words.say(f"enough: {step.why}")
        else:
            times = "" if step.factor == 1.0 else f" with {number(step.factor)} times the exposure"
            words.say(f"{step.kind}: {step.captures} × all frames{times}: {step.why}")

    with devices as bench, output.progress() as progress:
        how = fw.scan.Take(**taking)
        with fw.scan.capture_series(bench, folder, how, progress=progress) as series:
            found = fw.evaluate.scan_until(
                series.take,
                recipe,
                most_captures=until.most_captures,
                exposures=series.exposures,
                overhead=series.overhead,
                progress=tell,
            )
    show.write_points(words, found.measurement, known, out, ply, name=folder.name)
    words.tell(found.inspection, fw.report.summarise(found.inspection))
    words.found(found.findings[:1] if found.inspection.verdict == "undecided" else ())
    words.say(f"{found.captures} captures, {found.frames} frames")
    words.wrote(folder, out, *show.targets)
    raise typer.Exit(EXIT_CODES[found.inspection.verdict])
