"""``response`` of projector and camera, and ``calibrate-plane`` for two frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from fringeworks.cli.common import JsonFile, app, write_json
from fringeworks.files.pair import read_pair
from fringeworks.files.reference_plane import write_geometry, write_pixels
from fringeworks.files.response import write_response
from fringeworks.files.stack import read_stack
from fringeworks.pair.plane_calibration import calibrate_pixels, calibrate_reference_plane
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform
from fringeworks.pipeline import reconstruct
from fringeworks.report.tables import to_json
from fringeworks.signal.response import measure_response
from fringeworks.signal.smooth_coordinate import smooth_coordinate
from fringeworks.stack.decode import decode
from fringeworks.stack.frames import Stack
from fringeworks.types import FloatMap, InputError


@app.command()
def response(
    stack: Annotated[
        Path, typer.Argument(help="Stack of a white plane under fringes and Gray code.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Response file to write (TOML).")],
    plan_path: Annotated[
        Path | None, typer.Option("--plan", help="Plan file, where it is not in the folder.")
    ] = None,
    number: Annotated[
        int, typer.Option("--set", help="Which set of steps of the plan, from 1.")
    ] = 1,
    camera: Annotated[str | None, typer.Option(help="Name of the camera.")] = None,
    projector: Annotated[str | None, typer.Option(help="Name of the projector.")] = None,
    json_file: JsonFile = None,
) -> None:
    """Measure the response of a camera and projector, for --response of other commands."""
    loaded = read_stack(stack, plan_path)
    names = {"camera": camera or loaded.camera, "projector": projector or loaded.projector}
    for name, value in names.items():
        if not value:
            raise InputError(f"--{name}: expected a name, got none here nor in the capture")
    sets = [(k, b) for k, b in loaded.plan.placed if isinstance(b, PhaseSteps)]
    if not 1 <= number <= len(sets):
        raise InputError(f"--set: expected 1 to {len(sets)} sets of steps, got {number}")
    first, steps = sets[number - 1]
    coordinate = _code_coordinate(loaded, steps)
    found = measure_response(
        np.stack(loaded.frames[first : first + steps.frames]),
        2.0 * np.pi / steps.period_px * smooth_coordinate(coordinate, np.isfinite(coordinate)),
        camera=names["camera"] or "",
        projector=names["projector"] or "",
        shifts_rad=steps.shifts_rad,
        pattern_exponent=1.0 / loaded.plan.gamma,
    )
    write_response(out, found)
    figures = {"gamma": found.gamma, "steps": found.steps, "residual_rad": found.residual_rad}
    write_json(json_file, to_json(figures))
    if str(json_file) != "-":
        typer.echo(f"γ = {found.gamma:.3f}; the table leaves {found.residual_rad:.4f} rad rms")
        typer.echo(f"wrote {out}")


def _code_coordinate(stack: Stack, steps: PhaseSteps) -> FloatMap:
    """The coordinate that the Gray code tells by itself: it does not depend on intensities."""
    plan = stack.plan
    if plan.gray_code(steps.axis) is None:
        raise InputError(f"plan: expected a Gray code along {steps.axis}, got none")
    kept = [
        (first, block)
        for first, block in plan.placed
        if isinstance(block, Uniform) or (isinstance(block, GrayCode) and block.axis == steps.axis)
    ]
    frames = [stack.frames[k] for first, block in kept for k in range(first, first + block.frames)]
    alone = PatternPlan(plan.width_px, plan.height_px, tuple(block for _, block in kept))
    found = decode(frames, alone).maps[steps.axis]
    return found.coordinate_px.astype(np.float64)


@app.command("calibrate-plane")
def calibrate_plane(
    reference: Annotated[Path, typer.Option(help="Fringes on the reference plane.")],
    plane: Annotated[
        list[str],
        typer.Option(help="A plane at a height: mm=image; repeat, two or more (three by pixels)."),
    ],
    out: Annotated[
        Path, typer.Option("--out", help="Geometry file: .toml, or .npz with a law per pixel.")
    ],
    pitch_mm_per_px: Annotated[
        float | None, typer.Option(help="Pixel on the reference plane, mm; needed for .toml.")
    ] = None,
    method: Annotated[str, typer.Option(help="See `fringeworks methods`.")] = "windowed",
    json_file: JsonFile = None,
) -> None:
    """Calibrate the two-frame path from a plane at known heights."""
    by_pixel = out.suffix.lower() == ".npz"
    if not by_pixel and out.suffix.lower() != ".toml":
        raise InputError(f"--out: expected .toml or .npz, got {out.suffix or 'no suffix'}")
    if not by_pixel and pitch_mm_per_px is None:
        raise InputError("--pitch-mm-per-px: expected a number, got none")
    heights, maps = [], []
    for text in plane:
        height, separator, name = text.partition("=")
        try:
            heights.append(float(height))
        except ValueError as error:
            raise InputError(f"--plane: expected mm=image, got {text!r}") from error
        if not separator:
            raise InputError(f"--plane: expected mm=image, got {text!r}")
        found = reconstruct(read_pair(reference, Path(name)), method)
        maps.append(found.displacement.displacement_px)
    content: dict[str, Any]
    if by_pixel:
        pixels = calibrate_pixels(maps, heights)
        write_pixels(out, pixels)
        content = {
            "median_mm_per_px": float(np.nanmedian(pixels.slope)),
            "calibrated_fraction": float(np.mean(np.isfinite(pixels.slope))),
        }
    else:
        measured = calibrate_reference_plane(maps, heights, pitch_mm_per_px=pitch_mm_per_px or 0.0)
        write_geometry(out, measured.geometry)
        content = {
            "distance_mm": measured.geometry.distance_mm,
            "distance_sigma_mm": measured.distance_sigma_mm,
            "baseline_mm": measured.geometry.baseline_mm,
            "baseline_sigma_mm": measured.baseline_sigma_mm,
            "sign": measured.geometry.sign,
            "residual_mm": list(measured.residual_mm),
        }
    write_json(json_file, to_json(content))
    if str(json_file) != "-":
        for name, value in content.items():
            typer.echo(f"{name}: {value}")
        typer.echo(f"wrote {out}")
