"""``fringeworks simulate | paper | demo | methods``: scenes, and what the project shows of itself.

Commands that draw import matplotlib themselves: it takes longer than most other commands run.
"""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from fringeworks.cli.common import AxisName, JsonFile, Output, app, show_progress, write_json
from fringeworks.files.atomic import make_folder
from fringeworks.files.pair import write_pair
from fringeworks.pair.analyse import methods
from fringeworks.report.tables import format_table
from fringeworks.simulate.scene import standard_scene
from fringeworks.types import InputError


@app.command()
def simulate(
    out: Output,
    object: Annotated[str, typer.Option(help="parabola, cube, cylinder, sphere, …")] = "parabola",
    size: Annotated[int, typer.Option(help="Side of the frames, px.")] = 1000,
    height_mm: Annotated[float, typer.Option(help="Largest height, mm.")] = 100.0,
    fringes: Annotated[float, typer.Option(help="Periods across the frame.")] = 10.0,
    gamma: Annotated[float, typer.Option(help="Exponent of the projector's response.")] = 1.0,
    noise: Annotated[float, typer.Option(help="Gaussian noise, counts of 8 bit.")] = 0.0,
    shot: Annotated[float, typer.Option(help="Shot noise, variance per count.")] = 0.0,
    bits: Annotated[int, typer.Option(help="8, 10, 12, 16, or 0 for none.")] = 0,
    ambient: Annotated[float, typer.Option(help="Ambient light, share of the range.")] = 0.0,
    paint: Annotated[bool, typer.Option(help="Paint the object.")] = False,
    axis: Annotated[AxisName, typer.Option(help="Direction of the fringes.")] = AxisName.x,
    sign: Annotated[int, typer.Option(help="Side of the projector, 1 or -1.")] = 1,
    seed: Annotated[int, typer.Option(help="Seed of noise and paint.")] = 0,
) -> None:
    """Write a capture of an artificial object, with its truth."""
    if sign not in (1, -1):
        raise InputError(f"--sign: expected 1 or -1, got {sign}")
    scene = standard_scene(
        object,
        size=size,
        height_mm=height_mm,
        painted=paint,
        sign=1 if sign == 1 else -1,
        fringes=fringes,
        gamma=gamma,
        noise=noise,
        shot=shot,
        bits=bits,
        ambient=ambient,
        axis=axis.value,
        seed=seed,
    )
    typer.echo(f"wrote {write_pair(out, scene)}")


@app.command()
def paper(
    out: Output,
    size: Annotated[int, typer.Option(help="Side of the frames, px.")] = 1000,
) -> None:
    """Make all figures of the dissertation's chapter 4, and its table of errors."""
    from fringeworks.showcase.dissertation import write_paper

    with show_progress() as progress:
        written = write_paper(out, size=size, progress=progress)
    typer.echo(f"wrote {len(written)} files to {out}")


@app.command()
def demo(
    out: Output,
    size: Annotated[int, typer.Option(help="Side of the frames, px.")] = 1000,
    json_file: JsonFile = None,
) -> None:
    """Measure three objects by two frames, and three with a rig that is calibrated before."""
    from fringeworks.showcase.demo import write_demo
    from fringeworks.showcase.demo_rig import write_rig_demo

    make_folder(out)
    with show_progress() as progress:
        rows, pictures = write_demo(out, size=size, progress=progress)
        scale = min(max(size / 1000.0, 0.25), 1.0)
        rig_rows, rig_pictures = write_rig_demo(out, scale=scale, progress=progress)
    pictures += rig_pictures
    write_json(json_file, format_table([*rows, *rig_rows], "json"))
    if str(json_file) == "-":
        return
    shown = [
        {
            k: row[k]
            for k in (
                "object",
                "case",
                "method",
                "mean_abs_error_mm",
                "std_error_mm",
                "failed_fraction",
                "seconds",
            )
        }
        for row in rows
    ]
    typer.echo(format_table(shown), nl=False)
    typer.echo("with a calibrated rig:")
    typer.echo(format_table(rig_rows), nl=False)
    if not any(path.name.startswith("cone") for path in pictures):
        typer.echo("no real captures: set FRINGEWORKS_DATA to a folder that holds pair_cone/")
    for path in pictures:
        typer.echo(f"see {path}")


@app.command("methods")
def list_methods() -> None:
    """List the methods and their options."""
    table = Table("method", "what it does", "options", box=None, pad_edge=False)
    for entry in methods().values():
        options = "\n".join(f"{name} = {value}" for name, value in entry.options.items())
        table.add_row(entry.name, entry.summary, options)
    Console().print(table)
