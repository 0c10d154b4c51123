"""``fringeworks response``: measure what projector and camera make of a fringe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from fringeworks.analysis import decode
from fringeworks.cli.common import JsonFile, app, write_json
from fringeworks.evaluate import to_json
from fringeworks.patterns import GrayCode, Level, PatternPlan, PhaseSteps
from fringeworks.response import measure_response, smooth_coordinate
from fringeworks.response_file import write_response
from fringeworks.stack_file import Stack, read_stack
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
    if plan.code(steps.axis) is None:
        raise InputError(f"plan: expected a Gray code along {steps.axis}, got none")
    kept = [
        (first, block)
        for first, block in plan.placed
        if isinstance(block, Level) or (isinstance(block, GrayCode) and block.axis == steps.axis)
    ]
    frames = [stack.frames[k] for first, block in kept for k in range(first, first + block.frames)]
    alone = PatternPlan(plan.width_px, plan.height_px, tuple(block for _, block in kept))
    found = decode(frames, alone).maps[steps.axis]
    return found.coordinate_px.astype(np.float64)
