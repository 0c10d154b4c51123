"""``fringeworks mesh``: a cloud cleaned, cropped, and connected by triangles."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import fringeworks as fw
from fringeworks.cli import output
from fringeworks.cli.app import app

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SECTION = "Results"
PRINTED = (".stl", ".3mf")
"""Formats that are mostly printed, and then have to be closed."""


@app.command(
    rich_help_panel=SECTION,
    epilog="Example: fringeworks mesh part.npz --box ::-40:40:450:560 --fill 500 --faces 50000 "
    "--out part.stl",
)
def mesh(
    cloud: Annotated[Path, typer.Argument(help="Cloud to mesh (.npz, or a whole frame).")],
    out: Annotated[
        Path, typer.Option("--out", help="File to write: .stl, .obj, .glb, .3mf or .ply.")
    ],
    clean: Annotated[
        bool, typer.Option(help="Remove isolated points, mixtures on edges and small islands.")
    ] = True,
    island: Annotated[
        int | None, typer.Option(help="Smallest connected surface that is kept, px.")
    ] = None,
    max_sigma: Annotated[
        float | None, typer.Option(help="Largest σ of a point that is kept, mm.")
    ] = None,
    box: Annotated[
        str | None,
        typer.Option(
            help="Box that is kept, in the cloud's coordinates, mm: x1:x2:y1:y2:z1:z2; leave a "
            "limit empty for none."
        ),
    ] = None,
    fill: Annotated[int, typer.Option(help="Largest hole that is filled, px.")] = 0,
    plate: Annotated[
        float | None,
        typer.Option(
            help="Close the mesh for printing by a plate of this thickness behind the part, mm; "
            "z is then up, and the bottom has z = 0."
        ),
    ] = None,
    faces: Annotated[
        int | None, typer.Option(help="Number of triangles to keep at most; all by default.")
    ] = None,
) -> None:
    """Connect a point cloud by triangles, and write it for other programs."""
    words = output.Output(out)
    output.check(out, "mesh")
    if not clean and (island is not None or max_sigma is not None):
        raise fw.InputError("--no-clean: expected none of --island and --max-sigma beside it")
    seen = fw.files.read_cloud(cloud)
    start = seen.reason == fw.Reason.OK
    with output.progress() as progress:
        if box is not None:
            seen = fw.surface.crop_cloud(seen, box_mm=_box(box))
        cropped = seen.reason == fw.Reason.OK
        if clean:
            progress("cleaning …")
            limit = {} if island is None else {"min_island_px": island}
            seen = fw.surface.clean_cloud(seen, max_sigma_mm=max_sigma, **limit)
        progress("triangles …")
        found = _connected(seen, plate, fill)
        if faces is not None:
            progress("fewer triangles …")
            found = fw.surface.decimate(found, faces)
    with output.target(out, ".ply") as place:
        fw.files.write_mesh(place, found)
    kept = seen.reason == fw.Reason.OK
    words.say(
        f"{kept.sum()} of {start.sum()} points ({start.sum() - cropped.sum()} outside the box, "
        f"{cropped.sum() - kept.sum()} removed by cleaning)"
    )
    marked = 0 if found.filled is None else int(found.filled.sum())
    where = "in filled holes" if plate is None else "not measured: the plate, and filled holes"
    filled = f", {marked} of them {where}" if marked else ""
    words.say(f"{len(found.faces)} triangles of {len(found.vertices_mm)} vertices{filled}")
    words.wrote(out)
    if plate is None and out.suffix.lower() in PRINTED:
        where = "camera coordinates" if seen.placement is None else f"coordinates of {seen.frame}"
        words.say(f"the mesh is open, in {where}; to print it, close it with --plate 2")


def _connected(seen: fw.PointCloud, plate: float | None, fill: int) -> fw.TriangleMesh:
    """The open mesh of a cloud, or a closed one that stands on a plate."""
    if plate is None:
        return fw.surface.cloud_mesh(seen, fill_px=fill)
    return fw.surface.solid_relief(seen, plate_mm=plate, fill_px=fill)


def _box(text: str) -> NDArray[np.float64]:
    """Smallest and largest x, y, z from ``x1:x2:y1:y2:z1:z2``."""
    import numpy as np  # when it is used: the command line loads without it

    parts = text.split(":")
    try:
        if len(parts) != 6:
            raise ValueError
        low = [float(part) if part.strip() else -math.inf for part in parts[::2]]
        high = [float(part) if part.strip() else math.inf for part in parts[1::2]]
    except ValueError as error:
        raise fw.InputError(
            f"--box: expected six limits in mm as x1:x2:y1:y2:z1:z2, got {text!r}"
        ) from error
    return np.array([low, high])
