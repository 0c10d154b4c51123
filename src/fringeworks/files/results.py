"""Results as files, whatever kind they are."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from fringeworks.files.atomic import StrPath, check_target
from fringeworks.files.coordinates import write_coordinates
from fringeworks.files.points import WRITERS as POINT_WRITERS
from fringeworks.files.points import write_points
from fringeworks.files.surfaces import WRITERS as SURFACE_WRITERS
from fringeworks.files.surfaces import write_surface
from fringeworks.types import Decoded, HeightMap, InputError, PointCloud


def write_result(
    path: StrPath,
    result: HeightMap | PointCloud | Decoded,
    *,
    kind: Literal["points", "normals", "mesh"] = "points",
) -> None:
    """Write heights, points or coordinates in the format of the file's suffix.

    Parameters
    ----------
    path : path
        As for ``write_surface`` and ``write_points``; coordinates as ``.npz``.
    result : HeightMap, PointCloud or Decoded
    kind : "points", "normals" or "mesh"
        Content of a ``.ply`` file.

    Raises
    ------
    InputError for other results, and the errors of ``write_surface``, ``write_points`` and
    ``write_coordinates``.
    """
    if isinstance(result, HeightMap):
        write_surface(path, result, ply=kind)
    elif isinstance(result, PointCloud):
        write_points(path, result, kind=kind)
    elif isinstance(result, Decoded) and Path(path).suffix.lower() == ".npz":
        write_coordinates(path, result)
    else:
        got = "coordinates" if isinstance(result, Decoded) else type(result).__name__
        raise InputError(
            f"{Path(path).name}: expected points or heights, got {got}; coordinates are written as "
            ".npz, and become points with a rig"
        )


def check_result_target(path: StrPath) -> None:
    """Refuse a file that ``write_result`` cannot write, before anything is computed for it."""
    check_target(path, {**POINT_WRITERS, **SURFACE_WRITERS})
