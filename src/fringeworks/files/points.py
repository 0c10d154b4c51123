"""Point clouds as files: PLY (points or mesh), XYZ and NPZ."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.atomic import check_target, replacing
from fringeworks.surface.cloud import cloud_triangles, normals
from fringeworks.types import FloatMap, InputError, PointCloud, Reason

Kind = Literal["points", "mesh"]
PLY_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    **{f"int{8 * n}": f"i{n}" for n in (1, 2, 4)},
    **{f"uint{8 * n}": f"u{n}" for n in (1, 2, 4)},
    "float32": "f4",
    "float64": "f8",
}
HEADER_LIMIT = 1 << 16


@dataclass(frozen=True, eq=False)
class Points:
    """Points without their place in a frame, as a file has them."""

    xyz_mm: FloatMap
    """(n, 3)"""
    sigma_mm: FloatMap | None
    """(n,); None where the file has none."""


def write_points(path: Path, cloud: PointCloud, *, kind: Kind = "points") -> None:
    """Write a point cloud in the format of the file's suffix, whole or not at all.

    Parameters
    ----------
    path : Path
        ``.ply`` points or mesh with normals, σ and brightness; ``.xyz`` text, x y z σ in mm;
        ``.npz`` everything, organised as the frame is.
    cloud : PointCloud
    kind : "points" or "mesh"
        What a ``.ply`` file holds.

    Raises
    ------
    InputError for another suffix, a cloud without points, or a folder that cannot be written to.
    """
    check_points_target(path)
    if not (cloud.reason == Reason.OK).any():
        raise InputError(f"{path}: expected points to write, got none")
    with replacing(Path(path)) as temporary:
        WRITERS[Path(path).suffix.lower()](temporary, cloud, kind)


def check_points_target(path: Path) -> None:
    """``files.check_target`` for the kinds that are written here."""
    check_target(path, WRITERS)


def _write_ply(path: Path, cloud: PointCloud, kind: Kind) -> None:
    ok = cloud.reason == Reason.OK
    names = ["x", "y", "z", "nx", "ny", "nz", "sigma"]
    fields: list[tuple[str, str]] = [(name, "<f4") for name in names]
    colours = _colours(cloud)
    if colours is not None:
        fields += [(name, "u1") for name in ("red", "green", "blue")]
    vertex = np.empty(int(ok.sum()), dtype=fields)
    vertex["x"], vertex["y"], vertex["z"] = cloud.xyz_mm[ok].T
    # Readers expect numbers: a point too lonely for a normal has none, which is 0, 0, 0.
    vertex["nx"], vertex["ny"], vertex["nz"] = np.nan_to_num(normals(cloud)[ok]).T
    vertex["sigma"] = cloud.sigma_mm[ok]
    if colours is not None:
        vertex["red"], vertex["green"], vertex["blue"] = colours[ok].T
    kinds = {"<f4": "float", "u1": "uchar"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment fringeworks; camera coordinates, x right, y down, z forward; unit mm",
        f"element vertex {len(vertex)}",
        *(f"property {kinds[type_]} {name}" for name, type_ in fields),
    ]
    faces = np.empty(0, dtype=[("n", "u1"), ("index", "<i4", (3,))])
    if kind == "mesh":
        corners = cloud_triangles(cloud)
        place = np.cumsum(ok.ravel()) - 1
        faces = np.empty(len(corners), dtype=faces.dtype)
        faces["n"], faces["index"] = 3, place[corners]
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    with path.open("wb") as file:
        file.write(("\n".join([*header, "end_header"]) + "\n").encode("ascii"))
        file.write(vertex.tobytes())
        file.write(faces.tobytes())


def _colours(cloud: PointCloud) -> NDArray[np.uint8] | None:
    """Brightness or colour in 8 bits, the brightest of 99.5 % as white; (h, w, 3)."""
    if cloud.colour is None:
        return None
    values = np.asarray(cloud.colour, np.float64)
    if values.ndim == 2:
        values = np.repeat(values[..., None], 3, axis=2)
    shown = values[cloud.reason == Reason.OK]
    top = max(float(np.nanpercentile(shown, 99.5)), 1e-9)
    scaled = np.nan_to_num(values) * (255.0 / top)
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)


def _write_xyz(path: Path, cloud: PointCloud, _: Kind) -> None:
    ok = cloud.reason == Reason.OK
    table = np.column_stack((cloud.xyz_mm[ok], cloud.sigma_mm[ok]))
    np.savetxt(path, table, fmt="%.5f", header="x_mm y_mm z_mm sigma_mm")


def _write_npz(path: Path, cloud: PointCloud, _: Kind) -> None:
    arrays: dict[str, Any] = {
        name: value
        for name in PointCloud.__dataclass_fields__
        if (value := getattr(cloud, name)) is not None
    }
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


Writer = Callable[[Path, PointCloud, Kind], None]
WRITERS: dict[str, Writer] = {".ply": _write_ply, ".xyz": _write_xyz, ".npz": _write_npz}


def read_cloud(path: Path) -> PointCloud:
    """Read a point cloud that ``write_points`` wrote as ``.npz``."""
    try:
        with np.load(path, allow_pickle=False) as data:
            names = [n for n in PointCloud.__dataclass_fields__ if n in data.files]
            return PointCloud(**{name: data[name] for name in names})
    except (OSError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: expected points written as .npz, got: {error}") from error


def read_points(path: Path) -> Points:
    """Read points of any program.

    Parameters
    ----------
    path : Path
        ``.ply`` (binary or text), ``.xyz`` (columns x y z and, here, σ), or our ``.npz``.

    Raises
    ------
    InputError for a missing or damaged file, naming it.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: expected a file of points, got no such file")
    suffix = path.suffix.lower()
    if suffix == ".npz":
        cloud = read_cloud(path)
        ok = cloud.reason == Reason.OK
        return _finite(path, cloud.xyz_mm[ok], cloud.sigma_mm[ok])
    if suffix == ".ply":
        return _read_ply(path)
    if suffix == ".xyz":
        try:
            table = np.loadtxt(path, ndmin=2)
        except ValueError as error:
            raise InputError(f"{path}: expected columns of numbers, got: {error}") from error
        if table.shape[1] < 3:
            raise InputError(f"{path}: expected three columns or more, got {table.shape[1]}")
        return _finite(path, table[:, :3], table[:, 3] if table.shape[1] == 4 else None)
    raise InputError(f"{path}: expected .ply, .xyz or .npz, got {suffix or 'no suffix'}")


def _finite(path: Path, xyz: Any, sigma: Any) -> Points:
    xyz = np.asarray(xyz, np.float64)
    good = np.isfinite(xyz).all(axis=1)
    if not good.any():
        raise InputError(f"{path}: expected points, got none")
    return Points(xyz[good], None if sigma is None else np.asarray(sigma, np.float64)[good])


def _read_ply(path: Path) -> Points:
    content = path.read_bytes()
    end = content.find(b"end_header", 0, HEADER_LIMIT)
    start = content.find(b"\n", end) + 1
    if not content.startswith(b"ply") or end < 0 or start == 0:
        raise InputError(f"{path}: expected a PLY file, got something else")
    lines = [line.split() for line in content[:end].decode("ascii", "replace").splitlines()]
    form = next((line[1] for line in lines if line[:1] == ["format"] and len(line) > 1), "")
    order = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
    elements = [k for k, line in enumerate(lines) if line[:1] == ["element"]]
    if form not in order or not elements or lines[elements[0]][1:2] != ["vertex"]:
        raise InputError(f"{path}: expected a PLY file with vertices first, got another")
    try:
        count = int(lines[elements[0]][2])
        last = elements[1] if len(elements) > 1 else len(lines)
        properties = [x for x in lines[elements[0] + 1 : last] if x[:1] == ["property"]]
        fields = [(name, (order[form] or "<") + PLY_TYPES[type_]) for _, type_, name in properties]
        if form == "ascii":
            rows = content[start:].decode("ascii").split("\n")[:count]
            table = np.array([tuple(row.split()[: len(fields)]) for row in rows], dtype=fields)
        else:
            table = np.frombuffer(content, np.dtype(fields), count, start)
    except (ValueError, KeyError, IndexError) as error:
        raise InputError(f"{path}: expected a whole PLY file, got: {error}") from error
    names = table.dtype.names or ()
    if len(table) != count or not {"x", "y", "z"} <= set(names):
        raise InputError(f"{path}: expected {count} vertices with x, y, z, got {', '.join(names)}")
    xyz = np.column_stack([table[name] for name in "xyz"])
    return _finite(path, xyz, table["sigma"] if "sigma" in names else None)
