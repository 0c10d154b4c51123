"""Points as E57 files (ASTM E2807), by the package pye57: written here, read in a process."""

from __future__ import annotations

import errno
import io
import json
import uuid
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.files.apart import read_apart
from fringeworks.files.limits import existing_file, max_bytes, parsing
from fringeworks.files.placement import PLACEMENT, placement_as_dict
from fringeworks.files.point_table import LENGTHS, PointTable, fields_of
from fringeworks.types import FileProblem, MissingPackage, Reason

METRE = 1e-3
"""m/mm: the standard counts in metres."""
PLACES = {"x": "cartesianX", "y": "cartesianY", "z": "cartesianZ"}
"""Names of places."""
FIELDS = {
    **PLACES,
    **{"red": "colorRed", "green": "colorGreen", "blue": "colorBlue"},
    **{"brightness": "intensity", "row": "rowIndex", "column": "columnIndex"},
    **{"nx": "nor:normalX", "ny": "nor:normalY", "nz": "nor:normalZ"},
    **{name: f"fw:{name}" for name in ("sigma", "noise", "residual", "blur", "reason")},
}
"""Names in E57 files by those of a table."""
EXTENSIONS = {
    "nor": "http://www.libe57.org/E57_NOR_surface_normals.txt",
    "fw": "https://github.com/fringeworks/fringeworks/blob/main/docs/files.md",
}
"""Addresses that the standard wants for the names before a colon."""
INVALID = "cartesianInvalidState"
"""Field that says whether a point has a place: 0 for yes, 2 for no."""
NO_PLACE = 2
"""Its value where there is no place."""
CPU_SECONDS = 120
"""Processor time that reading may take; 10 million points take about 5 s."""
LARGEST_COLOUR = 255
"""Limit of a colour of 8 bits."""


class E57Points(NamedTuple):
    """What an E57 file holds."""

    table: NDArray[Any]
    """(n,), lengths in mm, those of several scans in the coordinates of the file."""
    details: dict[str, Any]
    """Provenance, findings and shape of the frame, where fringeworks wrote the file."""


def need_pye57() -> Any:
    """The library that writes E57.

    Raises
    ------
    MissingPackage where the package ``pye57`` (the extra "export") is not installed.
    """
    try:
        return import_module("pye57.libe57")
    except ImportError as error:
        raise MissingPackage(
            "E57 files: expected the package pye57, got none; pip install 'fringeworks[export]'"
        ) from error


def write_e57(path: Path, table: PointTable) -> None:
    """Write points as one scan, in metres, with σ, noise and reasons as fields of an extension.

    Raises
    ------
    MissingPackage as ``need_pye57``.
    """
    lib = need_pye57()
    points = np.concatenate(list(table.parts(exact=True)))
    columns = _columns(points)
    details: dict[str, Any] = {"shape": table.shape, "findings": table.findings}
    if table.placement is not None:
        details[PLACEMENT] = placement_as_dict(table.placement)
    details["provenance"] = None if table.provenance is None else table.provenance.as_dict()
    try:
        file = lib.ImageFile(str(path), "w")
        try:
            _fill(lib, file, table, columns, details)
        finally:
            file.close()
    except lib.E57Exception as error:
        # What the library says of a full disk has many lines.
        raise OSError(errno.EIO, "not all of it could be written") from error


def _fill(
    lib: Any,
    file: Any,
    table: PointTable,
    columns: dict[str, NDArray[Any]],
    details: dict[str, Any],
) -> None:
    """Put one scan into a file that is open."""
    # Equal results are equal files: the identity of a file is that of its content.
    identity = uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(details) + _digest(columns))
    root = file.root()
    file.extensionsAdd("", lib.E57_V1_0_URI)
    for name, address in EXTENSIONS.items():
        file.extensionsAdd(name, address)
    root.set("formatName", lib.StringNode(file, "ASTM E57 3D Imaging Data File"))
    root.set("guid", lib.StringNode(file, f"{{{identity}}}"))
    root.set("versionMajor", lib.IntegerNode(file, lib.E57_FORMAT_MAJOR))
    root.set("versionMinor", lib.IntegerNode(file, lib.E57_FORMAT_MINOR))
    root.set("e57LibraryVersion", lib.StringNode(file, lib.E57_LIBRARY_ID))
    root.set("coordinateMetadata", lib.StringNode(file, ""))
    scans = lib.VectorNode(file, True)
    root.set("data3D", scans)
    root.set("images2D", lib.VectorNode(file, True))
    scan = lib.StructureNode(file)
    scans.append(scan)
    scan.set("guid", lib.StringNode(file, f"{{{uuid.uuid5(identity, 'scan')}}}"))
    scan.set("name", lib.StringNode(file, table.coordinates))
    scan.set("fw:details", lib.StringNode(file, json.dumps(details)))
    _set_limits(lib, file, scan, columns)
    _write_points(lib, file, scan, columns)


def _digest(columns: dict[str, NDArray[Any]]) -> str:
    import hashlib

    state = hashlib.sha256()
    for values in columns.values():
        state.update(values.data)
    return state.hexdigest()


def _columns(points: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Columns by their names in the file."""
    columns: dict[str, NDArray[Any]] = {}
    for name in fields_of(points):
        values = points[name]
        if name in LENGTHS:
            values = values * values.dtype.type(METRE)
        elif values.dtype == np.uint32:
            # The library knows no unsigned numbers of 32 bits, and takes C's long for 32 bits.
            values = values.astype(np.longlong)
        columns[FIELDS[name]] = np.ascontiguousarray(values)
    if FIELDS["reason"] in columns:
        lost = columns[FIELDS["reason"]] != Reason.OK
        columns[INVALID] = np.where(lost, NO_PLACE, 0).astype(np.uint8)
        for name in PLACES.values():
            columns[name] = np.where(lost, 0, columns[name])  # readers may not expect NaN
    return columns


def _set_limits(lib: Any, file: Any, scan: Any, columns: dict[str, NDArray[Any]]) -> None:
    """The ends of the places, of the pixels and of the colours, as the standard wants them."""
    bounds = lib.StructureNode(file)
    seen = (
        columns[INVALID] == 0 if INVALID in columns else np.ones(len(columns["cartesianX"]), bool)
    )
    for axis, name in PLACES.items():
        values = columns[name][seen]
        bounds.set(f"{axis}Minimum", lib.FloatNode(file, float(values.min())))
        bounds.set(f"{axis}Maximum", lib.FloatNode(file, float(values.max())))
    scan.set("cartesianBounds", bounds)
    if "colorRed" in columns:
        limits = lib.StructureNode(file)
        for name in ("Red", "Green", "Blue"):
            limits.set(f"color{name}Minimum", lib.IntegerNode(file, 0))
            limits.set(f"color{name}Maximum", lib.IntegerNode(file, LARGEST_COLOUR))
        scan.set("colorLimits", limits)
    if "rowIndex" in columns:
        index = lib.StructureNode(file)
        for name in ("row", "column"):
            values = columns[f"{name}Index"]
            index.set(f"{name}Minimum", lib.IntegerNode(file, int(values.min())))
            index.set(f"{name}Maximum", lib.IntegerNode(file, int(values.max())))
        index.set("returnMinimum", lib.IntegerNode(file, 0))
        index.set("returnMaximum", lib.IntegerNode(file, 0))
        scan.set("indexBounds", index)


def _write_points(lib: Any, file: Any, scan: Any, columns: dict[str, NDArray[Any]]) -> None:
    kinds = {"f4": lib.E57_SINGLE, "f8": lib.E57_DOUBLE}
    prototype, buffers = lib.StructureNode(file), lib.VectorSourceDestBuffer()
    count = len(columns["cartesianX"])
    for name, values in columns.items():
        if values.dtype.kind == "f":
            node = lib.FloatNode(file, 0.0, kinds[values.dtype.str[1:]])
        else:
            most = max(int(values.max()), LARGEST_COLOUR if name.startswith("color") else 1)
            node = lib.IntegerNode(file, 0, 0, most)
        prototype.set(name, node)
        buffers.append(lib.SourceDestBuffer(file, name, values, count, True, True))
    points = lib.CompressedVectorNode(file, prototype, lib.VectorNode(file, True))
    scan.set("points", points)
    writer = points.writer(buffers)
    writer.write(count)
    writer.close()


def read_e57(path: Path) -> E57Points:
    """The points of an E57 file of any program, all scans in the file's coordinates.

    Raises
    ------
    FileProblem for a missing or damaged file; MissingPackage as ``need_pye57``.
    """
    path = existing_file(path, "an E57 file")
    need_pye57()
    with parsing(path, "an E57 file"):
        most = max_bytes()
        given = [str(path), str(most)]
        content = read_apart("e57_process.py", given, most, CPU_SECONDS, "a readable E57 file")
        arrays = np.load(io.BytesIO(content), allow_pickle=False)
        scans: dict[str, dict[str, NDArray[Any]]] = {}
        for key in arrays.files:
            number, _, name = key.partition("/")
            scans.setdefault(number, {})[name] = arrays[key]
        tables = [_table(scan) for scan in scans.values()]
        if not tables:
            raise FileProblem("expected a scan, got none")
        shared = [n for n in fields_of(tables[0]) if all(n in fields_of(t) for t in tables)]
        several = len(tables) > 1
        whole = np.concatenate([table[shared] for table in tables]) if several else tables[0]
        text = str(scans["0"].get("details", "{}"))
        return E57Points(whole, json.loads(text) if not several else {})


def _table(scan: dict[str, NDArray[Any]]) -> NDArray[Any]:
    """The points of a scan in the file's coordinates, mm; NaN where a point has no place."""
    if "cartesianX" in scan:
        xyz = np.column_stack([scan[name] for name in PLACES.values()])
    else:
        distance, azimuth, elevation = (
            scan[f"spherical{name}"] for name in ("Range", "Azimuth", "Elevation")
        )
        level = distance * np.cos(elevation)
        xyz = np.column_stack(
            (level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation))
        )
    lost = np.zeros(len(xyz), bool)
    for name in (INVALID, "sphericalInvalidState"):
        lost |= scan.get(name, lost) != 0
    pose = scan["pose"]
    turn = scipy.spatial.transform.Rotation.from_quat(pose[[1, 2, 3, 0]])
    xyz = (turn.apply(xyz) if len(xyz) else xyz) + pose[4:]
    xyz[lost] = np.nan
    names = [name for name in FIELDS if FIELDS[name] in scan and name not in PLACES]
    table = np.empty(len(xyz), [(name, "f8") for name in (*"xyz", *names)])
    for name, values in zip("xyz", xyz.T, strict=True):
        table[name] = values / METRE
    for name in names:
        table[name] = scan[FIELDS[name]] / (METRE if name in LENGTHS else 1.0)
    if {"nx", "ny", "nz"} <= set(names) and len(xyz):
        turned = turn.apply(np.column_stack([table[n] for n in ("nx", "ny", "nz")]))
        table["nx"], table["ny"], table["nz"] = turned.T
    return table
