"""``fringeworks compare``: methods side by side, and which is best where."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer

from fringeworks.cli.common import (
    DenoiserName,
    Item,
    JsonFile,
    app,
    denoiser_of,
    list_of,
    show_progress,
    write_json,
)
from fringeworks.evaluate.best_method import (
    FRINGES,
    GAMMAS,
    HEIGHT_MM,
    NOISES,
    OBJECTS,
    SIZE,
    Cell,
    best_methods,
    format_map,
)
from fringeworks.evaluate.errors import compare
from fringeworks.files.atomic import write_text
from fringeworks.pair.analyse import get_method, methods
from fringeworks.report.tables import format_table
from fringeworks.types import InputError


@app.command("compare")
def compare_methods(
    object: Annotated[str, typer.Option(help="Objects, separated by commas.")] = "",
    names: Annotated[
        str, typer.Option("--methods", help="Methods, separated by commas; all by default.")
    ] = "",
    gamma: Annotated[str, typer.Option(help="Response exponents.")] = "",
    noise: Annotated[str, typer.Option(help="Noise, counts of 8 bit.")] = "",
    bits: Annotated[str, typer.Option(help="Quantisation: 0, 8, 10, 12, 16.")] = "",
    fringes: Annotated[str, typer.Option(help="Periods across the frame.")] = "",
    height_mm: Annotated[
        float | None, typer.Option(help="Largest height, mm; 100, with --matrix 30.")
    ] = None,
    size: Annotated[int | None, typer.Option(help="Side of the frames, px; 1000, 500.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    denoise: Annotated[DenoiserName | None, typer.Option(help="Denoise both frames.")] = None,
    matrix: Annotated[
        bool, typer.Option("--matrix", help="Sweep objects, γ, noise and fringes; show the best.")
    ] = False,
    figure: Annotated[
        Path | None, typer.Option(help="Picture of the map, with --matrix (PNG).")
    ] = None,
    json_file: JsonFile = None,
    csv: Annotated[Path | None, typer.Option(help="Write the table as CSV.")] = None,
    markdown: Annotated[Path | None, typer.Option(help="Write the table as Markdown.")] = None,
) -> None:
    """Compare methods on the standard scene; lists are combined, each with each."""
    if figure is not None and not matrix:
        raise InputError("--figure: expected --matrix with it, got none")
    chosen = list_of(str, names, "methods") if names else list(methods())
    for name in chosen:
        get_method(name)

    def choose(
        kind: Callable[[str], Item], text: str, name: str, plain: Item, sweep: Sequence[Item]
    ) -> Sequence[Item]:
        if text:
            return list_of(kind, text, name)
        return sweep if matrix else [plain]

    # With --matrix, quantisation of 8 bit comes with the noise unless asked for otherwise.
    noises = choose(float, noise, "noise", 0.0, NOISES)
    depths = list_of(int, bits, "bits") if bits else ([0, 8] if matrix else [0])
    with show_progress() as progress:
        rows = compare(
            choose(str, object, "object", "parabola", OBJECTS),
            chosen,
            gammas=choose(float, gamma, "gamma", 1.0, GAMMAS),
            noises=noises,
            bits=depths,
            fringes=choose(float, fringes, "fringes", 10.0, FRINGES),
            height_mm=height_mm if height_mm is not None else (HEIGHT_MM if matrix else 100.0),
            size=size if size is not None else (SIZE if matrix else 1000),
            seed=seed,
            denoise=denoiser_of(denoise),
            on_result=lambda row, _: progress(f"{row['object']} {row['method']}"),
        )
    if csv is not None:
        write_text(csv, format_table(rows, "csv"))
    if markdown is not None:
        write_text(markdown, format_table(rows, "markdown"))
    write_json(json_file, format_table(rows, "json"))
    if matrix:
        _show_map(best_methods(rows), figure, quiet=str(json_file) == "-")
    elif str(json_file) != "-":
        typer.echo(format_table(rows), nl=False)


def _show_map(cells: Sequence[Cell], figure: Path | None, *, quiet: bool) -> None:
    """The winners as a table, and every scene that ``windowed`` lost, with the reason."""
    if figure is not None:
        from fringeworks.report import figures

        figures.save(figures.best_map("Method with the lowest mean error", cells), figure)
    if quiet:
        return
    typer.echo(format_table(format_map(cells)), nl=False)
    disturbed = [cell for cell in cells if cell.disturbed]
    lost = [cell for cell in disturbed if cell.why]
    typer.echo(
        f"with noise or quantisation: windowed has the lowest mean error in "
        f"{len(disturbed) - len(lost)} of {len(disturbed)} scenes"
    )
    for cell in lost:
        scene = ", ".join(f"{name} {value}" for name, value in cell.scene.items())
        typer.echo(
            f"  {scene}: {cell.best} {cell.error_mm:.3g} mm, windowed {cell.windowed_mm:.3g} mm: "
            f"{cell.why}"
        )
    if figure is not None:
        typer.echo(f"see {figure}")
