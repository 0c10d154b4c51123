"""``fringeworks response``: measure what projector and camera make of a fringe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from fringeworks.cli.common import JsonFile, app, list_of, write_json
from fringeworks.evaluate import to_json
from fringeworks.files import read_frame
from fringeworks.response import measure_response, smooth_coordinate
from fringeworks.response_file import write_response
from fringeworks.types import InputError


@app.command()
def response(
    frames: Annotated[list[Path], typer.Argument(help="Images of N steps on a white plane.")],
    coordinate: Annotated[
        Path, typer.Option(help="TIFF of the projector coordinate per pixel (Gray code), px.")
    ],
    period: Annotated[float, typer.Option(help="Period of the fringe, projector px.")],
    camera: Annotated[str, typer.Option(help="Name of the camera.")],
    projector: Annotated[str, typer.Option(help="Name of the projector.")],
    out: Annotated[Path, typer.Option("--out", help="Response file to write (TOML).")],
    shifts_deg: Annotated[
        str, typer.Option(help="Phase of every frame; equal steps from 0 by default.")
    ] = "",
    pattern_exponent: Annotated[
        float, typer.Option(help="Exponent of the patterns that were sent.")
    ] = 1.0,
    json_file: JsonFile = None,
) -> None:
    """Measure the response of a camera and projector, for --response of other commands."""
    if not period > 0:
        raise InputError(f"--period: expected > 0 px, got {period}")
    images = [read_frame(path)[0] for path in frames]
    sizes = {image.shape for image in images}
    if len(sizes) != 1:
        raise InputError(f"frames: expected equal sizes, got {sorted(sizes)}")
    decoded = read_frame(coordinate)[0].astype(float)
    if decoded.shape not in sizes:
        raise InputError(f"coordinate: expected shape {images[0].shape}, got {decoded.shape}")
    ideal = 2.0 * np.pi / period * smooth_coordinate(decoded, np.isfinite(decoded))
    shifts = np.radians(list_of(float, shifts_deg, "shifts-deg")).tolist() if shifts_deg else None
    found = measure_response(
        np.stack(images),
        ideal,
        camera=camera,
        projector=projector,
        shifts_rad=shifts,
        pattern_exponent=pattern_exponent,
    )
    write_response(out, found)
    figures = {"gamma": found.gamma, "steps": found.steps, "residual_rad": found.residual_rad}
    write_json(json_file, to_json(figures))
    if str(json_file) != "-":
        typer.echo(f"γ = {found.gamma:.3f}; the table leaves {found.residual_rad:.4f} rad rms")
        typer.echo(f"wrote {out}")
