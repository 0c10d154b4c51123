"""Options of the commands that show their results: picture, report, figures as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import fringeworks as fw
from fringeworks.cli import output

if TYPE_CHECKING:
    import typer

    from fringeworks.cli.options import Figure, HeadOption, JsonFile
    from fringeworks.files.point_table import Kind


@dataclass(frozen=True)
class ShowOptions:
    """Where results are shown."""

    figure: Figure = None
    report: Annotated[
        Path | None, typer.Option(help="Write a report: a page to hand on, .html or .pdf.")
    ] = None
    json_file: JsonFile = None
    panel: Annotated[
        str | None,
        typer.Option(help="Map that --figure draws alone, such as height, depth or sigma."),
    ] = None
    no_title: Annotated[
        bool, typer.Option("--no-title", help="Draw --figure without titles, for papers.")
    ] = False

    head: HeadOption = None

    @property
    def targets(self) -> tuple[Path | None, ...]:
        """The files."""
        return self.figure, self.report, self.json_file

    @property
    def draws(self) -> bool:
        """Whether a picture or a report is asked for, which take more than figures and points."""
        return self.figure is not None or self.report is not None

    def check(self) -> None:
        """Refuse files that cannot be written, before anything is computed for them."""
        if self.figure is None and (self.panel is not None or self.no_title):
            raise fw.InputError("--panel, --no-title: expected together with --figure")
        if self.head and self.report is None:
            raise fw.InputError("--head: expected together with --report")
        output.head_fields(self.head)
        output.check(self.figure, "figure")
        output.check(self.report, "report")

    def write(
        self,
        result: Any,
        figures: dict[str, Any],
        *,
        name: str | None = None,
        title: str = "",
        provenance: fw.Provenance | None = None,
        rig: fw.Rig | None = None,
    ) -> None:
        """Write what is asked for; a title replaces the one that the head gives a report."""
        if self.figure is not None:
            drawn = result.plot(name, panel=self.panel or "", title=not self.no_title)
            output.draw(drawn, self.figure, provenance)
        if self.report is not None:
            shown = {name: result} if name else result
            with output.target(self.report, ".html") as place:
                head = output.head_fields(self.head)
                fw.write_report(place, shown, title=title, rig=rig, head=head)
        output.write_json(self.json_file, figures)

    def write_points(
        self,
        words: output.Output,
        found: fw.Measurement | fw.PointCloud,
        rig: fw.Rig,
        out: Path | None,
        ply: str,
        *,
        name: str | None,
    ) -> None:
        """Write the points of a measurement and what else is asked for, and say what they are."""
        from fringeworks.files.points import write_points
        from fringeworks.types import PointCloud

        points = found if isinstance(found, PointCloud) else found.points
        if out is not None:
            with output.target(out, ".ply") as place:
                write_points(place, points, kind=cast("Kind", str(ply)))
        if output.is_quiet() and not self.draws and self.json_file is None:
            return  # nobody sees the figures
        from fringeworks.report.summary import summarise

        figures = summarise(points)
        self.write(found, figures, name=name, provenance=points.provenance, rig=rig)
        words.tell(points, figures)
