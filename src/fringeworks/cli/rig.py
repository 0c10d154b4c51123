"""Calibrated pairs: ``calibrate``, ``rig``, ``evaluate``, and ``reconstruct`` with a rig."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from fringeworks.cli.common import JsonFile, app, failures, list_of, show_progress, write_json
from fringeworks.files.points import check_points_target, read_points, write_points
from fringeworks.files.rig import check_rig_target, read_rig, write_rig
from fringeworks.files.stack import read_stack
from fringeworks.pipeline import calibrate_stacks
from fringeworks.pipeline import reconstruct_points as run_points
from fringeworks.report.summary import calibration_summary, points_summary
from fringeworks.report.tables import to_json
from fringeworks.rig.calibration.board import parse_board
from fringeworks.signal.response import Response
from fringeworks.stack.frames import Stack
from fringeworks.surface.form import find_spheres, fit_form
from fringeworks.surface.form import report as form_report
from fringeworks.types import Axis, InputError

STACK_SUFFIXES = (".tif", ".tiff", ".npy", ".npz")


class BodyName(StrEnum):
    """What is fitted to points."""

    plane = "plane"
    sphere = "sphere"
    cylinder = "cylinder"


@app.command()
def calibrate(
    folder: Annotated[Path, typer.Argument(help="Folder with one stack per pose of the board.")],
    board: Annotated[
        str,
        typer.Option(
            help="chessboard:9x7:75 (inner corners, mm), charuco:8x6:30:22[:dictionary][:legacy] "
            "(squares, mm), circles:9x7:30 or asymmetric-circles:4x11:20."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Rig file: .toml, or .xml, .yml (OpenCV).")],
    plan_path: Annotated[
        Path | None, typer.Option("--plan", help="Plan file, where the stacks have none.")
    ] = None,
    distortion: Annotated[
        int, typer.Option(help="Distortion coefficients per lens: 0, 2, 4 or 5.")
    ] = 5,
    json_file: JsonFile = None,
) -> None:
    """Calibrate a camera and projector from a board in several poses."""
    check_rig_target(out)
    known = parse_board(board)
    poses = _poses(folder)
    with show_progress(len(poses) + 1) as progress:
        found = calibrate_stacks(
            _loaded(poses, plan_path), known, distortion=distortion, progress=progress
        )
    content = calibration_summary(found)
    write_rig(out, found.rig)
    write_json(json_file, to_json(content))
    if str(json_file) != "-":
        _report_calibration(content, out)


def _poses(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder with a stack per pose, got none")
    poses = sorted(
        path for path in folder.iterdir() if path.is_dir() or path.suffix.lower() in STACK_SUFFIXES
    )
    if not poses:
        raise InputError(f"{folder}: expected a stack per pose, got none")
    return poses


def _loaded(poses: list[Path], plan: Path | None) -> Iterator[tuple[str, Stack]]:
    if plan is None and (beside := poses[0].parent / "plan.toml").is_file():
        plan = beside
    for path in poses:
        yield path.name, read_stack(path, plan)


def _report_calibration(content: dict[str, Any], out: Path) -> None:
    for name, entry in content["parameters"].items():
        typer.echo(f"{name:14s} {entry['value']:12.5f} ± {entry['sigma']:.5f}")
    typer.echo(
        f"baseline       {content['baseline_mm']:12.5f} ± {content['baseline_sigma_mm']:.5f} mm"
    )
    typer.echo("pose            corners   camera  projector  predicted by the others (rms, px)")
    for row in content["poses"]:
        predicted = row["predicted_rms_px"]
        typer.echo(
            f"{row['pose']:14s} {row['corners']:4d}/{row['corners_found']:<4d} "
            f"{row['camera_rms_px']:7.3f} {row['projector_rms_px']:8.3f}   "
            + ("–" if predicted is None else f"{predicted:.3f}")
        )
    typer.echo(
        f"reprojection: camera {content['camera_rms_px']:.3f} px, "
        f"projector {content['projector_rms_px']:.3f} px"
    )
    for found in content["findings"]:
        typer.echo(f"{found['cause']}: {found['message']}")
    typer.echo(f"wrote {out}")


@app.command()
def rig(
    source: Annotated[Path, typer.Argument(help="Rig file: .toml, or .xml, .yml (OpenCV).")],
    out: Annotated[Path, typer.Option("--out", help="Rig file of another kind.")],
    projector_size: Annotated[
        str | None,
        typer.Option(help="Columns and rows, as 1024x768, where a file of OpenCV has none."),
    ] = None,
) -> None:
    """Convert a rig file, to and from OpenCV's XML and YAML."""
    check_rig_target(out)
    size = None
    if projector_size is not None:
        try:
            width, height = (int(n) for n in projector_size.lower().split("x"))
        except ValueError as error:
            raise InputError(
                f"--projector-size: expected columns x rows, got {projector_size!r}"
            ) from error
        size = (width, height)
    write_rig(out, read_rig(source, projector_size=size))
    typer.echo(f"wrote {out}")


def measure_points(
    capture: Path,
    rig_path: Path,
    *,
    plan: Path | None,
    out: Path | None,
    mesh: bool,
    figure: Path | None,
    json_file: Path | None,
    axis: Axis | None,
    response: Response | None,
) -> None:
    """What ``reconstruct --rig`` does: a stack in, points out."""
    if out is not None:
        check_points_target(out)
    calibrated = read_rig(rig_path)
    with show_progress() as progress:
        progress("reading …")
        stack = read_stack(capture, plan)
        progress("measuring …")
        cloud, decoded = run_points(stack, calibrated, axis=axis, response=response)
    if out is not None:
        write_points(out, cloud, kind="mesh" if mesh else "points")
    if figure is not None:
        from fringeworks.report import figures

        figures.save(figures.points_sheet(capture.name, cloud), figure)
    content = points_summary(cloud) | {"notes": [*stack.notes, *decoded.notes]}
    write_json(json_file, to_json(content))
    if str(json_file) == "-":
        return
    for note in content["notes"]:
        typer.echo(f"note: {note}")
    if content["points"]:
        low, high = content["minimum_mm"], content["maximum_mm"]
        span = ", ".join(
            f"{name} {a:.2f} … {b:.2f}" for name, a, b in zip("xyz", low, high, strict=True)
        )
        typer.echo(f"{content['points']} points: {span} mm")
        typer.echo(
            f"median σ {content['median_sigma_mm']:.4f} mm, of which noise "
            f"{content['median_noise_mm']:.4f} mm"
        )
    typer.echo(f"failed: {content['failed_fraction']:.2%} ({failures(content['reasons'])})")
    if out is not None:
        typer.echo(f"wrote {out}")


@app.command()
def evaluate(
    points: Annotated[Path, typer.Argument(help="Points: .ply, .xyz or .npz.")],
    fit: Annotated[BodyName, typer.Option(help="What is fitted.")],
    diameter: Annotated[
        float | None, typer.Option(help="Calibrated diameter, mm: probing error size PS.")
    ] = None,
    count: Annotated[int, typer.Option(help="Spheres to find; 2 for their spacing.")] = 1,
    spacing: Annotated[
        float | None, typer.Option(help="Calibrated distance of two spheres, mm: error SD.")
    ] = None,
    within: Annotated[
        str | None, typer.Option(help="Only points in a ball: x,y,z,radius in mm.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Fit a body to points: form and size errors in the terms of VDI/VDE 2634."""
    if count < 1 or (count > 1 and fit is not BodyName.sphere):
        raise InputError(f"--count: expected 1, or more with --fit sphere, got {count}")
    if spacing is not None and count != 2:
        raise InputError("--spacing: expected together with --count 2")
    loaded = read_points(points)
    xyz = loaded.xyz_mm
    if within is not None:
        numbers = list_of(float, within, "within")
        if len(numbers) != 4 or not numbers[3] > 0:
            raise InputError(f"--within: expected x,y,z,radius, got {within!r}")
        xyz = xyz[np.linalg.norm(xyz - numbers[:3], axis=1) <= numbers[3]]
        if len(xyz) < 10:
            raise InputError(f"--within: expected 10 points or more there, got {len(xyz)}")
    found = [fit_form(xyz, fit.value)] if count == 1 else find_spheres(xyz, count)
    content: dict[str, Any] = {
        "bodies": [form_report(form, diameter_mm=diameter) for form in found]
    }
    if count == 2:
        centres = [np.asarray(form.parameters["centre_mm"]) for form in found]
        content["sphere_spacing_mm"] = float(np.linalg.norm(centres[0] - centres[1]))
        if spacing is not None:
            content["sphere_spacing_error_SD_mm"] = content["sphere_spacing_mm"] - spacing
    write_json(json_file, to_json(content))
    if str(json_file) != "-":
        _report_forms(content)


def _report_forms(content: dict[str, Any]) -> None:
    for body in content["bodies"]:
        for name, value in body.items():
            if isinstance(value, list):
                shown = ", ".join(f"{v:.5f}" for v in value)
            elif isinstance(value, float):
                shown = f"{value:.5f}"
            else:
                shown = str(value)
            typer.echo(f"{name:28s} {shown}")
    for name in ("sphere_spacing_mm", "sphere_spacing_error_SD_mm"):
        if name in content:
            typer.echo(f"{name:28s} {content[name]:.5f}")
