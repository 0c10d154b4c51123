"""Points as CSV: those of fringeworks, and columns x, y, z of any program."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.csv_table import REASONS, CsvTable, write_csv
from fringeworks.files.placement import PLACEMENT, placement_as_dict
from fringeworks.files.point_table import COLOURS, LENGTHS, NORMAL_AXES, PointTable, fields_of
from fringeworks.types import FileProblem

POINTS = "points"
"""Kind of table that holds points."""
UNITS = {
    "": 1.0,
    "mm": 1.0,
    "m": 1e3,
    "cm": 10.0,
    "µm": 1e-3,
    "μm": 1e-3,
    "um": 1e-3,
    "nm": 1e-6,
    "in": 25.4,
    "inch": 25.4,
}
"""Millimetres of the units that names of columns give; lengths without a unit are in mm."""
NAME = re.compile(r"(\w+?)(?:[_ /\[(]+(mm|cm|µm|μm|um|nm|inch|in|m|px))?[\])]?")
"""A name of a column, with or without a unit."""
ALIASES = {
    **{name: name for name in (*LENGTHS, *COLOURS, *NORMAL_AXES)},
    **{"residual": "residual", "row": "row", "column": "column", "reason": "reason"},
    **{"r": "red", "g": "green", "b": "blue", "σ": "sigma", "brightness": "brightness"},
    **{"intensity": "brightness", "normal_x": "nx", "normal_y": "ny", "normal_z": "nz"},
}
"""Fields by the names of columns, in lower case and without units."""


def write_point_csv(path: Path, table: PointTable) -> None:
    """Write points with a header; lengths in mm, colours in counts, reasons by their names."""
    origin = table.provenance
    details: dict[str, Any] = {"coordinates": table.coordinates}
    if table.shape is not None:
        details["shape"] = list(table.shape)
    details |= {} if origin is None else {"provenance": origin.as_dict()}
    details |= {"findings": table.findings} if table.findings else {}
    if table.placement is not None:
        details[PLACEMENT] = placement_as_dict(table.placement)
    write_csv(path, POINTS, details, map(_columns, table.parts("f4", exact=True)))


def _columns(part: NDArray[Any]) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {}
    for name in fields_of(part):
        unit = "_mm" if name in LENGTHS else "_px" if name == "residual" else ""
        columns[f"{name}{unit}"] = REASONS[part[name]] if name == "reason" else part[name]
    return columns


def points_of_csv(table: CsvTable) -> tuple[NDArray[Any], tuple[str, ...]]:
    """The columns of a table that points have, in mm, and the names of those that are left out.

    Raises
    ------
    FileProblem for a table without columns x, y and z.
    """
    found, left = _places(table)
    if not {"x", "y", "z"} <= found.keys():
        got = told_names(table.names) or f"{table.width} without names"
        raise FileProblem(f"expected columns x, y and z, got {got}")
    numbers = {name: place for name, place in found.items() if name != "reason"}
    values = table.numbers([column for column, _ in numbers.values()])
    points = np.empty(len(values), [(n, "u1" if n == "reason" else "f8") for n in found])
    for (name, (_, scale)), column in zip(numbers.items(), values.T, strict=True):
        points[name] = column * scale
    if "reason" in found:
        points["reason"] = table.reasons(found["reason"][0])
    return points, left


def told_names(names: tuple[str, ...]) -> str:
    """Names of columns for a message."""
    return ", ".join(names[:8])


def _places(table: CsvTable) -> tuple[dict[str, tuple[int, float]], tuple[str, ...]]:
    """Number and scale of the columns by the fields that they are, and names of the others."""
    if not table.names:
        fields = ("x", "y", "z", "sigma") if table.width == 4 else ("x", "y", "z")
        found = {name: (k, 1.0) for k, name in enumerate(fields) if k < table.width}
        return found, tuple(f"column {k + 1}" for k in range(len(found), table.width))
    found, left = {}, []
    for number, name, field, unit in _fields(table.names):
        scale = UNITS.get(unit, 0.0) if field in LENGTHS else 1.0
        if field is None or field in found or not scale:
            left.append(name)
        else:
            found[field] = (number, scale)
    return found, tuple(left)


def _fields(names: tuple[str, ...]) -> Iterator[tuple[int, str, str | None, str]]:
    """Number, name, field and unit of every column."""
    for number, name in enumerate(names):
        whole = name.strip(" /#\"'").lower()
        match = NAME.fullmatch(whole)
        if whole in ALIASES or match is None:
            yield number, name, ALIASES.get(whole), ""
        else:
            yield number, name, ALIASES.get(match[1].strip("_ ")), (match[2] or "")
