"""``fringeworks evaluate | compare``: errors of what was measured, and of the methods."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import DenoiseOption, Figure, JsonFile, items
from fringeworks.cli.words import say_forms

SECTION = "Results"


class BodyName(StrEnum):
    """Bodies that are fitted to points."""

    plane = "plane"
    sphere = "sphere"
    cylinder = "cylinder"


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks evaluate ball.ply --fit sphere --diameter-mm 50",
)
def evaluate(
    points: Annotated[
        Path,
        typer.Argument(
            help="Points (.ply, .xyz, .npz), or heights in mm (.tif, .npz, .x3p, .gsf)."
        ),
    ],
    fit: Annotated[BodyName, typer.Option(help="Body that is fitted.")],
    diameter_mm: Annotated[
        float | None, typer.Option(help="Calibrated diameter, mm: probing error size PS.")
    ] = None,
    count: Annotated[int, typer.Option(help="Spheres to find; 2 for their spacing.")] = 1,
    spacing_mm: Annotated[
        float | None, typer.Option(help="Calibrated distance of two spheres, mm: error SD.")
    ] = None,
    within: Annotated[
        str | None,
        typer.Option(help="Region: points in a ball, x,y,z,radius in mm; all by default."),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Fit a body to points: form and size errors in the terms of VDI/VDE 2634."""
    ball: Any = None if within is None else tuple(items(float, within, "within"))
    found = fw.evaluate_form(
        points,
        fit.value,
        diameter_mm=diameter_mm,
        count=count,
        spacing_mm=spacing_mm,
        within=ball,
    )
    figures = fw.summarise(found)
    output.write_json(json_file, figures)
    say_forms(output.Output(json_file), figures)


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks compare --shape parabola --noise 2 --bits 8 --fringes 10,40",
)
def compare(
    shape: Annotated[str, typer.Option(help="Artificial objects, separated by commas.")] = "",
    method: Annotated[str, typer.Option(help="Methods, separated by commas; all by default.")] = "",
    gamma: Annotated[str, typer.Option(help="Exponents of the response.")] = "",
    noise: Annotated[
        str, typer.Option(help="Standard deviations of the camera's noise, counts of 8 bit.")
    ] = "",
    bits: Annotated[str, typer.Option(help="Quantisation: 0 (none), 8, 10, 12, 16.")] = "",
    fringes: Annotated[str, typer.Option(help="Periods across the frame.")] = "",
    height_mm: Annotated[
        float | None, typer.Option(help="Largest height, mm; 100, with --matrix 30.")
    ] = None,
    size: Annotated[
        int | None, typer.Option(help="Side of the frames, px; 1000, with --matrix 500.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    denoise: DenoiseOption = None,
    timing: Annotated[bool, typer.Option("--timing", help="Add a column of seconds.")] = False,
    matrix: Annotated[
        bool, typer.Option("--matrix", help="Sweep all of them, and show which method is best.")
    ] = False,
    figure: Figure = None,
    json_file: JsonFile = None,
    csv: Annotated[Path | None, typer.Option(help="Write the table as CSV.")] = None,
    markdown: Annotated[Path | None, typer.Option(help="Write the table as Markdown.")] = None,
) -> None:
    """Compare methods on artificial objects; every combination of the lists is run."""
    words = output.Output(csv, markdown, json_file, figure)
    if figure is not None and not matrix:
        raise fw.InputError("--figure: expected together with --matrix")
    given: dict[str, Any] = {
        "objects": items(str, shape, "shape") if shape else None,
        "methods": items(str, method, "method") if method else None,
        "gammas": items(float, gamma, "gamma") if gamma else None,
        "noises": items(float, noise, "noise") if noise else None,
        "bits": items(int, bits, "bits") if bits else None,
        "fringes": items(float, fringes, "fringes") if fringes else None,
        "height_mm": height_mm,
        "size": size,
    }
    options = {name: value for name, value in given.items() if value is not None}
    options |= {"seed": seed, "timing": timing}
    if denoise is not None:
        options["denoise"] = denoise.value
    with output.progress() as progress:
        rows = (fw.compare_everywhere if matrix else fw.compare)(
            **options, on_result=lambda row, _: progress(f"{row['object']} {row['method']}")
        )
    origin = fw.made_by("compare", options={"matrix": matrix, **options})
    output.write_text(csv, fw.format_table(rows, "csv"))
    output.write_text(markdown, fw.format_table(rows, "markdown"))
    output.write_json(json_file, {"rows": rows, "provenance": origin.as_dict()})
    if not matrix:
        words.say(fw.format_table(rows).rstrip("\n"))
        return
    cells = fw.best_methods(rows)
    if figure is not None:
        output.draw(fw.best_map("Method with the lowest mean error", cells), figure, origin)
    _say_map(words, cells)
    words.wrote(figure)


def _say_map(words: output.Output, cells: Sequence[fw.Cell]) -> None:
    """The winners as a table, and every scene that ``windowed`` lost, with the reason."""
    words.say(fw.format_table(fw.format_map(cells)).rstrip("\n"))
    disturbed = [cell for cell in cells if cell.disturbed]
    lost = [cell for cell in disturbed if cell.why]
    words.say(
        f"with noise or quantisation: windowed has the lowest mean error in "
        f"{len(disturbed) - len(lost)} of {len(disturbed)} scenes"
    )
    for cell in lost:
        scene = ", ".join(f"{name} {value}" for name, value in cell.scene.items())
        words.say(
            f"  {scene}: {cell.best} {cell.error_mm:.3g} mm, windowed {cell.windowed_mm:.3g} mm: "
            f"{cell.why}"
        )
