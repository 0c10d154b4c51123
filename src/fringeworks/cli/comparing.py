"""``fringeworks compare``: methods side by side, on artificial scenes or on one's own pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import DenoiseOption, Figure, JsonFile, items

if TYPE_CHECKING:
    from fringeworks.evaluate.best_method import Cell


SCENE = ("object", "gamma", "noise", "bits", "fringes")
"""Columns that describe a scene."""
SECTION = "Results"


@dataclass(frozen=True)
class OwnPairs:
    """Pairs of one's own."""

    captures: Annotated[
        list[Path] | None,
        typer.Argument(help="Pairs of one's own: folders, .npz or .mat; none for scenes."),
    ] = None
    reference: Annotated[
        Path | None, typer.Option(help="Image of the reference plane; for --object.")
    ] = None
    object: Annotated[
        list[Path] | None, typer.Option(help="Image with the object; repeatable.")
    ] = None
    geometry: Annotated[
        Path | None, typer.Option(help="Calibration that `calibrate-plane` wrote; for pairs.")
    ] = None
    against: Annotated[
        str | None,
        typer.Option(help="Reference method for pairs; by default the median of the others."),
    ] = None

    @property
    def pairs(self) -> list[fw.Pair | Path] | dict[str, fw.Pair | Path]:
        """The pairs; empty where none are given."""
        if not self.object:
            if self.reference is not None:
                raise fw.InputError("--reference: expected together with --object")
            return list(self.captures or [])
        if self.captures:
            raise fw.InputError("expected either captures, or --reference and --object")
        from fringeworks.evaluate.captures import short_names

        named = zip(short_names(self.object), self.object, strict=True)
        return {name: fw.files.read_pair(self.reference, path) for name, path in named}

    @property
    def options(self) -> dict[str, Any]:
        """What else was given, as the library takes it."""
        found = {} if self.against is None else {"against": self.against}
        known = None if self.geometry is None else fw.files.read_reference_plane(self.geometry)
        return found | ({} if known is None else {"geometry": known})


@dataclass(frozen=True)
class Scenes:
    """Artificial scenes; every combination of the lists is run."""

    shape: Annotated[
        str, typer.Option(help="Artificial object: parabola, cube, …; several by commas.")
    ] = ""
    gamma: Annotated[
        str,
        typer.Option(help="Exponent of the projector's response; several by commas."),
    ] = ""
    noise: Annotated[
        str,
        typer.Option(
            help="Standard deviation of the camera's noise, counts; on the scale of 8 bit."
        ),
    ] = ""
    bits: Annotated[str, typer.Option(help="Quantisation: 0 (none), 8, 10, 12, 16.")] = ""
    fringes: Annotated[str, typer.Option(help="Periods across the frame.")] = ""
    height_mm: Annotated[
        float | None, typer.Option(help="Largest height, mm; 100, with --matrix 30.")
    ] = None
    size: Annotated[
        int | None, typer.Option(help="Side of the frames, px; 1000, with --matrix 500.")
    ] = None
    seed: Annotated[int | None, typer.Option(help="Seed of the noise; 0 by default.")] = None
    matrix: Annotated[
        bool, typer.Option("--matrix", help="Sweep all of them, and show which method is best.")
    ] = False

    @property
    def given(self) -> list[str]:
        """Names of the options that are given."""
        return [
            name.replace("_", "-")
            for name, value in vars(self).items()
            if value is not None and value is not False and value != ""
        ]

    @property
    def options(self) -> dict[str, Any]:
        """As the library takes them."""
        lists = {
            "objects": items(str, self.shape, "shape") if self.shape else None,
            "gammas": items(float, self.gamma, "gamma") if self.gamma else None,
            "noises": items(float, self.noise, "noise") if self.noise else None,
            "bits": items(int, self.bits, "bits") if self.bits else None,
            "fringes": items(float, self.fringes, "fringes") if self.fringes else None,
        }
        known = {**lists, "height_mm": self.height_mm, "size": self.size, "seed": self.seed}
        return {name: value for name, value in known.items() if value is not None}


@dataclass(frozen=True)
class Results:
    """Where the results go."""

    timing: Annotated[bool, typer.Option("--timing", help="Add a column of seconds.")] = False
    figure: Figure = None
    json_file: JsonFile = None
    csv: Annotated[Path | None, typer.Option(help="Write the table as CSV.")] = None
    markdown: Annotated[Path | None, typer.Option(help="Write the table as Markdown.")] = None

    def write(self, rows: list[dict[str, Any]], origin: fw.Provenance) -> None:
        """Write the table in every form that is asked for."""
        output.write_text(self.csv, fw.report.format_table(rows, "csv"))
        output.write_text(self.markdown, fw.report.format_table(rows, "markdown"))
        output.write_json(self.json_file, {"rows": rows, "provenance": origin.as_dict()})


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks compare --shape parabola --noise 2 --bits 8 --fringes 10,40, "
    "or fringeworks compare part/ cup/ --method windowed,fourier --figure maps.png",
)
def compare(
    own: OwnPairs,
    scenes: Scenes,
    results: Results,
    method: Annotated[
        str,
        typer.Option(help="Method, see `fringeworks methods`; several by commas, all by default."),
    ] = "",
    denoise: DenoiseOption = None,
) -> None:
    """Compare methods on artificial scenes, or on one's own pairs of frames."""
    words = output.Output(results.csv, results.markdown, results.json_file, results.figure)
    output.check(results.figure, "figure")
    options: dict[str, Any] = {} if denoise is None else {"denoise": denoise.value}
    if method:
        options["methods"] = items(str, method, "method")
    pairs = own.pairs
    if pairs:
        if scenes.given:
            raise fw.InputError(
                f"--{scenes.given[0]}: it is for artificial scenes and cannot be combined with "
                "pairs of one's own"
            )
        _on_pairs(words, pairs, {**options, **own.options}, results)
        return
    if own.against is not None or own.geometry is not None:
        name = "geometry" if own.against is None else "against"
        raise fw.InputError(f"--{name}: expected together with pairs of one's own")
    _on_scenes(words, {**options, **scenes.options}, scenes.matrix, results)


def _on_pairs(
    words: output.Output,
    pairs: list[fw.Pair | Path] | dict[str, fw.Pair | Path],
    options: dict[str, Any],
    results: Results,
) -> None:
    """Compare methods on pairs of one's own."""
    from fringeworks.evaluate.captures import rows_of_captures
    from fringeworks.types import made_by

    if results.figure is not None and output.is_stdout(results.figure) and len(pairs) > 1:
        raise fw.InputError(
            f"--figure -: expected one pair, got {len(pairs)}, which make a picture each"
        )
    with output.progress() as progress:
        found = fw.evaluate.compare_captures(pairs, progress=progress, **options)
    rows = rows_of_captures(found, timing=results.timing)
    origin = made_by("compare_captures", options={"pairs": [str(p) for p in pairs], **options})
    results.write(rows, origin)
    _say_table(words, rows)
    words.say(
        f"differences are from {found[0].against}; methods that agree may share an error, so "
        "agreement is not accuracy"
    )
    if results.figure is None:
        return
    for k, one in enumerate(found, 1):
        path = results.figure
        if len(found) > 1:
            path = path.with_name(f"{path.stem}_{k}{path.suffix}")
        output.draw(one.plot(), path, origin)
        if not output.is_stdout(path):
            words.say(f"wrote {path}, the maps of {one.name}")


def _on_scenes(
    words: output.Output, options: dict[str, Any], matrix: bool, results: Results
) -> None:
    """Compare methods on artificial scenes."""
    from fringeworks.types import made_by

    figure = results.figure
    with output.progress() as progress:
        rows = (fw.evaluate.compare_everywhere if matrix else fw.compare)(
            timing=results.timing,
            on_result=lambda row, _: progress(f"{row['object']} {row['method']}"),
            **options,
        )
    origin = made_by("compare", options={"matrix": matrix, **options})
    results.write(rows, origin)
    if not matrix:
        _say_table(words, rows)
        if figure is not None:
            output.draw(_error_bars(rows), figure, origin)
            words.wrote(figure)
        return
    cells = fw.evaluate.best_methods(rows)
    if figure is not None:
        output.draw(fw.report.best_map("Method with the lowest mean error", cells), figure, origin)
    _say_map(words, cells)
    words.wrote(figure)


def _say_table(words: output.Output, rows: Sequence[dict[str, Any]]) -> None:
    """The rows as a table that fits on a terminal, below what they have in common."""
    from fringeworks.cli.compared import common_words, shown_rows

    if common := common_words(rows):
        words.say(common)
    words.say(fw.report.format_table(shown_rows(rows)).rstrip("\n"))


def _error_bars(rows: Sequence[dict[str, Any]]) -> Any:
    """The mean absolute error of every method as bars, scenes side by side."""
    from fringeworks.cli.compared import common_words
    from fringeworks.report.figures import bars
    from fringeworks.types.numbers import limit

    methods = list(dict.fromkeys(row["method"] for row in rows))
    names = [n for n in SCENE if len({row[n] for row in rows}) > 1]
    series: dict[str, list[float]] = {}
    for row in rows:
        label = (
            ", ".join(
                f"{name} {limit(v) if isinstance(v := row[name], float) else v}" for name in names
            )
            or "mean |error|"
        )
        series.setdefault(label, []).append(row["mean_abs_error_mm"])
    return bars(f"Mean absolute error: {common_words(rows)}", methods, series)


def _say_map(words: output.Output, cells: Sequence[Cell]) -> None:
    """The winners as a table, and every scene that ``windowed`` lost, with the reason."""
    from fringeworks.evaluate.best_method import format_map

    words.say(fw.report.format_table(format_map(cells)).rstrip("\n"))
    disturbed = [cell for cell in cells if cell.disturbed]
    lost = [cell for cell in disturbed if cell.why]
    words.say(
        f"with noise or quantisation: windowed has the lowest mean error in "
        f"{len(disturbed) - len(lost)} of {len(disturbed)} scenes"
    )
    for cell in lost:
        scene = ", ".join(f"{name} {value}" for name, value in cell.scene.items())
        from fringeworks.types.numbers import number

        words.say(
            f"  {scene}: {cell.best} {number(cell.error_mm)} mm, windowed "
            f"{number(cell.windowed_mm)} mm: {cell.why}"
        )
