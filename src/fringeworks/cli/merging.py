"""``fringeworks merge``: several views of one part."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app

SECTION = "Results"
MESHES = (".stl", ".obj", ".glb", ".3mf")
"""Kinds of files that hold a mesh and no points."""


class PosesName(StrEnum):
    """Where the poses of views come from."""

    board = "board"
    turntable = "turntable"
    shape = "shape"


class UpName(StrEnum):
    """What is up in a mesh."""

    board = "board"
    unseen = "unseen"
    x = "x"
    minus_x = "-x"
    y = "y"
    minus_y = "-y"
    z = "z"
    minus_z = "-z"


class OriginName(StrEnum):
    """Where the origin of a mesh lies."""

    plate = "plate"
    part = "part"


def _standing(found: fw.views.MergedPart, up: UpName | None, origin: OriginName) -> fw.TriangleMesh:
    """A closed mesh on its plate; by default on the side that no view saw, where there is one."""
    solid = fw.views.closed_mesh(replace(found.points, provenance=found.provenance))
    unseen = solid.filled is not None and solid.filled.any()
    name: Any = (up or (UpName.unseen if unseen else UpName.z)).value
    return fw.views.stand_mesh(solid, name, origin=origin.value)


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks merge view_*.npz --board charuco:10x10:20:15 --out part.ply",
)
def merge(
    views: Annotated[list[Path], typer.Argument(help="Clouds of the part (.npz), in order.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            help="Points (.ply, .pcd, .csv, .xyz, .e57, .las), or a watertight mesh (.stl, .obj, "
            ".glb, .3mf).",
        ),
    ],
    poses: Annotated[
        PosesName, typer.Option(help="Where the poses of the views come from.")
    ] = PosesName.board,
    board: Annotated[
        str | None, typer.Option(help="Board: as for `calibrate`; it turns with the part.")
    ] = None,
    step_deg: Annotated[
        float | None, typer.Option(help="Angle of the turntable between two views, degrees.")
    ] = None,
    rig_file: Annotated[
        Path | None,
        typer.Option(
            "--rig", help="Rig file of `calibrate`; removes the error of the camera's blur."
        ),
    ] = None,
    blur_px: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of the camera's blur, px; by default that of the rig, or from "
            "the board."
        ),
    ] = None,
    mesh: Annotated[
        bool, typer.Option("--mesh", help="Write a watertight mesh where --out is .ply.")
    ] = False,
    voxel_mm: Annotated[
        float | None, typer.Option(help="Side of the voxels in which points are fused, mm.")
    ] = None,
    up: Annotated[
        UpName | None,
        typer.Option(
            help="What is up in a watertight mesh: away from the board, from the side that no view "
            "saw, or an axis of the part; by default the first of these that there is."
        ),
    ] = None,
    origin: Annotated[
        OriginName,
        typer.Option(help="Origin of a watertight mesh: on its plate, or that of the points."),
    ] = OriginName.plate,
) -> None:
    """Merge point clouds of a part that was measured from several sides."""
    words = output.Output(out)
    solid = None
    as_mesh = mesh or out.suffix.lower() in MESHES
    output.check(out, "mesh" if as_mesh else "merged")
    with output.progress() as progress:
        found = fw.merge(
            list(views),
            poses=poses.value,
            board=board,
            step_deg=step_deg,
            rig=rig_file,
            blur_px=blur_px,
            voxel_mm=voxel_mm,
            progress=progress,
        )
        if as_mesh:
            progress("mesh …")
            solid = _standing(found, up or (None if board is None else UpName.board), origin)
    with output.target(out, ".ply") as place:
        if solid is None:
            fw.files.write_merged_points(place, found.points, provenance=found.provenance)
        else:
            fw.files.write_mesh(place, solid)
    from fringeworks.types.numbers import estimate, number, percent

    loop = found.closure
    if loop is not None and loop.directions:
        apart = estimate(loop.translation_mm, loop.translation_sigma_mm, "mm")
        turned = estimate(loop.rotation_deg, loop.rotation_sigma_deg)
        words.say(f"the loop closes to {apart} and ({turned})°")
    if found.blur_px is not None:
        words.say(f"the error of a blur of {number(found.blur_px)} px was removed")
    words.say(f"{len(found.points.xyz_mm)} points of {len(views)} views")
    if solid is not None:
        filled = 0.0 if solid.filled is None else float(solid.filled.mean())
        words.say(
            f"{len(solid.faces)} triangles; {percent(filled)} of the surface was not measured"
        )
    words.found(found.findings)
    words.wrote(out)
