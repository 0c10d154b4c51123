"""``fringeworks deviation``: a measured part against its model."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.inspecting import EXIT_CODES
from fringeworks.cli.showing import ShowOptions

SECTION = "Results"


class AlignName(StrEnum):
    """How the part is brought to the model."""

    best_fit = "best-fit"
    points = "datum-points"
    planes = "datum-planes"
    none = "none"


@dataclass(frozen=True)
class AlignOptions:
    """How the part is brought to the model."""

    align: Annotated[
        AlignName, typer.Option(help="Way of alignment; none: the coordinates are the model's.")
    ] = AlignName.best_fit
    datum_point: Annotated[
        list[str] | None,
        typer.Option(
            help="Datum point: x:y:z on the part and X:Y:Z on the model, mm, as x:y:z:X:Y:Z; "
            "repeatable. For best-fit, three or more are the start."
        ),
    ] = None
    datum_plane: Annotated[
        list[str] | None,
        typer.Option(
            help="Datum plane: its box of pixels and a point on it in the model, mm, as "
            "column:row:column:row:X:Y:Z; three, the primary one first."
        ),
    ] = None
    fit_box: Annotated[
        str | None,
        typer.Option(help="Box of pixels that is fitted, as column:row:column:row."),
    ] = None

    @property
    def way(
        self,
    ) -> (
        fw.evaluate.BestFit
        | fw.evaluate.DatumPoints
        | fw.evaluate.DatumPlanes
        | fw.evaluate.KnownPose
    ):
        """The way of alignment, as the library takes it."""
        given = {
            "--datum-point": self.datum_point,
            "--datum-plane": self.datum_plane,
            "--fit-box": self.fit_box,
        }
        uses = {
            AlignName.best_fit: ("--datum-point", "--fit-box"),
            AlignName.points: ("--datum-point",),
            AlignName.planes: ("--datum-plane",),
            AlignName.none: (),
        }[self.align]
        for name, value in given.items():
            if value and name not in uses:
                raise fw.InputError(f"{name} cannot be combined with --align {self.align.value}")
        import numpy as np  # when it is used: the command line loads without it

        if self.align is AlignName.none:
            return fw.evaluate.KnownPose(np.eye(4))
        if self.align is AlignName.planes:
            return _planes(self.datum_plane or [])
        pairs = None
        if self.datum_point or self.align is AlignName.points:
            table = np.array(
                [numbers(p, 6, "--datum-point") for p in self.datum_point or []]
            ).reshape(-1, 6)
            pairs = fw.evaluate.DatumPoints(table[:, :3], table[:, 3:])
        if self.align is AlignName.points and pairs is not None:
            return pairs
        return fw.evaluate.BestFit(
            pairs, None if self.fit_box is None else _box(self.fit_box, "--fit-box")
        )


def numbers(text: str, count: int, option: str) -> list[float]:
    """The numbers of an option, with ':' between; a refusal names the option."""
    try:
        found = [float(part) for part in text.split(":")]
    except ValueError:
        found = []
    if len(found) != count:
        raise fw.InputError(f"{option}: expected {count} numbers with ':' between, got {text!r}")
    return found


def _box(text: str, option: str) -> fw.evaluate.Area:
    left, top, right, bottom = (round(v) for v in numbers(text, 4, option))
    return fw.evaluate.Area(box=(left, top, right, bottom))


def _planes(texts: list[str]) -> fw.evaluate.DatumPlanes:
    import numpy as np  # as above

    if len(texts) != 3:
        raise fw.InputError(f"--datum-plane: expected three datum planes, got {len(texts)}")
    table = [numbers(text, 7, "--datum-plane") for text in texts]
    one, two, three = (_box(":".join(f"{v:g}" for v in row[:4]), "--datum-plane") for row in table)
    return fw.evaluate.DatumPlanes((one, two, three), np.array([row[4:] for row in table]))


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks deviation part.npz --model part.stl --rig rig.toml "
    "--tolerance-mm 0.1 --figure deviation.png",
)
def deviation(
    part: Annotated[Path, typer.Argument(help="Measured part: .npz, .ply or .xyz.")],
    model: Annotated[
        Path, typer.Option(help="Drawing: .stl, .ply, .obj or .off in mm, .step or .iges.")
    ],
    *,
    how: AlignOptions,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file of `calibrate`; without it, σ is too large.")
    ] = None,
    reach_mm: Annotated[
        float | None,
        typer.Option(
            help="Points farther from the model are left out, mm; by default 5 % of its size."
        ),
    ] = None,
    tolerance_mm: Annotated[
        float | None, typer.Option(help="Largest deviation that is allowed to either side, mm.")
    ] = None,
    scale: Annotated[float, typer.Option(help="mm per unit of the drawing; inches: 25.4.")] = 1.0,
    face: Annotated[
        list[str] | None,
        typer.Option(help="Name or number of a face of the drawing; only its points; repeatable."),
    ] = None,
    show: ShowOptions,
) -> None:
    """Measure how far a part lies from its drawing; judged, exit code 3 fail, 4 undecided."""
    words = output.Output(*show.targets)
    show.check()
    way = how.way
    known = None if rig is None else fw.files.read_rig(rig)
    with output.progress() as progress:
        found = fw.deviation(
            part,
            fw.files.read_model(model, scale=scale),
            align=way,
            rig=known,
            reach_mm=reach_mm,
            tolerance_mm=tolerance_mm,
            faces=face or (),
            progress=progress,
        )
    from fringeworks.evaluate.inspect import judge_deviation

    figures = fw.report.summarise(found)
    check = judge_deviation(found, known)
    if check is not None:
        figures |= {"verdict": check.verdict, "why": check.why, "largest_kept_mm": check.value}
    show.write(found, figures, name=part.name, provenance=found.provenance, rig=known)
    words.tell(found, figures)
    words.wrote(show.figure, show.report)
    if check is not None:
        raise typer.Exit(EXIT_CODES[check.verdict])
