"""Points, meshes and rasters as XML files of VTK, which ParaView opens: VTP and VTI."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.point_table import COLOURS, NORMAL_AXES, PointTable, fields_of
from fringeworks.files.provenance import json_line
from fringeworks.types import (
    Decoded,
    FloatMap,
    HeightMap,
    PointCloud,
    Provenance,
    Reason,
    TriangleMesh,
)

VTP, VTI = ".vtp", ".vti"
"""Suffixes: points and triangles, and rasters."""
NAMES = {"f4": "Float32", "f8": "Float64", "u1": "UInt8", "u2": "UInt16", "u4": "UInt32"}
NAMES |= {"i4": "Int32", "i8": "Int64"}
"""VTK's names of the types that are written."""
LENGTHS_MM = ("sigma", "noise", "blur")
"""Fields of points that are lengths; their arrays say so by "_mm"."""


def _quoted(text: str) -> str:
    """Quote an attribute of XML."""
    # The module loads all of HTTP, and is not needed by files of other kinds.
    from xml.sax import saxutils

    return saxutils.quoteattr(text)


def _array(name: str, values: NDArray[Any], components: int = 1) -> str:
    """One array: base64 of its length in bytes and its numbers, little-endian."""
    kind = values.dtype.kind + str(values.dtype.itemsize)
    content = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"), copy=False)
    raw = content.tobytes()
    text = base64.b64encode(len(raw).to_bytes(8, "little") + raw).decode("ascii")
    return (
        f"<DataArray type={_quoted(NAMES[kind])} Name={_quoted(name)} "
        f'NumberOfComponents="{components}" format="binary">{text}</DataArray>\n'
    )


def _text(name: str, lines: Sequence[str]) -> str:
    """Lines of text as VTK writes them: the numbers of their bytes, each line ended by 0."""
    numbers = " ".join(str(byte) for line in lines for byte in (*line.encode(), 0))
    return (
        f'<DataArray type="String" Name={_quoted(name)} NumberOfTuples="{len(lines)}" '
        f'format="ascii">{numbers}</DataArray>\n'
    )


def _fields(origin: Provenance | None, **more: Sequence[str]) -> str:
    """What is said about the whole: provenance, and names."""
    said = dict(more)
    if origin is not None:
        said["provenance"] = (str(json_line(origin)),)
    inner = "".join(_text(name, lines) for name, lines in said.items())
    return f"<FieldData>\n{inner}</FieldData>\n" if inner else ""


def _file(path: Path, kind: str, head: str, parts: Iterator[str]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write('<?xml version="1.0"?>\n')
        file.write(
            f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" '
            f'header_type="UInt64">\n<{kind}{head}>\n'
        )
        _written(file, parts)
        file.write(f"</{kind}>\n</VTKFile>\n")


def _written(file: IO[str], parts: Iterator[str]) -> None:
    for part in parts:
        file.write(part)


# Points and triangles.


def _poly(
    points: FloatMap,
    data: Mapping[str, NDArray[Any]],
    faces: NDArray[Any] | None,
    origin: Provenance | None,
) -> Iterator[str]:
    count = len(points)
    yield _fields(origin)
    cells = count if faces is None else len(faces)
    kind = "Verts" if faces is None else "Polys"
    yield f'<Piece NumberOfPoints="{count}" NumberOf{kind}="{cells}">\n<PointData>\n'
    for name, values in data.items():
        yield _array(name, values, 1 if values.ndim == 1 else values.shape[1])
    yield "</PointData>\n<Points>\n"
    yield _array("Points", np.asarray(points, np.float32), 3)
    corners = 1 if faces is None else 3
    places = np.arange(count) if faces is None else np.asarray(faces).ravel()
    yield f"</Points>\n<{kind}>\n{_array('connectivity', places.astype(np.int64))}"
    yield _array("offsets", corners * np.arange(1, cells + 1, dtype=np.int64))
    yield f"</{kind}>\n</Piece>\n"


def write_points_as_vtp(
    path: Path, table: PointTable, faces: NDArray[np.int32] | None = None
) -> None:
    """Write points, or a mesh of them, with σ and what else they have as arrays."""
    parts = list(table.parts())
    rows = np.concatenate(parts)
    names = fields_of(parts[0])
    data: dict[str, NDArray[Any]] = {}
    if NORMAL_AXES[0] in names:
        data["normals"] = _together(rows, NORMAL_AXES)
    if COLOURS[0] in names:
        data["colour"] = _together(rows, COLOURS)
    used = {"x", "y", "z", *NORMAL_AXES, *COLOURS}
    for name in names:
        if name not in used:
            data[f"{name}_mm" if name in LENGTHS_MM else name] = rows[name]
    _file(path, "PolyData", "", _poly(_together(rows, "xyz"), data, faces, table.provenance))


def _together(rows: NDArray[Any], names: Sequence[str]) -> NDArray[Any]:
    return np.stack([rows[name] for name in names], axis=-1)


def write_mesh_as_vtp(path: Path, mesh: TriangleMesh) -> None:
    """Write a mesh with σ, colour and the mark of filled vertices as arrays."""
    known = {"sigma_mm": mesh.sigma_mm, "colour": mesh.colour}
    data = {name: np.asarray(v, np.float32) for name, v in known.items() if v is not None}
    if mesh.filled is not None:
        data["filled"] = mesh.filled.astype(np.uint8)
    _file(path, "PolyData", "", _poly(mesh.vertices_mm, data, mesh.faces, mesh.provenance))


# Rasters.


def _raster(
    maps: Mapping[str, NDArray[Any]], shape: tuple[int, int], origin: Provenance | None
) -> Iterator[str]:
    """Maps of pixels; rows are turned over, because y points up in VTK."""
    height, width = shape
    yield _fields(origin, reasons=[reason.name.lower() for reason in Reason])
    yield f'<Piece Extent="0 {width - 1} 0 {height - 1} 0 0">\n<PointData>\n'
    for name, values in maps.items():
        turned = values[::-1]
        single = turned.astype(np.float32) if turned.dtype.kind == "f" else turned
        yield _array(name, single, 1 if values.ndim == 2 else values.shape[2])
    yield "</PointData>\n<CellData>\n</CellData>\n</Piece>\n"


def _write_raster(
    path: Path, maps: Mapping[str, NDArray[Any]], pitch: float, origin: Provenance | None
) -> None:
    shape = next(iter(maps.values())).shape[:2]
    extent = f"0 {shape[1] - 1} 0 {shape[0] - 1} 0 0"
    head = f' WholeExtent="{extent}" Origin="0 0 0" Spacing="{pitch:.9g} {pitch:.9g} 1"'
    _file(path, "ImageData", head, _raster(maps, (shape[0], shape[1]), origin))


def write_heights_as_vti(path: Path, surface: HeightMap) -> None:
    """Write a height map as a raster: values, σ and reasons; in mm where the pitch is known."""
    maps = {
        f"{surface.quantity}_{surface.unit}": surface.values,
        f"sigma_{surface.unit}": surface.sigma,
        "reason": surface.reason.astype(np.uint8),
    }
    _write_raster(path, maps, surface.pitch or 1.0, surface.provenance)


def write_cloud_as_vti(path: Path, cloud: PointCloud) -> None:
    """Write a point cloud as a raster of its pixels: places, σ, noise and reasons."""
    maps: dict[str, NDArray[Any]] = {
        "xyz_mm": cloud.xyz_mm,
        "depth_mm": cloud.xyz_mm[..., 2],
        "sigma_mm": cloud.sigma_mm,
        "noise_mm": cloud.noise_mm,
        "reason": cloud.reason.astype(np.uint8),
    }
    more = {"residual_px": cloud.residual_px, "blur_mm": cloud.blur_mm}
    maps |= {name: values for name, values in more.items() if values is not None}
    if cloud.colour is not None:
        maps["colour"] = np.asarray(cloud.colour, np.float32)
    _write_raster(path, maps, 1.0, cloud.provenance)


def write_coordinates_as_vti(path: Path, decoded: Decoded) -> None:
    """Write projector coordinates as a raster of the camera's pixels, for each axis."""
    maps: dict[str, NDArray[Any]] = {}
    for axis, found in decoded.maps.items():
        maps[f"{axis}_coordinate_px"] = found.coordinate_px
        maps[f"{axis}_sigma_px"] = found.sigma_px
        maps[f"{axis}_modulation"] = found.modulation
        maps[f"{axis}_reason"] = found.reason.astype(np.uint8)
    _write_raster(path, maps, 1.0, decoded.provenance)
