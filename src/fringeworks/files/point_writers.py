"""Tables of points as files, one writer for each suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.csv_table import CSV
from fringeworks.files.pcd import write_pcd
from fringeworks.files.placement import placement_lines
from fringeworks.files.ply import write_ply
from fringeworks.files.point_table import Kind, PointTable, fields_of
from fringeworks.files.provenance import comment_lines
from fringeworks.files.ros import write_point_bag
from fringeworks.files.vtk import VTP, write_points_as_vtp
from fringeworks.types import InputError, PointCloud, today

KINDS: dict[str, tuple[Kind, ...]] = {
    ".ply": ("points", "normals", "mesh"),
    ".pcd": ("points", "normals", "frame"),
    CSV: ("points", "normals", "frame"),
    ".e57": ("points", "normals", "frame"),
    ".las": ("points", "normals"),
    ".laz": ("points", "normals"),
    ".mcap": ("points", "normals", "frame"),
    ".xyz": ("points",),
    VTP: ("points", "normals", "mesh"),
}
"""What files hold, by suffix; others hold all arrays of a cloud, whatever is asked for."""
CONTENT = {
    "mesh": "triangles",
    "frame": "all pixels of the frame, measured or not",
    "normals": "normals",
    "points": "points",
}
"""Words for them."""


def check_kind(path: Path, kind: str) -> None:
    """Refuse what a kind of files cannot hold.

    Raises
    ------
    InputError that says so.
    """
    if kind not in CONTENT:
        raise InputError(f"kind: expected one of {', '.join(CONTENT)}, got {kind!r}")
    suffix = path.suffix.lower()
    if kind not in KINDS.get(suffix, tuple(CONTENT)):
        fitting = ", ".join(one for one, kinds in KINDS.items() if kind in kinds)
        raise InputError(
            f"{path}: expected points, got {CONTENT[kind]}, which {suffix[1:].upper()} cannot "
            f"hold; {fitting} can"
        )


def write_table_as_ply(
    path: Path, table: PointTable, faces: NDArray[np.int32] | None = None
) -> None:
    """Write points, or a mesh, as PLY."""
    comments = [f"fringeworks; {table.coordinates}; unit mm", *_comments(table)]
    write_ply(path, table.parts(), table.count, faces, comments)


def _write_pcd(path: Path, table: PointTable) -> None:
    # Viewers and filters of the Point Cloud Library expect the neighbours of a pixel beside it.
    table = replace(table, organised=isinstance(table.thing, PointCloud))
    comments = [f"fringeworks; {table.coordinates}; unit mm", *_comments(table)]
    place = None if table.placement is None else table.placement.T_frame_camera
    write_pcd(path, table.parts(), table.shape or (1, table.count), comments, place)


def _comments(table: PointTable) -> list[str]:
    """Coordinates that are not the camera's, and the provenance, as lines of a header."""
    return [*placement_lines(table.placement), *comment_lines(table.provenance)]


def _write_xyz(path: Path, table: PointTable) -> None:
    parts = list(table.parts(exact=True))
    names = [name for name in ("x", "y", "z", "sigma") if name in fields_of(parts[0])]
    columns = [np.concatenate([part[name] for part in parts]) for name in names]
    header = [" ".join(f"{name}_mm" for name in names), *_comments(table)]
    np.savetxt(path, np.column_stack(columns), fmt="%.5f", header="\n".join(header))


def _write_mcap(path: Path, table: PointTable) -> None:
    table = replace(table, organised=isinstance(table.thing, PointCloud))
    date = table.provenance.date if table.provenance is not None else ""
    points = np.concatenate(list(table.parts()))
    write_point_bag(path, points, table.shape or (1, table.count), table.frame, date or today())


def _write_csv(path: Path, table: PointTable) -> None:
    from fringeworks.files.point_csv import write_point_csv

    write_point_csv(path, table)


def _write_las(path: Path, table: PointTable) -> None:
    from fringeworks.files.las import write_las

    write_las(path, table)


def _write_e57(path: Path, table: PointTable) -> None:
    from fringeworks.files.e57 import write_e57

    write_e57(path, table)


TABLE_WRITERS: dict[str, Callable[[Path, PointTable], Any]] = {
    ".ply": write_table_as_ply,
    ".xyz": _write_xyz,
    ".pcd": _write_pcd,
    ".mcap": _write_mcap,
    CSV: _write_csv,
    ".e57": _write_e57,
    ".las": _write_las,
    ".laz": _write_las,
    VTP: write_points_as_vtp,
}
"""Writers by suffix."""


def need_package(suffix: str) -> None:
    """Refuse a kind of files whose package is missing, before anything is computed for it.

    Raises
    ------
    MissingPackage that says what to install.
    """
    if suffix == ".e57":
        from fringeworks.files.e57 import need_pye57

        need_pye57()
    elif suffix in (".las", ".laz"):
        from fringeworks.files.las import need_laspy

        need_laspy(suffix)
    elif suffix == ".mcap":
        from fringeworks.files.ros import need_rosbags

        need_rosbags()
