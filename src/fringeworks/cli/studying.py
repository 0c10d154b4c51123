"""``fringeworks study``: is the gauge good enough for the tolerance?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.inspecting import EXIT_CODES
from fringeworks.cli.options import HeadOption, JsonFile
from fringeworks.cli.study_scans import StudyScanOptions, scan_table

SECTION = "Results"


@dataclass(frozen=True)
class TableOptions:
    """Where the table has what."""

    quantity: Annotated[str, typer.Option(help="Column of the values.")] = "value"
    part: Annotated[str | None, typer.Option(help="Column of the parts; by default part.")] = None
    operator: Annotated[
        str | None, typer.Option(help="Column of the operators; by default operator, if any.")
    ] = None
    names: Annotated[
        str | None,
        typer.Option(help="What names of scans tell, as '{part}_{operator}_{trial}'."),
    ] = None
    calibrated: Annotated[
        str | None,
        typer.Option(
            help="Calibrated value of the reference, for Cg and Cgk; or a column of them, for "
            "linearity."
        ),
    ] = None
    calibrated_sigma: Annotated[
        float | None,
        typer.Option(help="Standard uncertainty of the calibrated value, U / k; for Cg and Cgk."),
    ] = None


@dataclass(frozen=True)
class LimitOptions:
    """What the gauge is compared with."""

    tolerance_width: Annotated[
        float | None,
        typer.Option(help="Largest minus smallest allowed value, in the values' unit."),
    ] = None
    spread: Annotated[
        float | None,
        typer.Option(help="Standard deviations that the tolerance is compared with; by default 6."),
    ] = None
    share: Annotated[
        float | None,
        typer.Option(help="Share of the tolerance that Cg and Cgk count; by default 0.2."),
    ] = None


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks study trials.csv --quantity length --tolerance-width 0.2 "
    "--report study.html",
)
def study(
    table: Annotated[Path, typer.Argument(help="Table (CSV), or the folder of a batch's results.")],
    *,
    where: TableOptions,
    limits: LimitOptions,
    scans: StudyScanOptions,
    report: Annotated[
        Path | None, typer.Option(help="Write a report: a page to hand on, .html or .pdf.")
    ] = None,
    head: HeadOption = None,
    json_file: JsonFile = None,
) -> None:
    """Judge a gauge: repeatability and reproducibility, Cg and Cgk, or linearity.

    With --scan-parts, the trials that the table lacks are scanned first.

    Exit code 0 pass, 3 fail, 4 undecided.
    """
    words = output.Output(report, json_file)
    output.check(report, "report")
    fields = output.head_fields(head)
    scan_table(words, table, scans)
    found = _studied(_summary(table), where, limits)
    figures = fw.report.summarise(found)
    words.tell(found, figures)
    if report is not None:
        with output.target(report, ".html") as place:
            fw.write_report(place, {f"{table.stem}: {where.quantity}": found}, head=fields)
    output.write_json(json_file, figures)
    words.wrote(report, json_file)
    raise typer.Exit(EXIT_CODES[found.verdict])


def _summary(table: Path) -> Path:
    """The table of a batch's folder; any other path as it is."""
    from fringeworks.files.limits import is_folder

    if not is_folder(table):
        return table
    from fringeworks.batch.store import Store

    return Store(table).summary


def _studied(table: Path, where: TableOptions, limits: LimitOptions) -> Any:
    """The study that the options ask for."""
    from fringeworks.files.study_table import read_study

    value = _number(where.calibrated)
    _check_options(where, limits, value)
    rows = read_study(
        table,
        where.quantity,
        part=where.part,
        operator=where.operator,
        names=where.names,
        calibrated=where.calibrated if value is None else None,
    )
    if rows.references is not None:
        return fw.evaluate.gauge_linearity(rows.values, rows.references)
    spread = {} if limits.spread is None else {"spread": limits.spread}
    if value is not None and limits.tolerance_width is not None:
        _check_one(rows.parts, "part")
        _check_one(rows.operators or (), "operator")
        share = {} if limits.share is None else {"share": limits.share}
        sigma = where.calibrated_sigma or 0.0
        width = limits.tolerance_width
        return fw.evaluate.gauge_type1(
            rows.values, value, width, reference_sigma=sigma, **share, **spread
        )
    if not rows.parts:
        raise fw.FileProblem(
            f"{table}: expected a column 'part', got none; name it by --part, or give --names for "
            "the names of scans, or --calibrated for one reference"
        )
    return fw.evaluate.gauge_study(
        rows.values, rows.parts, rows.operators, tolerance=limits.tolerance_width, **spread
    )


def _check_options(where: TableOptions, limits: LimitOptions, value: float | None) -> None:
    """Refuse options that the study would not use."""
    if value is None:
        given = {"--calibrated-sigma": where.calibrated_sigma, "--share": limits.share}
        for name, one in given.items():
            if one is not None:
                raise fw.InputError(f"{name}: expected together with a number at --calibrated")
    elif limits.tolerance_width is None:
        raise fw.InputError("--calibrated: expected together with --tolerance-width")
    if value is None and where.calibrated is not None:
        unused = {"--tolerance-width": limits.tolerance_width, "--spread": limits.spread}
        for name, one in unused.items():
            if one is not None:
                raise fw.InputError(f"{name} cannot be combined with a column at --calibrated")


def _check_one(labels: tuple[str, ...], what: str) -> None:
    """Refuse several parts or operators as trials of one reference."""
    if len(set(labels)) > 1:
        raise fw.InputError(
            f"--calibrated: expected trials of one {what}, got {len(set(labels))}; give the table "
            "of the reference alone, or name a column of calibrated values"
        )


def _number(text: str | None) -> float | None:
    """A number, or None for the name of a column."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
