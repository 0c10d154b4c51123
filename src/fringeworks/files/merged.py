"""Points without a frame as files: a part that was merged from several views."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from fringeworks.files.atomic import StrPath, check_target, replacing
from fringeworks.files.point_table import PointTable
from fringeworks.files.point_writers import TABLE_WRITERS, need_package
from fringeworks.types import InputError, Points, Provenance


def write_merged_points(
    path: StrPath, points: Points, *, provenance: Provenance | None = None
) -> None:
    """Write points with σ, noise, normals and colour, as far as they have them and the file does.

    Parameters
    ----------
    path : path
        ``.ply``, ``.pcd``, ``.csv``, ``.e57``, ``.las``, ``.laz``, ``.mcap``, ``.vtp``, or
        ``.xyz``, which has σ alone.
    points : Points
    provenance : Provenance, optional
        Written into the file; by default that of the points.

    Raises
    ------
    FileProblem for another suffix and a folder that cannot be written to; InputError for no
    points; MissingPackage where a format needs a package that is not installed.
    """
    check_target(path, TABLE_WRITERS)
    suffix = Path(path).suffix.lower()
    need_package(suffix)
    if not len(points.xyz_mm):
        raise InputError(f"{path}: expected points to write, got none")
    if provenance is not None:
        points = replace(points, provenance=provenance)
    with replacing(path) as temporary:
        TABLE_WRITERS[suffix](temporary, PointTable(points))
