"""``fringeworks foresee``: what a scan of a part will see, and from which poses to take it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app
from fringeworks.cli.deviating import numbers
from fringeworks.cli.options import JsonFile

if TYPE_CHECKING:
    from fringeworks.evaluate import ViewPlan

SECTION = "Results"
COLUMNS = ("face", "tolerance", "seen", "seen well", "σ", "reached", "missing because")
GUESSED_ALBEDO = 0.6
"""Reflectance where none is given: that of ``fw.evaluate.foresee``."""
NOISE = 2.0
"""Standard deviation of the camera's noise where none is given, counts of 8 bit: as `plan` has."""


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks foresee part.stl plan.toml --rig rig.toml "
    "--pose 0:0:500:20:0:0 --tolerance-mm 0.5",
)
def foresee(
    model: Annotated[Path, typer.Argument(help="Drawing: .stl, .ply, .obj or .off, in mm.")],
    plan: Annotated[Path, typer.Argument(help="Plan file, as `plan` writes it.")],
    *,
    rig: Annotated[Path, typer.Option("--rig", help="Rig file of `calibrate`.")],
    pose: Annotated[
        list[str],
        typer.Option(
            help="Pose of the drawing before the camera: its origin, mm, and its turns about the "
            "camera's x, y and z in this order, degrees, as x:y:z:a:b:c; repeatable."
        ),
    ],
    spin: Annotated[
        str | None,
        typer.Option(
            help="Turn the first pose on a turntable: a point of its axis before the camera, mm, "
            "the axis's direction, and the number of poses, as x:y:z:X:Y:Z:N."
        ),
    ] = None,
    tolerance_mm: Annotated[
        float | None, typer.Option(help="Largest deviation that is allowed to either side, mm.")
    ] = None,
    albedo: Annotated[
        float, typer.Option(help="Guess of the surface's reflectance, 0 to 1.")
    ] = GUESSED_ALBEDO,
    noise: Annotated[
        float, typer.Option(help="Standard deviation of the camera's noise, counts.")
    ] = NOISE,
    scale: Annotated[float, typer.Option(help="mm per unit of the drawing; inches: 25.4.")] = 1.0,
    json_file: JsonFile = None,
) -> None:
    """Predict what a scan of a part will see, and choose poses.

    Exit code 3 where a face is out of reach.
    """
    words = output.Output(json_file)
    poses = [_pose(text) for text in pose]
    if spin is not None:
        poses = _turned(poses, spin)
    found = fw.evaluate.plan_views(
        fw.files.read_model(model, scale=scale),
        rig,
        fw.files.read_plan(plan),
        poses,
        tolerance_mm={} if tolerance_mm is None else tolerance_mm,
        albedo=albedo,
        optics=fw.simulate.Optics(noise=noise),
    )
    words.table(COLUMNS, _rows(found))
    taken = ", ".join(str(k + 1) for k in found.chosen) or "none"
    words.say(f"poses to scan from: {taken} of {len(poses)}")
    for face in found.unreached:
        words.say(f"{face.name} is out of reach from the given poses: {face.cause}")
    output.write_json(json_file, _figures(found))
    words.wrote(json_file)
    raise typer.Exit(3 if found.unreached else 0)


def _rows(found: ViewPlan) -> list[tuple[str, ...]]:
    from fringeworks.types.numbers import limit, percent, sigma_text  # when it is used

    return [
        (
            face.name,
            "" if face.tolerance_mm is None else f"{limit(face.tolerance_mm)} mm",
            percent(face.share),
            percent(face.fit_share),
            sigma_text(face.sigma_mm, "mm"),
            "yes" if face.reached else "no",
            face.cause,
        )
        for face in found.faces
    ]


def _figures(found: ViewPlan) -> dict[str, Any]:
    """The plan of views for JSON; poses count from 1, as on the screen."""
    return {
        "poses": [k + 1 for k in found.chosen],
        "faces": [
            {
                "name": face.name,
                "tolerance_mm": face.tolerance_mm,
                "share": face.share,
                "fit_share": face.fit_share,
                "sigma_mm": face.sigma_mm if face.share > 0 else None,
                "reached": face.reached,
                "cause": face.cause,
            }
            for face in found.faces
        ],
    }


def _pose(text: str) -> Any:
    import numpy as np  # when it is used: the command line loads without it
    from scipy.spatial.transform import Rotation

    found = numbers(text, 6, "--pose")
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", found[3:], degrees=True).as_matrix()
    T[:3, 3] = found[:3]
    return T


def _turned(poses: list[Any], text: str) -> list[Any]:
    if len(poses) != 1:
        raise fw.InputError("--spin cannot be combined with several --pose")
    found = numbers(text, 7, "--spin")
    if not found[6].is_integer():
        raise fw.InputError(f"--spin: expected a whole number of poses, got {found[6]:g}")
    return fw.evaluate.turned_poses(poses[0], found[:3], found[3:6], int(found[6]))
