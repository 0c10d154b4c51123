"""What a click does with many parts, and with the proof that a scanner measures well enough.

As in ``actions``, every action runs the library with the same arguments as its Python does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fringeworks.batch.part_reports import report_links
from fringeworks.batch.report import (
    batch_charts,
    shown_values,
    value_heading,
    write_batch_report,
)
from fringeworks.batch.run import BatchResult, run_batch
from fringeworks.evaluate.acceptance.certify import certify
from fringeworks.evaluate.acceptance.positions import artefact_faults, plan_positions
from fringeworks.files.certificate import read_acceptance_test
from fringeworks.files.check_history import read_check_history
from fringeworks.files.rig import read_rig
from fringeworks.files.study_table import read_study
from fringeworks.pipeline.rig_watch import watch_rig
from fringeworks.report.kinds.certify import PLACE_COLUMNS, place_rows
from fringeworks.report.page.report import write_report
from fringeworks.serving.worker import Link
from fringeworks.studio.actions import Command, quoted
from fringeworks.studio.told import draw_charts, told
from fringeworks.studio.workspace import CHECKS, WATCH_LOG, Workspace
from fringeworks.types import InputError, Rig

MOST_ROWS = 2000
"""Parts whose rows the page shows; the summary and the report have all."""


@dataclass(frozen=True)
class RunBatch:
    """Measure and judge all captures of a folder by a recipe, and write the report."""

    folder: str
    """Folder of the captures, in the studio's folder; ``.`` for that itself."""
    recipe: str
    """Name of the recipe's file."""
    name: str
    """Of the folder of results, and of the report."""
    resume: bool = False

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Measure, judge, chart; what the page shows."""
        found = run_batch(
            space.inside(self.folder),
            space.inside(self.recipe),
            space.root / self.name,
            workers=0,
            resume=self.resume,
            progress=lambda row, _: link.progress(
                f"{row['scan']}: {row.get('verdict') or row['error']}"
            ),
        )
        report = space.root / f"{self.name}.html"
        write_batch_report(report, found, progress=link.progress)
        link.progress("drawing the control charts")
        return {
            "name": self.name,
            "folder": self.folder,
            "report": report.name,
            "counts": {kind: found.count(kind) for kind in ("pass", "fail", "undecided")}
            | {"not measured": found.failed},
            "columns": [value_heading(one) for one in found.tolerances],
            "rows": _rows(found, report),
            "more": max(0, len(found.rows) - MOST_ROWS),
            "passed over": list(found.passed_over),
            "charts": draw_charts(lambda: batch_charts(found), space.root, self.name),
        }

    def command(self, _: Any) -> Command:
        """What does the same."""
        folder, recipe, out, report = (
            quoted(word) for word in (self.folder, self.recipe, self.name, f"{self.name}.html")
        )
        resume = " --resume" if self.resume else ""
        more = ", resume=True" if self.resume else ""
        return Command(
            f"fringeworks batch {folder} --recipe {recipe} --out {out} --report {report}{resume}",
            f"found = fw.batch.run_batch({self.folder!r}, {self.recipe!r}, {self.name!r}{more})\n"
            f"fw.batch.write_batch_report({f'{self.name}.html'!r}, found)",
        )


def _rows(found: BatchResult, report: Path) -> list[dict[str, Any]]:
    """What the page shows of each part."""
    links, rows = report_links(report, found), found.rows[:MOST_ROWS]
    values = shown_values(found, found.tolerances, len(rows))
    return [
        {
            "part": str(row["scan"]),
            "verdict": str(row.get("verdict") or "not measured"),
            "values": list(shown),
            "why": str(row.get("error") or "; ".join(_whys(found, row))),
            "report": links.get(str(row["scan"]), ""),
        }
        for row, shown in zip(rows, values, strict=True)
    ]


def _whys(found: BatchResult, row: dict[str, Any]) -> Iterator[str]:
    """Why a part does not pass, for each tolerance."""
    for one in found.tolerances:
        if row.get(f"{one.name} why"):
            yield f"{one.name}: {row[f'{one.name} why']}"


def listed_positions(link: Link, space: Workspace, test: str) -> dict[str, Any]:
    """Where the artefacts of an acceptance test are to be scanned, and what they lack."""
    link.progress("planning the positions")
    known = read_acceptance_test(space.inside(test))
    rig = None if known.rig is None or isinstance(known.rig, Rig) else read_rig(known.rig)
    return {
        "verdict": "",
        "said": [
            {
                "columns": list(PLACE_COLUMNS),
                "rows": [list(row) for row in place_rows(plan_positions(known, rig))],
            },
            *({"line": f"incomplete: {fault}"} for fault in artefact_faults(known)),
        ],
        "findings": [],
        "charts": [],
    }


@dataclass(frozen=True)
class Certify:
    """Test the scanner by scans of artefacts, and write the certificate."""

    test: str
    """Name of the acceptance test's file."""
    name: str
    """Of the certificate; its suffix says the format."""

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Judge the scans."""
        found = certify(read_acceptance_test(space.inside(self.test)), progress=link.progress)
        link.progress("writing the certificate")
        write_report(space.root / self.name, {f"Certificate: {Path(self.test).stem}": found})
        return told(found, space.root, Path(self.name).stem) | {"report": self.name}

    def command(self, _: Any) -> Command:
        """What does the same."""
        title = f"Certificate: {Path(self.test).stem}"
        return Command(
            f"fringeworks certificate {quoted(self.test)} --report {quoted(self.name)}",
            f"test = fw.files.read_acceptance_test({self.test!r})\n"
            f"fw.write_report({self.name!r}, {{{title!r}: fw.evaluate.certify(test)}})",
        )


@dataclass(frozen=True)
class StudyGauge:
    """Judge the gauge by a table of trials, and write the report."""

    table: str
    """Name of a table (CSV)."""
    quantity: str
    """Its column of values."""
    width: float | None
    """Width of the tolerance, in the values' unit."""
    reference: str
    """Calibrated value, or the column that has it; empty for trials of several parts."""
    name: str
    """Of the report."""

    @property
    def _value(self) -> float | None:
        """The calibrated value; None where it is a column or not given."""
        try:
            return float(self.reference)
        except ValueError:
            return None

    @property
    def _kind(self) -> str:
        """Which study it is."""
        if not self.reference:
            return "study"
        return "linearity" if self._value is None else "type 1"

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Judge the gauge."""
        from fringeworks.evaluate import gauge_linearity, gauge_study, gauge_type1

        link.progress("judging the gauge")
        column = self.reference if self._kind == "linearity" else None
        rows = read_study(space.inside(self.table), self.quantity, calibrated=column)
        found: Any
        if rows.references is not None:
            found = gauge_linearity(rows.values, rows.references)
        elif self._value is not None:
            if self.width is None:
                raise InputError("Tolerance width: expected a number with a calibrated value")
            found = gauge_type1(rows.values, self._value, self.width)
        else:
            if not rows.parts:
                raise InputError(f"{self.table}: expected a column 'part', got none")
            found = gauge_study(rows.values, rows.parts, rows.operators, tolerance=self.width)
        link.progress("writing the report")
        write_report(space.root / self.name, {self._title: found})
        return told(found, space.root, Path(self.name).stem) | {"report": self.name}

    @property
    def _title(self) -> str:
        return f"{Path(self.table).stem}: {self.quantity}"

    def command(self, _: Any) -> Command:
        """What does the same."""
        words = f"--quantity {quoted(self.quantity)}"
        if self.width is not None and self._kind != "linearity":
            words += f" --tolerance-width {self.width:g}"
        words += f" --calibrated {quoted(self.reference)}" if self.reference else ""
        column = f", calibrated={self.reference!r}" if self._kind == "linearity" else ""
        call = {
            "linearity": "gauge_linearity(rows.values, rows.references)",
            "type 1": f"gauge_type1(rows.values, {self._value!r}, {self.width!r})",
            "study": "gauge_study(\n    rows.values, rows.parts, rows.operators, "
            f"tolerance={self.width!r}\n)",
        }[self._kind]
        return Command(
            f"fringeworks study {quoted(self.table)} {words} --report {quoted(self.name)}",
            f"rows = fw.files.read_study({self.table!r}, {self.quantity!r}{column})\n"
            f"found = fw.evaluate.{call}\n"
            f"fw.write_report({self.name!r}, {{{self._title!r}: found}})",
        )


@dataclass(frozen=True)
class WatchRig:
    """Watch by the scans of parts whether the rig has moved, and write the chart."""

    captures: tuple[str, ...]
    name: str
    """Of the report."""

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Add the scans to the log of the rig."""

        def scans() -> Iterator[tuple[str, Path]]:
            for name in self.captures:
                link.progress(name)
                yield Path(name).name, space.inside(name)

        found = watch_rig(space.rig, scans(), log=space.root / WATCH_LOG)
        write_report(space.root / self.name, {WATCH_TITLE: found})
        return told(found, space.root, Path(self.name).stem) | {"report": self.name}

    def command(self, _: Any) -> Command:
        """What does the same."""
        names = " ".join(map(quoted, self.captures))
        return Command(
            f"fringeworks rig watch {names} --rig rig.toml --watched {WATCH_LOG} "
            f"--report {quoted(self.name)}",
            f"scans = [(name.rpartition('/')[2], name) for name in {list(self.captures)!r}]\n"
            f"found = fw.rig.watch_rig('rig.toml', scans, log={WATCH_LOG!r})\n"
            f"fw.write_report({self.name!r}, {{{WATCH_TITLE!r}: found}})",
        )


WATCH_TITLE = f"Watched rig: {Path(WATCH_LOG).stem}"
"""Title of the report of a watched rig."""


@dataclass(frozen=True)
class ChartChecks:
    """Chart all checks of the rig, and write the report."""

    name: str
    """Of the report."""

    def run(self, link: Link, space: Workspace) -> dict[str, Any]:
        """Look for patterns in the checks."""
        link.progress("charting the checks")
        found = read_check_history(space.root / CHECKS)
        write_report(space.root / self.name, {CHECKS_TITLE: found})
        return told(found, space.root, Path(self.name).stem) | {"report": self.name}

    def command(self, _: Any) -> Command:
        """What does the same."""
        return Command(
            f"fringeworks rig history {CHECKS} --report {quoted(self.name)}",
            f"found = fw.files.read_check_history({CHECKS!r})\n"
            f"fw.write_report({self.name!r}, {{{CHECKS_TITLE!r}: found}})",
        )


CHECKS_TITLE = f"Checks of a rig: {Path(CHECKS).stem}"
"""Title of the report of the checks, as the command line has it."""
SERIES_ACTIONS: Sequence[type] = (RunBatch, Certify, StudyGauge, WatchRig, ChartChecks)
"""All of them."""
