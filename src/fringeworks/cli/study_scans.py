"""``fringeworks study --scan-parts``: the trials of a study, scanned one after another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.devices import DeviceOptions, opened

if TYPE_CHECKING:
    from fringeworks.evaluate.gauge_scans import Trial


@dataclass(frozen=True)
class StudyScanOptions(DeviceOptions):
    """Which trials are scanned, and by what they are measured."""

    scan_parts: Annotated[
        str | None,
        typer.Option(help="Scan the trials into the table first: names of the parts, as P1,P2,P3."),
    ] = None
    operators: Annotated[
        str | None, typer.Option(help="Names of the operators, as A,B; with --scan-parts.")
    ] = None
    trials: Annotated[
        int, typer.Option(help="Trials of each part by each operator, with --scan-parts.")
    ] = 3
    recipe: Annotated[
        Path | None, typer.Option(help="Recipe: method or rig, areas, tolerances.")
    ] = None
    plan: Annotated[
        Path | None, typer.Option("--plan", help="Plan file; by default the plan of the set-up.")
    ] = None
    rig: Annotated[Path | None, typer.Option("--rig", help="Rig file of `calibrate`.")] = None
    capture: Annotated[
        Path | None, typer.Option("--capture", help="Folder to write the frames to.")
    ] = None


def scan_table(words: output.Output, table: Path, asked: StudyScanOptions) -> None:
    """Scan the trials that the table lacks."""
    from fringeworks.evaluate.gauge_scans import scan_trials, trials_of

    if asked.scan_parts is None:
        return
    if asked.recipe is None or asked.capture is None:
        raise fw.InputError("--scan-parts: expected together with --recipe and --capture")
    recipe = fw.files.read_recipe(asked.recipe)
    if asked.rig is not None:
        recipe = replace(recipe, rig=fw.files.read_rig(asked.rig))
    trials = trials_of(_names(asked.scan_parts), _names(asked.operators or ""), asked.trials)
    folder = asked.capture
    with opened(asked, asked.plan) as bench:

        def take(trial: Trial) -> Path:
            who = f"{trial.operator}: " if trial.operator else ""
            typer.prompt(
                f"{who}place {trial.part}, trial {trial.number}, then Enter",
                default="",
                show_default=False,
            )
            place = folder / trial.name
            with output.progress(bench.plan.pictures) as step:
                # Frames of a trial that the table lacks are those of an interrupted one.
                fw.scan.take(bench, place, fw.scan.Take(force=place.exists()), progress=step)
            return place

        words.wrote(scan_trials(table, trials, recipe, take))


def _names(text: str) -> list[str]:
    """Names in a list with commas."""
    return [one.strip() for one in text.split(",")] if text.strip() else []
