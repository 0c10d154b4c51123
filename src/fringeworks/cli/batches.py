"""``fringeworks batch | sequence``: many captures, or a scene that moves, by one recipe."""

from __future__ import annotations

import time
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import HeadOption

SECTION = "Results"
NOT_MEASURED = 5
"""Exit code where scans could not be measured."""
POLL_S = 1.0
"""Interval at which a watched folder is looked at, s."""


class PartReports(StrEnum):
    """Parts with a report of their own."""

    all = "all"
    failed = "failed"
    none = "none"


SHOWN = 10
"""Problems that are listed; the summary has all."""


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks batch line/ --recipe recipe.toml --out results.zarr",
)
def batch(
    source: Annotated[
        str,
        typer.Argument(help="Folder of captures, Zarr array (scan, frame, row, column), address."),
    ],
    recipe: Annotated[Path, typer.Option(help="Recipe: method or rig, areas, tolerances.")],
    out: Annotated[
        Path, typer.Option("--out", help="Folder of the results; NAME.zarr holds Zarr groups.")
    ],
    workers: Annotated[
        int | None,
        typer.Option(help="Processes of this machine; 0 for none, by default one a core."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(help="Dask scheduler, as tcp://10.0.0.5:8786; 'local' starts one here."),
    ] = None,
    memory_gb: Annotated[
        float, typer.Option(help="Memory that a worker of this machine may use, GB.")
    ] = 2.0,
    watch: Annotated[
        bool, typer.Option("--watch", help="Go on with captures that come, until Ctrl-C.")
    ] = False,
    report: Annotated[
        Path | None,
        typer.Option(help="Write a report: control charts and what to look at, .html or .pdf."),
    ] = None,
    title: Annotated[str, typer.Option(help="Title; by default the folder's name.")] = "",
    part_reports: Annotated[
        PartReports,
        typer.Option(help="Parts with a report of their own, in the folder REPORT-parts."),
    ] = PartReports.all,
    head: HeadOption = None,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Go on where an interrupted run ended: measure what is missing."
        ),
    ] = False,
    excel: Annotated[
        bool,
        typer.Option("--excel", help="Mark the summary (CSV) as UTF-8, so that Excel reads σ, µ."),
    ] = False,
) -> None:
    """Measure and judge many captures; exit code 0 all pass, 3 some fail, 4 undecided, 5 errors."""
    words = output.Output()
    output.check(report, "report")
    fields = output.head_fields(head)
    with output.progress(None if watch else len(fw.batch.find_scans(source))) as show:

        def told(row: dict[str, Any], _: int) -> None:
            show(f"{row['scan']}: {row.get('verdict') or row['error']}")

        def started(engine: Any) -> None:
            if engine.dashboard:
                words.say(f"workers: {engine.dashboard}")

        found = fw.batch.run_batch(
            source,
            recipe,
            out,
            workers=workers,
            scheduler=scheduler,
            memory_gb=memory_gb,
            resume=resume,
            excel=excel,
            watch=_wait if watch else None,
            progress=told,
            started=started,
        )
    _say_counts(words, found)
    if report is not None:
        with output.progress(len(found.rows)) as show:
            kind: Any = part_reports.value
            fw.batch.write_batch_report(
                report, found, title=title, parts=kind, head=fields, progress=show
            )
    words.wrote(out, found.summary, report)
    code = 3 if found.count("fail") else 4 if found.count("undecided") else 0
    raise typer.Exit(NOT_MEASURED if found.failed else code)


def _say_counts(words: output.Output, found: fw.batch.BatchResult) -> None:
    """What could not be measured, and how many parts have each verdict."""
    problems = [row for row in found.rows if row.get("error")]
    for row in problems[:SHOWN]:
        words.say(f"{row['scan']}: {row['error']}")
    if len(problems) > SHOWN:
        words.say(f"… and {len(problems) - SHOWN} more, see the summary")
    counts = {name: found.count(name) for name in ("pass", "fail", "undecided")}
    told_counts = ", ".join(f"{count} {name}" for name, count in counts.items())
    words.say(f"{len(found.rows)} scans: {told_counts}, {found.failed} not measured")
    _say_passed_over(words, found.passed_over)


def _say_passed_over(words: output.Output, folders: Sequence[str]) -> None:
    """Name the folders that hold no capture."""
    if folders:
        more = len(folders) - SHOWN
        others = f" and {more} more" if more > 0 else ""
        count = f"{len(folders)} folder{'s hold' if len(folders) > 1 else ' holds'} no capture"
        words.say(f"{count}: {', '.join(folders[:SHOWN])}{others}")


def _wait() -> bool:
    """Wait for further captures; false when the user ends it."""
    try:
        time.sleep(POLL_S)
    except KeyboardInterrupt:
        return False
    return True


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks sequence frames/ --recipe recipe.toml --out wing.zarr --fps 500",
)
def sequence(
    source: Annotated[
        Path, typer.Argument(help="Frames: folder of images, TIFF, .npy or Zarr array.")
    ],
    recipe: Annotated[Path, typer.Option(help="Recipe: rig, plan, areas to follow.")],
    out: Annotated[Path, typer.Option("--out", help="New folder of the moments: NAME.zarr.")],
    fps: Annotated[
        float | None, typer.Option(help="Frames per second; otherwise times are in frames.")
    ] = None,
    every: Annotated[int, typer.Option(help="Frames from one moment to the next.", min=1)] = 1,
    maps: Annotated[
        bool, typer.Option("--maps/--areas-only", help="Store the points of all pixels.")
    ] = True,
    report: Annotated[
        Path | None, typer.Option(help="Write a report: displacement and spectra, .html or .pdf.")
    ] = None,
) -> None:
    """Measure a scene that moves, frame by frame, and how its areas drift and vibrate."""
    words = output.Output()
    from fringeworks.batch.sequence import moments_of
    from fringeworks.batch.sequence_report import motion_rows
    from fringeworks.files.sequence import read_sequence

    output.check(report, "report")
    frames, known = read_sequence(source), fw.files.read_recipe(recipe)
    with output.progress(max(1, moments_of(frames, known, every))) as show:
        found = fw.batch.run_sequence(
            frames,
            known,
            out,
            rate_hz=fps,
            every=every,
            maps=maps,
            progress=lambda done, _: show(f"moment {done}"),
        )
    rows = motion_rows(found)
    if rows:
        columns = list(rows[0])
        words.table(columns, [[str(row[name]) for name in columns] for row in rows])
    words.say(f"{found.moments} moments")
    if report is not None:
        fw.batch.write_sequence_report(report, found)
    words.wrote(found.folder, found.table, report)
