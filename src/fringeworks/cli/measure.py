"""``fringeworks reconstruct``: a capture in, a surface out."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from fringeworks.cli.common import (
    AxisName,
    DenoiserName,
    JsonFile,
    app,
    axis_of,
    denoiser_of,
    failures,
    show_progress,
    write_json,
)
from fringeworks.cli.rig import measure_points
from fringeworks.evaluate.errors import errors
from fringeworks.files.atomic import read_frame
from fringeworks.files.pair import read_capture, read_pair
from fringeworks.files.points import WRITERS as POINT_WRITERS
from fringeworks.files.reference_plane import read_geometry, read_pixels
from fringeworks.files.response import read_response
from fringeworks.files.surfaces import WRITERS, check_surface_target, write_surface
from fringeworks.pair.analyse import get_method
from fringeworks.pipeline import reconstruct as run_reconstruct
from fringeworks.report.summary import summary
from fringeworks.report.tables import to_json
from fringeworks.signal.response import apply_response
from fringeworks.types import InputError, Pair, ReferencePlaneGeometry


class Ply(StrEnum):
    """What a .ply file holds."""

    points = "points"
    mesh = "mesh"


def _load(
    capture: Path | None,
    reference: Path | None,
    object: Path | None,
    axis: AxisName | None,
    mask: Path | None,
    background: Path | None,
    geometry: dict[str, float | None],
) -> Pair:
    """The capture that the options of ``reconstruct`` describe."""
    if (capture is None) == (reference is None and object is None):
        raise InputError("expected either a capture, or --reference and --object")
    if capture is not None:
        loaded = read_capture(capture)
    elif object is None:
        raise InputError("expected two images, got one: --object is missing")
    else:
        loaded = read_pair(reference, object)
    if axis is not None:
        loaded = replace(loaded, axis=axis_of(axis))
    if mask is not None:
        loaded = replace(loaded, mask=read_frame(mask)[0] != 0)
    if background is not None:
        loaded = replace(loaded, background=read_frame(background)[0] != 0)
    given = {name: value for name, value in geometry.items() if value is not None}
    if given:
        loaded = replace(loaded, geometry=_geometry(given))
    return loaded


def _geometry(given: dict[str, float]) -> ReferencePlaneGeometry:
    needed = ("distance_mm", "baseline_mm", "pitch_mm_per_px")
    missing = [f"--{name.replace('_', '-')}" for name in needed if name not in given]
    if missing:
        raise InputError(
            f"geometry: expected --distance-mm, --baseline-mm and --pitch-mm-per-px "
            f"together, {', '.join(missing)} missing"
        )
    sign = given.get("sign", 1)
    if sign not in (1, -1):
        raise InputError(f"--sign: expected 1 or -1, got {sign:g}")
    return ReferencePlaneGeometry(
        distance_mm=given["distance_mm"],
        baseline_mm=given["baseline_mm"],
        pitch_mm_per_px=given["pitch_mm_per_px"],
        sign=1 if sign == 1 else -1,
    )


def _method_options(method: str, settings: list[str]) -> dict[str, Any]:
    """``name=value`` pairs; words as they are, all else read as JSON."""
    known = get_method(method).options
    options: dict[str, Any] = {}
    for setting in settings:
        name, separator, text = setting.partition("=")
        if not separator:
            raise InputError(f"--option: expected name=value, got {setting!r}")
        if name not in known:
            raise InputError(
                f"--option: {method} has {', '.join(known) or 'no options'}, got {name!r}"
            )
        if isinstance(known[name], str):
            options[name] = text
            continue
        try:
            options[name] = json.loads(text)
        except json.JSONDecodeError as error:
            raise InputError(f"--option {name}: expected a number or list, got {text!r}") from error
    return options


@app.command()
def reconstruct(
    capture: Annotated[
        Path | None, typer.Argument(help="Capture folder, .npz or .mat file.")
    ] = None,
    reference: Annotated[
        Path | None, typer.Option(help="Image of the reference plane; none for a single frame.")
    ] = None,
    object: Annotated[Path | None, typer.Option(help="Image with the object.")] = None,
    method: Annotated[str, typer.Option(help="See `fringeworks methods`.")] = "windowed",
    option: Annotated[
        list[str] | None, typer.Option(help="Option of the method, name=value; repeatable.")
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file: measure points from a stack of frames.")
    ] = None,
    plan_path: Annotated[
        Path | None, typer.Option("--plan", help="With --rig: plan file of the stack.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help=f"Result file: {', '.join(WRITERS)}; with --rig: {', '.join(POINT_WRITERS)}."
        ),
    ] = None,
    ply: Annotated[Ply, typer.Option(help="What a .ply file holds.")] = Ply.points,
    figure: Annotated[
        Path | None, typer.Option(help="Picture of values, σ and reasons (PNG).")
    ] = None,
    json_file: JsonFile = None,
    axis: Annotated[AxisName | None, typer.Option(help="Direction of the fringes.")] = None,
    mask: Annotated[Path | None, typer.Option(help="Image, non-zero where to measure.")] = None,
    background: Annotated[
        Path | None, typer.Option(help="Image, non-zero where a single frame shows the plane.")
    ] = None,
    denoise: Annotated[DenoiserName | None, typer.Option(help="Denoise both frames.")] = None,
    response: Annotated[
        Path | None, typer.Option(help="Response file, taken out of both frames.")
    ] = None,
    camera: Annotated[str | None, typer.Option(help="Name of the camera.")] = None,
    projector: Annotated[str | None, typer.Option(help="Name of the projector.")] = None,
    distance_mm: Annotated[float | None, typer.Option(help="l, plane to pupils, mm.")] = None,
    baseline_mm: Annotated[float | None, typer.Option(help="d₀, between pupils, mm.")] = None,
    pitch_mm_per_px: Annotated[float | None, typer.Option(help="Pixel on the plane, mm.")] = None,
    sign: Annotated[int | None, typer.Option(help="Side of the projector, 1 or -1.")] = None,
    geometry_path: Annotated[
        Path | None,
        typer.Option("--geometry", help="File of `calibrate-plane`: .toml, or .npz by pixels."),
    ] = None,
) -> None:
    """Measure a surface: two frames in, a height map out; a stack and a rig in, points out."""
    geometry = {
        "distance_mm": distance_mm,
        "baseline_mm": baseline_mm,
        "pitch_mm_per_px": pitch_mm_per_px,
        "sign": sign,
    }
    if rig is not None:
        of_pairs = {
            "--reference": reference,
            "--object": object,
            "--option": option,
            "--mask": mask,
            "--background": background,
            "--denoise": denoise,
            "--geometry": geometry_path,
            **{f"--{name.replace('_', '-')}": value for name, value in geometry.items()},
        }
        _refuse_options(of_pairs, "--rig")
        if capture is None:
            raise InputError("--rig: expected a stack of frames with it, got none")
        measure_points(
            capture,
            rig,
            plan=plan_path,
            out=out,
            mesh=ply is Ply.mesh,
            figure=figure,
            json_file=json_file,
            axis=axis_of(axis),
            response=None if response is None else read_response(response),
        )
        return
    _refuse_options({"--plan": plan_path}, "a pair")
    loaded = _load(capture, reference, object, axis, mask, background, geometry)
    pixels = None
    if geometry_path is not None:
        _refuse_options(
            {f"--{name.replace('_', '-')}": value for name, value in geometry.items()},
            "--geometry",
        )
        if geometry_path.suffix.lower() == ".npz":
            pixels = read_pixels(geometry_path)
        else:
            loaded = replace(loaded, geometry=read_geometry(geometry_path))
    loaded = replace(
        loaded, camera=camera or loaded.camera, projector=projector or loaded.projector
    )
    if response is not None:
        loaded = apply_response(loaded, read_response(response))
    if out is not None:
        check_surface_target(out)
    with show_progress() as progress:
        progress(f"{method} …")
        result = run_reconstruct(
            loaded,
            method,
            denoise=denoiser_of(denoise),
            pixels=pixels,
            **_method_options(method, option or []),
        )
    content = summary(result)
    if loaded.truth_mm is not None and result.surface.unit == "mm":
        content["errors"] = asdict(errors(result.surface, loaded.truth_mm))
    if out is not None:
        write_surface(out, result.surface, ply="mesh" if ply is Ply.mesh else "points")
    if figure is not None:
        from fringeworks.report import figures

        figures.save(figures.surface_sheet(f"{method}", result.surface), figure)
    write_json(json_file, to_json(content))
    if str(json_file) != "-":
        _report(content, out)


def _refuse_options(options: dict[str, Any], beside: str) -> None:
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise InputError(f"{given[0]}: expected without {beside}, got both")


def _report(content: dict[str, Any], out: Path | None) -> None:
    for note in content["notes"]:
        typer.echo(f"note: {note}")
    unit = content["unit"]
    if content["median"] is None:
        typer.echo(f"{content['quantity']}: no pixel could be measured")
    else:
        typer.echo(
            f"{content['quantity']}: {content['minimum']:.4g} … {content['maximum']:.4g} {unit}, "
            f"median σ {content['median_sigma']:.2g} {unit}"
        )
    typer.echo(f"failed: {content['failed_fraction']:.2%} ({failures(content['reasons'])})")
    if "errors" in content:
        e = content["errors"]
        typer.echo(
            f"against the truth: mean |error| {e['mean_abs_error_mm']:.4g} mm, "
            f"s.d. {e['std_error_mm']:.4g} mm"
        )
    if out is not None:
        typer.echo(f"wrote {out}")
