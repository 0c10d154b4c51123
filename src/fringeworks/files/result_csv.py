"""Height maps and projector coordinates as CSV: a row for every pixel of the frame."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.csv_table import CSV, REASONS, CsvTable, read_csv, write_csv
from fringeworks.files.findings import finding_from_dict, findings_as_dicts
from fringeworks.files.limits import check_frame_size, existing_file, parsing, told
from fringeworks.files.point_table import BAND_ROWS
from fringeworks.files.provenance import KEY, from_json
from fringeworks.surface.height_map import height_map_points
from fringeworks.types import (
    Axis,
    CameraNoise,
    CoordinateMap,
    Decoded,
    FileProblem,
    Finding,
    HeightMap,
    Provenance,
)

HEIGHTS, COORDINATES = "heights", "coordinates"
"""Kinds of tables."""
MAPS = ("coordinate_px", "sigma_px", "modulation", "background")
"""Fields of a coordinate map; the names of columns begin with the axis."""


def write_heights_csv(path: Path, surface: HeightMap) -> None:
    """Write a height map: places where the pitch is known, values, σ and reasons."""
    unit = surface.unit
    columns: dict[str, NDArray[Any]] = {}
    if surface.pitch is not None:
        xyz, _, index = height_map_points(surface)
        places = np.full((*surface.shape, 2), np.nan)
        places[index >= 0] = xyz[index[index >= 0], :2]
        columns = {f"x_{unit}": places[..., 0], f"y_{unit}": places[..., 1]}
    columns[f"{surface.quantity}_{unit}"] = surface.values
    columns[f"sigma_{unit}"] = surface.sigma
    columns["reason"] = REASONS[surface.reason]
    details = {
        "shape": surface.shape,
        "quantity": surface.quantity,
        "unit": unit,
        "pitch": surface.pitch,
        "method": surface.method,
        "pupil": surface.pupil,
        "converged": surface.converged,
    }
    _write(path, HEIGHTS, details, surface, columns)


def read_heights_csv(path: Path) -> HeightMap:
    """Read what ``write_heights_csv`` wrote.

    Raises
    ------
    FileProblem for a missing or damaged file, and for a table of something else.
    """
    table = _read(path, HEIGHTS)
    with parsing(path, "a height map as CSV"):
        told_of = table.details
        quantity, unit = str(told_of["quantity"]), str(told_of["unit"])
        if quantity not in ("height", "displacement") or unit not in ("mm", "px"):
            raise FileProblem(f"expected heights or displacements, got {told(quantity)}")
        place, shape = _places(table)
        values, sigma = (
            _laid(table.numbers([_column(table, name)])[:, 0], place, shape)
            for name in (f"{quantity}_{unit}", f"sigma_{unit}")
        )
        reason = table.reasons(_column(table, "reason"))
        pupil, converged = told_of.get("pupil"), told_of.get("converged")
        findings, origin = _kept(table)
        return HeightMap(
            values,
            sigma,
            _laid(reason, place, shape),
            quantity="height" if quantity == "height" else "displacement",
            unit="mm" if unit == "mm" else "px",
            pitch=None if told_of["pitch"] is None else float(told_of["pitch"]),
            method=str(told_of["method"]),
            provenance=origin,
            pupil=None if pupil is None else _three(pupil),
            converged=None if converged is None else bool(converged),
            findings=findings,
        )


def _three(values: Any) -> tuple[float, float, float]:
    x, y, distance = (float(v) for v in values)
    return x, y, distance


def write_coordinates_csv(path: Path, decoded: Decoded) -> None:
    """Write decoded coordinates with σ, modulation, background and reasons, of each axis."""
    columns: dict[str, NDArray[Any]] = {}
    details: dict[str, Any] = {"noise": [decoded.noise.read_counts, decoded.noise.gain]}
    for axis, found in decoded.maps.items():
        columns |= {f"{axis}_{name}": getattr(found, name) for name in MAPS}
        columns[f"{axis}_reason"] = REASONS[found.reason]
        details["shape"] = found.coordinate_px.shape
        details[axis] = {"periods_px": found.periods_px, "repeats_px": found.repeats_px}
    _write(path, COORDINATES, details, decoded, columns)


def read_coordinates_csv(path: Path) -> Decoded:
    """Read what ``write_coordinates_csv`` wrote; phases of the sets are not in it.

    Raises
    ------
    FileProblem for a missing or damaged file, and for a table of something else.
    """
    table = _read(path, COORDINATES)
    with parsing(path, "coordinates as CSV"):
        place, shape = _places(table)
        axes: tuple[Axis, Axis] = ("x", "y")
        x, y = (
            _coordinate_map(table, axis, place, shape) if axis in table.details else None
            for axis in axes
        )
        read, gain = (float(v) for v in table.details["noise"])
        findings, origin = _kept(table)
        return Decoded(x, y, CameraNoise(read, gain), findings, provenance=origin)


def _coordinate_map(
    table: CsvTable, axis: Axis, place: NDArray[np.int64], shape: tuple[int, int]
) -> CoordinateMap:
    values = table.numbers([_column(table, f"{axis}_{name}") for name in MAPS])
    maps = {name: _laid(column, place, shape) for name, column in zip(MAPS, values.T, strict=True)}
    of_axis = table.details[axis]
    repeats = of_axis["repeats_px"]
    return CoordinateMap(
        **maps,
        reason=_laid(table.reasons(_column(table, f"{axis}_reason")), place, shape),
        axis=axis,
        periods_px=tuple(float(p) for p in of_axis["periods_px"]),
        repeats_px=None if repeats is None else float(repeats),
    )


def holds(path: Path) -> str:
    """The kind of a table: points where fringeworks did not write it."""
    return read_csv(existing_file(path, "a table")).kind or "points"


def _write(
    path: Path,
    kind: str,
    details: dict[str, Any],
    thing: HeightMap | Decoded,
    columns: Mapping[str, NDArray[Any]],
) -> None:
    if thing.provenance is not None:
        details[KEY] = thing.provenance.as_dict()
    if thing.findings:
        details["findings"] = findings_as_dicts(thing.findings)
    write_csv(path, kind, details, _bands(columns))


def _bands(columns: Mapping[str, NDArray[Any]]) -> Iterator[dict[str, NDArray[Any]]]:
    """Rows of the frame, some at a time, a row of the table for every pixel."""
    height = len(next(iter(columns.values())))
    for top in range(0, height, BAND_ROWS):
        part = {name: values[top : top + BAND_ROWS] for name, values in columns.items()}
        rows, across = np.indices(next(iter(part.values())).shape)
        pixels = {"row": (rows + top).ravel(), "column": across.ravel()}
        yield pixels | {name: values.ravel() for name, values in part.items()}


def _read(path: Path, kind: str) -> CsvTable:
    table = read_csv(existing_file(path, f"a table ({CSV})"))
    if table.kind != kind:
        raise FileProblem(f"{path}: expected a table of {kind}, got {table.kind or 'another one'}")
    return table


def _column(table: CsvTable, name: str) -> int:
    if name not in table.names:
        raise FileProblem(f"expected a column {name}, got {told(', '.join(table.names))}")
    return table.names.index(name)


def _places(table: CsvTable) -> tuple[NDArray[np.int64], tuple[int, int]]:
    """Numbers of the pixels of all rows, and the shape of the frame."""
    height, width = (int(n) for n in table.details["shape"])
    check_frame_size(width, height)
    rows, columns = table.numbers([_column(table, n) for n in ("row", "column")]).T
    place = (rows * width + columns).astype(np.int64)
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    if len(place) != height * width or not inside.all() or len(np.unique(place)) != len(place):
        raise FileProblem(f"expected each pixel of a frame of {height} × {width} once, got others")
    return place, (height, width)


def _laid(values: NDArray[Any], place: NDArray[np.int64], shape: tuple[int, int]) -> NDArray[Any]:
    """The values of a column on their pixels, (h, w)."""
    out = np.empty_like(values)
    out[place] = values
    return out.reshape(shape)


def _kept(table: CsvTable) -> tuple[tuple[Finding, ...], Provenance | None]:
    """Findings and provenance of a table."""
    findings = tuple(map(finding_from_dict, table.details.get("findings", ())))
    origin = table.details.get(KEY)
    return findings, None if origin is None else from_json(json.dumps(origin))
