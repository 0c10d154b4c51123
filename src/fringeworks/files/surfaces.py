"""Surfaces as files: TIFF, NPZ, PLY, X3P (ISO 25178-72) and GSF (Gwyddion)."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
import tifffile

from fringeworks.files.atomic import check_target, replacing
from fringeworks.surface.height_map import height_map_points, height_map_triangles
from fringeworks.types import HeightMap, InputError

PlyKind = Literal["points", "mesh"]
X3P_NAMESPACE = "http://www.opengps.eu/2008/ISO5436_2"


def write_surface(path: Path, surface: HeightMap, *, ply: PlyKind = "points") -> None:
    """Write a surface in the format of the file's suffix, whole or not at all.

    Parameters
    ----------
    path : Path
        ``.tif``/``.tiff`` float32 values; ``.npz`` values, σ, reasons, unit and pitch; ``.ply``
        points or mesh with σ; ``.x3p`` (ISO 25178-72, metres); ``.gsf`` (Gwyddion simple field).
    surface : HeightMap
    ply : "points" or "mesh"

    Raises
    ------
    InputError for an unknown suffix, a folder that cannot be written to, or X3P without a
    geometry, since that format holds lengths only.
    """
    check_surface_target(path)
    with replacing(Path(path)) as temporary:
        WRITERS[Path(path).suffix.lower()](temporary, surface, ply)


def check_surface_target(path: Path) -> None:
    """``files.check_target`` for the kinds that are written here."""
    check_target(path, WRITERS)


def _write_tiff(path: Path, surface: HeightMap, _: PlyKind) -> None:
    description = {
        "quantity": surface.quantity,
        "unit": surface.unit,
        "pitch": surface.pitch,
        "method": surface.method,
    }
    tifffile.imwrite(path, surface.values.astype(np.float32), metadata=description)


def _write_npz(path: Path, surface: HeightMap, _: PlyKind) -> None:
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            values=surface.values,
            sigma=surface.sigma,
            reason=surface.reason,
            quantity=surface.quantity,
            unit=surface.unit,
            pitch=surface.pitch,
            method=surface.method,
        )


def read_npz(path: Path) -> HeightMap:
    """Read a surface that ``write_surface`` wrote as ``.npz``."""
    try:
        with np.load(path, allow_pickle=False) as data:
            quantity, unit = str(data["quantity"]), str(data["unit"])
            return HeightMap(
                values=data["values"],
                sigma=data["sigma"],
                reason=data["reason"],
                quantity="height" if quantity == "height" else "displacement",
                unit="mm" if unit == "mm" else "px",
                pitch=float(data["pitch"]),
                method=str(data["method"]),
            )
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: expected a surface written as .npz, got: {error}") from error


def _write_ply(path: Path, surface: HeightMap, kind: PlyKind) -> None:
    xyz, sigma, index = height_map_points(surface)
    vertex = np.empty(len(xyz), dtype=[(name, "<f4") for name in ("x", "y", "z", "sigma")])
    vertex["x"], vertex["y"], vertex["z"] = xyz.T
    vertex["sigma"] = sigma
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment fringeworks {surface.method} {surface.quantity}; unit {surface.unit}",
        f"element vertex {len(vertex)}",
        *(f"property float {name}" for name in ("x", "y", "z", "sigma")),
    ]
    faces = np.empty(0, dtype=[("n", "u1"), ("index", "<i4", (3,))])
    if kind == "mesh":
        corners = height_map_triangles(surface, index)
        faces = np.empty(len(corners), dtype=faces.dtype)
        faces["n"], faces["index"] = 3, corners
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    with path.open("wb") as file:
        file.write(("\n".join([*header, "end_header"]) + "\n").encode("ascii"))
        file.write(vertex.tobytes())
        file.write(faces.tobytes())


def _write_gsf(path: Path, surface: HeightMap, _: PlyKind) -> None:
    rows, columns = surface.shape
    in_mm = surface.unit == "mm"
    lateral = surface.pitch * (1e-3 if in_mm else 1.0)
    fields = {
        "XRes": columns,
        "YRes": rows,
        "XReal": f"{columns * lateral:.9g}",
        "YReal": f"{rows * lateral:.9g}",
        "XYUnits": "m" if in_mm else "px",
        "ZUnits": "m" if in_mm else "px",
        "Title": f"{surface.method} {surface.quantity}".strip(),
    }
    text = "Gwyddion Simple Field 1.0\n" + "".join(f"{k} = {v}\n" for k, v in fields.items())
    header = text.encode("utf-8")
    # One to four NULs bring the data to a multiple of four bytes.
    header += b"\0" * (4 - len(header) % 4)
    values = surface.values * (1e-3 if in_mm else 1.0)
    path.write_bytes(header + np.ascontiguousarray(values, dtype="<f4").tobytes())


def _axis(parent: ET.Element, name: str, kind: str, data_type: str, increment: float) -> None:
    axis = ET.SubElement(parent, name)
    for tag, value in (
        ("AxisType", kind),
        ("DataType", data_type),
        ("Increment", repr(increment)),
        ("Offset", "0"),
    ):
        ET.SubElement(axis, tag).text = value


def _tree(parent: ET.Element, content: dict[str, object]) -> None:
    for tag, value in content.items():
        child = ET.SubElement(parent, tag)
        if isinstance(value, dict):
            _tree(child, value)
        else:
            child.text = str(value)


def _x3p_description(surface: HeightMap, checksum: str) -> bytes:
    ET.register_namespace("p", X3P_NAMESPACE)
    root = ET.Element(f"{{{X3P_NAMESPACE}}}ISO5436_2")
    first = ET.SubElement(root, "Record1")
    _tree(first, {"Revision": "ISO5436 - 2000", "FeatureType": "SUR"})
    axes = ET.SubElement(first, "Axes")
    pitch = surface.pitch * 1e-3
    _axis(axes, "CX", "I", "D", pitch)
    _axis(axes, "CY", "I", "D", pitch)
    _axis(axes, "CZ", "A", "D", 1.0)
    rows, columns = surface.shape
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    _tree(
        root,
        {
            "Record2": {
                "Date": now,
                "Creator": "fringeworks",
                "Instrument": {
                    "Manufacturer": "fringeworks",
                    "Model": "fringe projection",
                    "Serial": "not available",
                    "Version": "1",
                },
                "CalibrationDate": now,
                "ProbingSystem": {"Type": "NonContacting", "Identification": surface.method},
                "Comment": "heights over the reference plane, NaN where not measured",
            },
            "Record3": {
                "MatrixDimension": {"SizeX": columns, "SizeY": rows, "SizeZ": 1},
                "DataLink": {
                    "PointDataLink": "bindata/data.bin",
                    "MD5ChecksumPointData": checksum,
                },
            },
            "Record4": {"ChecksumFile": "md5checksum.hex"},
        },
    )
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True))


def _write_x3p(path: Path, surface: HeightMap, _: PlyKind) -> None:
    if surface.unit != "mm":
        raise InputError(
            "x3p: expected heights in mm, got displacements in px; give the geometry "
            "or write .tif, .npz or .gsf"
        )
    data = np.ascontiguousarray(surface.values * 1e-3, dtype="<f8").tobytes()
    description = _x3p_description(surface, hashlib.md5(data, usedforsecurity=False).hexdigest())
    checksum = hashlib.md5(description, usedforsecurity=False).hexdigest()
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("main.xml", description)
        archive.writestr("bindata/data.bin", data)
        archive.writestr("md5checksum.hex", f"{checksum} *main.xml\n")


WRITERS: dict[str, Callable[[Path, HeightMap, PlyKind], None]] = {
    ".tif": _write_tiff,
    ".tiff": _write_tiff,
    ".npz": _write_npz,
    ".ply": _write_ply,
    ".x3p": _write_x3p,
    ".gsf": _write_gsf,
}
"""Writers by suffix."""
