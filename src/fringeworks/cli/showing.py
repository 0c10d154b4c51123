"""Options of the commands that show their results: picture, report, figures as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.options import Figure, JsonFile


@dataclass(frozen=True)
class ShowOptions:
    """Where results are shown."""

    figure: Figure = None
    report: Annotated[
        Path | None, typer.Option(help="Write a report to hand on: .html or .pdf.")
    ] = None
    json_file: JsonFile = None

    @property
    def targets(self) -> tuple[Path | None, ...]:
        """The files."""
        return self.figure, self.report, self.json_file

    def check(self) -> None:
        """Refuse files that cannot be written, before anything is computed for them."""
        from fringeworks.report.figures import check_figure_target
        from fringeworks.report.page.report import check_report_target

        output.check(self.figure, check_figure_target)
        output.check(self.report, check_report_target)

    def write(
        self,
        result: Any,
        figures: dict[str, Any],
        *,
        name: str | None = None,
        provenance: fw.Provenance | None = None,
        rig: fw.Rig | None = None,
    ) -> None:
        """Write what is asked for."""
        if self.figure is not None:
            output.draw(result.plot(name), self.figure, provenance)
        if self.report is not None:
            shown = {name: result} if name else result
            with output.target(self.report, ".html") as place:
                fw.write_report(place, shown, rig=rig)
        output.write_json(self.json_file, figures)
