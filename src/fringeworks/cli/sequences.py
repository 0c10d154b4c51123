"""``fringeworks sequence``: scenes that move."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app

SECTION = "Results"


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
    frames, known = read_sequence(source), fw.read_recipe(recipe)
    with output.progress(max(1, moments_of(frames, known, every))) as show:
        found = fw.run_sequence(
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
        fw.write_sequence_report(report, found)
    words.wrote(found.folder, found.table, report)
