"""``fringeworks plan | patterns | decode``: choose patterns, draw them, decode what was taken."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from fringeworks.cli.common import JsonFile, Output, app, failures, show_progress, write_json
from fringeworks.files.coordinates import check_coordinate_target, write_coordinates
from fringeworks.files.plan import read_plan, write_patterns, write_plan
from fringeworks.files.response import read_response
from fringeworks.files.stack import read_stack
from fringeworks.patterns.propose import Proposal, propose
from fringeworks.report.summary import decoded_summary
from fringeworks.report.tables import to_json
from fringeworks.signal.response import check_devices
from fringeworks.stack.decode import decode as run_decode
from fringeworks.types import Axis, CameraNoise, InputError


class Axes(StrEnum):
    """Along which axes of the projector something is decoded."""

    x = "x"
    y = "y"
    xy = "xy"


class PictureFormat(StrEnum):
    """How patterns are written."""

    png = "png"
    tiff = "tiff"


def _projector(text: str) -> tuple[int, int]:
    width, cross, height = text.lower().replace("×", "x").partition("x")
    if not (cross and width.strip().isdigit() and height.strip().isdigit()):
        raise InputError(f"--projector: expected columns x rows, as 1920x1080, got {text!r}")
    return int(width), int(height)


@app.command()
def plan(
    projector: Annotated[str, typer.Option(help="Columns x rows, as 1920x1080.")],
    frames: Annotated[int, typer.Option(help="Frames to spend.")],
    axes: Annotated[Axes, typer.Option(help="Axes to decode.")] = Axes.x,
    noise: Annotated[float, typer.Option(help="Noise of the camera, counts.")] = 2.0,
    modulation: Annotated[float, typer.Option(help="Modulation of the fringes, counts.")] = 100.0,
    min_period: Annotated[
        float, typer.Option(help="Shortest period still resolved, projector px.")
    ] = 16.0,
    kind: Annotated[str, typer.Option(help="Kind to write; the best one by default.")] = "",
    out: Annotated[Path | None, typer.Option("--out", help="Plan file to write (TOML).")] = None,
    json_file: JsonFile = None,
) -> None:
    """Propose plans for a projector and a number of frames, the smallest error first."""
    width, height = _projector(projector)
    along: tuple[Axis, ...] = {"x": ("x",), "y": ("y",), "xy": ("x", "y")}[axes.value]  # type: ignore[assignment]
    found = propose(
        width,
        height,
        frames,
        axes=along,
        noise=noise,
        modulation=modulation,
        min_period_px=min_period,
    )
    chosen = [p for p in found if p.kind == kind] if kind else found[:1]
    if not chosen:
        raise InputError(f"--kind: expected {', '.join(p.kind for p in found)}, got {kind!r}")
    if out is not None:
        write_plan(out, chosen[0].plan)
    write_json(json_file, to_json([_figures(p) for p in found]))
    if str(json_file) == "-":
        return
    table = Table(
        "kind", "σ / px", "room / σ", "frames", "periods × steps", box=None, pad_edge=False
    )
    for p in found:
        count = str(p.plan.frames)
        table.add_row(p.kind, f"{p.sigma_px:.4f}", f"{p.margin:.0f}", count, p.summary)
    Console().print(table)
    if out is not None:
        typer.echo(f"wrote {out} ({chosen[0].kind})")


def _figures(proposal: Proposal) -> dict[str, Any]:
    return {
        "kind": proposal.kind,
        "sigma_px": proposal.sigma_px,
        "margin": proposal.margin,
        "frames": proposal.plan.frames,
        "plan": asdict(proposal.plan),
    }


@app.command()
def patterns(
    plan_path: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan file (TOML).")],
    out: Output,
    format: Annotated[PictureFormat, typer.Option(help="PNG files or one TIFF stack.")] = (
        PictureFormat.png
    ),
) -> None:
    """Draw the patterns of a plan, in the order in which they are to be sent."""
    layout = read_plan(plan_path)
    _prove(layout)
    with show_progress(layout.frames) as progress:
        written = write_patterns(out, layout, stack=format is PictureFormat.tiff, progress=progress)
    typer.echo(f"wrote {layout.frames} patterns to {out if len(written) > 1 else written[0]}")


def _prove(layout: Any) -> None:
    """Say that a plan cannot be resolved before it is projected."""
    for axis in layout.axes:
        if layout.phase_sets(axis):
            layout.chain(axis)


@app.command()
def decode(
    stack: Annotated[
        Path, typer.Argument(help="Folder of images with plan.toml, TIFF stack, .npy or .npz.")
    ],
    plan_path: Annotated[
        Path | None, typer.Option("--plan", help="Plan file, where it is not in the folder.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Coordinates to write (.npz).")] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Picture of coordinates, σ and reasons (PNG).")
    ] = None,
    json_file: JsonFile = None,
    noise: Annotated[
        float | None, typer.Option(help="Noise of the camera, counts; measured by default.")
    ] = None,
    gain: Annotated[
        float, typer.Option(help="With --noise: shot noise, variance per count.")
    ] = 0.0,
    saturation: Annotated[
        float | None, typer.Option(help="Counts from which on a sample is not trusted.")
    ] = None,
    min_modulation: Annotated[float, typer.Option(help="Least modulation, counts.")] = 0.0,
    relative: Annotated[
        bool, typer.Option("--relative", help="Coordinates modulo what the periods can tell.")
    ] = False,
    estimate_steps: Annotated[
        bool, typer.Option("--estimate-steps", help="Take real phase steps from the frames.")
    ] = False,
    phases: Annotated[bool, typer.Option("--phases", help="Write wrapped phases as well.")] = False,
    response: Annotated[
        Path | None, typer.Option(help="Response file, taken out of the phases.")
    ] = None,
    camera: Annotated[str | None, typer.Option(help="Name of the camera.")] = None,
    projector: Annotated[str | None, typer.Option(help="Name of the projector.")] = None,
) -> None:
    """Decode a stack of fringes and Gray code to projector coordinates."""
    if out is not None:
        check_coordinate_target(out)
    if noise is None and gain:
        raise InputError("--gain: expected together with --noise, got it alone")
    with show_progress() as progress:
        progress("reading …")
        loaded = read_stack(stack, plan_path)
        measured = None if response is None else read_response(response)
        if measured is not None:
            check_devices(measured, camera or loaded.camera, projector or loaded.projector)
        progress("decoding …")
        found = run_decode(
            loaded.frames,
            loaded.plan,
            noise=None if noise is None else CameraNoise(noise, gain),
            saturation=loaded.saturation if saturation is None else saturation,
            min_modulation=min_modulation,
            absolute=not relative,
            response=measured,
            estimate_steps=estimate_steps,
            keep_phases=phases,
        )
    content = decoded_summary(found, loaded.notes)
    if out is not None:
        write_coordinates(out, found)
    if figure is not None:
        from fringeworks.report import figures

        figures.save(figures.coordinate_sheet(stack.name, found), figure)
    write_json(json_file, to_json(content))
    if str(json_file) != "-":
        _report(content, out)


def _report(content: dict[str, Any], out: Path | None) -> None:
    for note in content["notes"]:
        typer.echo(f"note: {note}")
    for axis, found in content["axes"].items():
        failed = failures(found["reasons"])
        if found["median_sigma_px"] is None:
            typer.echo(f"{axis}: no pixel could be measured ({failed})")
            continue
        typer.echo(
            f"{axis}: {found['minimum_px']:.1f} … {found['maximum_px']:.1f} px, "
            f"median σ {found['median_sigma_px']:.3g} px"
        )
        typer.echo(f"   failed: {found['failed_fraction']:.2%} ({failed})")
    if out is not None:
        typer.echo(f"wrote {out}")
