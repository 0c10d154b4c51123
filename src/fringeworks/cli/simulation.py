"""``fringeworks simulate | paper | demo | selftest``: artificial captures, and what is promised."""

from __future__ import annotations

from typing import Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.options import AxisName, Folder, Force, JsonFile, Size

SECTION = "Simulation"
SHOWN = (
    "object",
    "case",
    "method",
    "mean_abs_error_mm",
    "std_error_mm",
    "failed_fraction",
)
"""Columns of the demonstration's table that fit on a terminal."""
COLUMNS = {
    "way": "way",
    "body": "body",
    "disturbance": "disturbance",
    "unit": "unit",
    "measured": "measured",
    "bias": "bias",
    "deviation": "s.d.",
    "typical": "typical",
    "sigma": "σ",
    "bound": "bound",
    "within_1_sigma": "in 1 σ",
    "within_2_sigma": "in 2 σ",
    "gross": "gross",
}
"""Columns of the self-test's table, by the fields of a case."""
BROKEN = 1
"""Exit code where a promise is not kept."""


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks simulate --shape parabola --gamma 2.2 --bits 8 --noise 2 "
    "--seed 1 --out part/",
)
def simulate(
    out: Folder,
    shape: Annotated[
        str, typer.Option(help="Artificial object: parabola, cube, cylinder, sphere, …")
    ] = "parabola",
    size: Size = 1000,
    height_mm: Annotated[float, typer.Option(help="Largest height, mm.")] = 100.0,
    fringes: Annotated[float, typer.Option(help="Periods across the frame.")] = 10.0,
    gamma: Annotated[float, typer.Option(help="Exponent of the projector's response.")] = 1.0,
    noise: Annotated[
        float,
        typer.Option(
            help="Standard deviation of the camera's noise, counts; on the scale of 8 bit."
        ),
    ] = 0.0,
    gain: Annotated[float, typer.Option(help="Shot noise, variance per count.")] = 0.0,
    bits: Annotated[int, typer.Option(help="Quantisation: 0 (none), 8, 10, 12, 16.")] = 0,
    ambient: Annotated[float, typer.Option(help="Ambient light, share of the range.")] = 0.0,
    paint: Annotated[bool, typer.Option("--paint", help="Paint the object.")] = False,
    axis: Annotated[
        AxisName, typer.Option(help="Axis along which the fringes vary, x or y.")
    ] = AxisName.x,
    sign: Annotated[int, typer.Option(help="Side of the projector, 1 or -1.")] = 1,
    seed: Annotated[int, typer.Option(help="Seed of the noise; and of the paint.")] = 0,
    force: Force = False,
) -> None:
    """Write a pair of frames of an artificial object, with its true heights."""
    output.check_folder(out)
    scene = fw.simulate.standard_scene(
        shape,
        size=size,
        height_mm=height_mm,
        painted=paint,
        sign=sign,  # type: ignore[arg-type]
        fringes=fringes,
        gamma=gamma,
        noise=noise,
        gain=gain,
        bits=bits,
        ambient=ambient,
        axis=axis.value,
        seed=seed,
    )
    output.Output().wrote(fw.files.write_pair(out, scene, force=force))


@app.command(rich_help_panel=SECTION, epilog="Example: fringeworks paper --out figures/")
def paper(
    out: Folder,
    size: Size = 1000,
    kind: Annotated[
        str, typer.Option("--figures", help="Format of the figures: svg, pdf (for LaTeX) or png.")
    ] = "svg",
    force: Force = False,
) -> None:
    """Make all figures of the dissertation's chapter 4, and its table of errors."""
    from fringeworks.showcase.dissertation import write_paper

    output.check_folder(out)
    with output.progress() as progress:
        written = write_paper(out, size=size, kind=kind, force=force, progress=progress)
    output.Output().say(f"wrote {len(written)} files to {out}")


@app.command(rich_help_panel=SECTION, epilog="Example: fringeworks demo --out demo/")
def demo(out: Folder, size: Size = 1000, force: Force = False, json_file: JsonFile = None) -> None:
    """Measure artificial objects by two frames and by a calibrated rig; pictures and tables."""
    from fringeworks.showcase.demo import write_demo
    from fringeworks.types import made_by

    words = output.Output(json_file)
    output.check_folder(out)
    with output.progress() as progress:
        result = write_demo(out, size=size, force=force, progress=progress)
    origin = made_by("write_demo", options={"size": size})
    rows = [*result.rows, *result.rig_rows]
    output.write_json(json_file, {"rows": rows, "provenance": origin.as_dict()})
    shown = [{name: row[name] for name in SHOWN} for row in result.rows]
    words.say(fw.report.format_table(shown))
    words.say("with a calibrated rig:")
    words.say(fw.report.format_table(list(result.rig_rows)))
    if not result.has_photographs:
        words.say("no real captures: set FRINGEWORKS_DATA to a folder that holds pair_cone/")
    for path in result.pictures:
        words.say(f"see {path}")


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks selftest --json selftest.json, or fringeworks selftest --quick",
)
def selftest(
    quick: Annotated[
        bool, typer.Option("--quick", help="Three scenes and two methods: about ten seconds.")
    ] = False,
    json_file: JsonFile = None,
    seed: Annotated[int, typer.Option(help="Seed of the noise; others give other frames.")] = 0,
) -> None:
    """Measure known bodies, and check the promised accuracy; exit code 1 if a promise is broken."""
    words = output.Output(json_file)
    with output.progress() as progress:
        found = fw.selftest(quick=quick, seed=seed, progress=progress)
    output.write_json(json_file, found.as_dict())
    rows = [{title: row[name] for name, title in COLUMNS.items()} for row in found.rows()]
    words.say(fw.report.format_table(rows))
    for one in found.judged:
        words.say(one.sentence)
    kept = sum(one.kept is True for one in found.judged)
    tested = sum(one.kept is not None for one in found.judged)
    words.say(f"\n{kept} of {tested} promises are kept, after {found.seconds:.0f} s")
    words.wrote(json_file)
    for one in found.broken:
        typer.echo(f"fringeworks: {one.sentence}", err=True)
    if not found.passed:
        raise typer.Exit(BROKEN)
