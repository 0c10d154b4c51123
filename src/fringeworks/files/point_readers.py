"""Files of points as tables, one reader for each suffix."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.csv_table import CSV, read_csv
from fringeworks.files.findings import finding_from_dict
from fringeworks.files.limits import check_bytes, check_frame_size, parsing
from fringeworks.files.pcd import read_pcd
from fringeworks.files.placement import PLACEMENT, placement_from, placement_of_comments
from fringeworks.files.ply import read_ply
from fringeworks.files.point_csv import POINTS, points_of_csv
from fringeworks.files.point_table import COLOURS, fields_of
from fringeworks.files.provenance import KEY, from_comments, from_json
from fringeworks.types import (
    FileProblem,
    Finding,
    InputError,
    Placement,
    PointCloud,
    Provenance,
    Reason,
    as_notes,
)

IN_PX = "expected points in mm, got displacements in px; give the geometry to compute heights"
"""What is said about displacements."""


class TableRead(NamedTuple):
    """What a file of points holds."""

    table: NDArray[Any]
    """(n,) with the fields of ``PointTable.parts``, mm."""
    provenance: Provenance | None
    shape: tuple[int, int] | None = None
    """Rows and columns, where the table is a whole frame."""
    findings: tuple[Finding, ...] = ()
    placement: Placement | None = None
    """Coordinates other than the camera's."""


def check_unit(path: Path, comments: Iterable[str]) -> None:
    """Refuse displacements in px, which are no points.

    Raises
    ------
    InputError where the comments of a PLY file say so.
    """
    if any(line.startswith("fringeworks") and line.endswith("unit px") for line in comments):
        raise InputError(f"{path}: {IN_PX}")


def _read_ply(path: Path) -> TableRead:
    table, comments = read_ply(path)
    check_unit(path, comments)
    return TableRead(table, from_comments(comments))


def _read_pcd(path: Path) -> TableRead:
    found = read_pcd(path)
    with parsing(path, "points"):
        placement = placement_of_comments(found.comments)
    return TableRead(found.table, from_comments(found.comments), found.shape, placement=placement)


def _read_csv(path: Path) -> TableRead:
    table = read_csv(path)
    with parsing(path, "points"):
        points, left = points_of_csv(table)
        said = f"left out the columns {', '.join(left)}" if left and not table.kind else ""
        return _told(points, table.details, as_notes([said], "columns") if said else ())


def _read_las(path: Path) -> TableRead:
    from fringeworks.files.las_reader import read_las

    return TableRead(*read_las(path))


def _read_e57(path: Path) -> TableRead:
    from fringeworks.files.e57 import read_e57

    found = read_e57(path)
    with parsing(path, "points"):
        return _told(found.table, found.details)


def _told(
    table: NDArray[Any], details: dict[str, Any], notes: tuple[Finding, ...] = ()
) -> TableRead:
    """A table with what its details say."""
    import json

    origin = from_json(json.dumps(details.get(KEY))) if details.get(KEY) else None
    shape = None
    if details.get("shape") is not None and "reason" in fields_of(table):
        rows, columns = (int(n) for n in details["shape"])
        check_frame_size(columns, rows)
        shape = (rows, columns)
    found = tuple(map(finding_from_dict, details.get("findings", ())))
    placement = placement_from(details.get(PLACEMENT))
    return TableRead(table, origin, shape, (*found, *notes), placement)


TABLE_READERS: dict[str, Callable[[Path], TableRead]] = {
    ".ply": _read_ply,
    ".pcd": _read_pcd,
    CSV: _read_csv,
    ".e57": _read_e57,
    ".las": _read_las,
    ".laz": _read_las,
}
"""Readers by suffix."""
FRAMES = (".pcd", CSV, ".e57")
"""Suffixes of files that can hold all pixels of a frame."""


def holds_points(path: Path) -> bool:
    """Whether a table (CSV) holds points: of fringeworks, or columns of another program."""
    return read_csv(path).kind in ("", POINTS)


def cloud_of(read: TableRead) -> PointCloud:
    """The cloud of a table that is a whole frame.

    Raises
    ------
    FileProblem for another number of rows, pixels outside the frame or twice, and reasons that
    there are not.
    """
    table, shape = read.table, read.shape
    names = fields_of(table)
    if shape is None or len(table) != shape[0] * shape[1]:
        raise FileProblem(f"expected the pixels of a frame {shape}, got {len(table)} rows")
    check_bytes(float(table.nbytes), "points")
    place = _places(table, shape)

    def laid(values: NDArray[Any]) -> NDArray[Any]:
        out = np.empty_like(values)
        out[place] = values
        return out.reshape(*shape, *values.shape[1:])

    if not {"sigma", "noise"} <= set(names) or (table["reason"] >= len(Reason)).any():
        raise FileProblem("expected σ, noise and reasons of every pixel, got others")
    reason = laid(table["reason"].astype(np.uint8))
    xyz = laid(np.column_stack([table[name] for name in "xyz"]).astype(np.float32))
    xyz[reason != Reason.OK] = np.nan
    seen = [name for name in (COLOURS if "red" in names else ("brightness",)) if name in names]
    colour = None
    if seen:
        stacked = np.column_stack([table[name] for name in seen])
        grey = len(seen) == 1 or bool((stacked == stacked[:, :1]).all())
        colour = laid(stacked[:, 0] if grey else stacked)
    optional = {
        field: laid(table[name])
        for name, field in (("residual", "residual_px"), ("blur", "blur_mm"))
        if name in names
    }
    return PointCloud(
        xyz,
        laid(table["sigma"]),
        laid(table["noise"]),
        reason,
        colour=colour,
        provenance=read.provenance,
        findings=read.findings,
        placement=read.placement,
        **optional,
    )


def _places(table: NDArray[Any], shape: tuple[int, int]) -> NDArray[np.int64]:
    """Number of the pixel of every row."""
    if not {"row", "column"} <= set(fields_of(table)):
        return np.arange(len(table))
    rows, columns = table["row"].astype(np.int64), table["column"].astype(np.int64)
    inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
    place = rows * shape[1] + columns
    if not inside.all() or len(np.unique(place)) != len(place):
        raise FileProblem(f"expected each pixel of a frame {shape} once, got others")
    return place
