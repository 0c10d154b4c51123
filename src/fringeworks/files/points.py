"""Point clouds as files: PLY (points or mesh), PCD, XYZ, MATLAB and NPZ."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks._lazy import scipy
from fringeworks.files.atomic import StrPath, check_target, replacing
from fringeworks.files.limits import existing_file, parsing, read_content, text_of
from fringeworks.files.npz import (
    FINDINGS,
    MAP,
    ORIGIN,
    REASONS,
    TEXT,
    Archive,
    Entry,
    read_npz,
    write_members,
)
from fringeworks.files.pcd import COLOURS, read_pcd, write_pcd
from fringeworks.files.ply import read_ply, write_ply
from fringeworks.files.provenance import (
    KEY,
    comment_lines,
    from_comments,
    json_line,
)
from fringeworks.files.ros import write_point_bag
from fringeworks.files.surfaces import READERS as SURFACE_READERS
from fringeworks.files.surfaces import read_surface
from fringeworks.files.white import WHITE, eight_bits, white_of
from fringeworks.surface.cloud import cloud_triangles, normals
from fringeworks.surface.height_map import height_map_points, lateral_findings
from fringeworks.types import (
    NUMBERS,
    BoolMap,
    FileProblem,
    HeightMap,
    InputError,
    PointCloud,
    Points,
    Provenance,
    Reason,
)

Kind = Literal["points", "normals", "mesh"]
BAND_ROWS = 16
"""Rows of a cloud whose points are put together for a PLY file at a time."""
CLOUD = Archive(
    PointCloud,
    "a point cloud",
    {
        "xyz_mm": Entry("f hw3"),
        **dict.fromkeys(("sigma_mm", "noise_mm"), MAP),
        "reason": REASONS,
        "residual_px": Entry("?f hw", lambda v: v),
        "colour": Entry(f"?{NUMBERS} hw|hw3", lambda v: v),
        "blur_mm": Entry("?f hw", lambda v: v),
        KEY: ORIGIN,
        "findings": replace(FINDINGS, layout=f"?{TEXT}"),
    },
)
"""A cloud that is organised as the frame."""

TABLES: dict[str, Callable[[Path], tuple[NDArray[Any], list[str]]]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
}
"""Readers of tables of points with comments, by suffix."""
NORMAL_AXES = ("nx", "ny", "nz")
"""Fields of a normal."""
NO_POINTS = "expected points, got none"
"""What is said about a file without points."""
IN_PX = "expected points in mm, got displacements in px; give the geometry to compute heights"
"""What is said about displacements."""


def write_points(path: StrPath, cloud: PointCloud, *, kind: Kind = "points") -> None:
    """Write a point cloud in the format of the file's suffix, whole or not at all.

    Parameters
    ----------
    path : path
        ``.ply`` points or mesh with σ, noise and brightness; ``.xyz`` text, x y z σ in mm; ``.npz``
        everything, organised as the frame is; ``.mat`` the same arrays for MATLAB, with the names
        of the reasons from 0 on; ``.pcd`` what PLY points have, for the Point Cloud Library;
        ``.mcap`` the same as a ROS 2 bag with one PointCloud2, in metres.
    cloud : PointCloud
    kind : "points", "normals" or "mesh"
        Content of a ``.ply``, ``.pcd`` or ``.mcap`` file: points alone, with their normals, or
        connected by triangles, which PLY only can hold.

    Raises
    ------
    FileProblem for another suffix and a folder that cannot be written to; InputError for a cloud
    without points; MissingPackage where MCAP lacks the package ``rosbags`` (the extra "ros").
    """
    check_target(path, WRITERS)
    if not (cloud.reason == Reason.OK).any():
        raise InputError(f"{path}: expected points to write, got none", findings=cloud.findings)
    with replacing(path) as temporary:
        WRITERS[Path(path).suffix.lower()](temporary, cloud, kind)


def _write_ply(path: Path, cloud: PointCloud, kind: Kind) -> None:
    ok = cloud.reason == Reason.OK
    faces = None
    if kind == "mesh":
        place = np.cumsum(ok.ravel()) - 1
        faces = place[cloud_triangles(cloud)].astype(np.int32)
    comments = ["fringeworks; camera coordinates, x right, y down, z forward; unit mm"]
    comments += comment_lines(cloud.provenance)
    write_ply(path, _vertices(cloud, ok, kind), int(np.count_nonzero(ok)), faces, comments)


def _vertices(cloud: PointCloud, ok: BoolMap, kind: Kind) -> Iterator[NDArray[Any]]:
    """The points of a cloud, some rows of the frame at a time."""
    turned = normals(cloud) if kind == "normals" else None
    axes = NORMAL_AXES if turned is not None else ()
    fields: list[tuple[str, str]] = [(n, "<f4") for n in ("x", "y", "z", *axes, "sigma", "noise")]
    white = None if cloud.colour is None else _white(np.asarray(cloud.colour), ok)
    if white is not None:
        fields += [(name, "u1") for name in COLOURS]
    maps = (cloud.xyz_mm, cloud.sigma_mm, cloud.noise_mm, cloud.colour if white else None)
    if turned is None and all(m is None or m.dtype == np.float32 for m in maps):
        yield from _packed(cloud, white, np.dtype(fields))
        return
    for top in range(0, len(ok), BAND_ROWS):
        band = slice(top, top + BAND_ROWS)
        here = ok[band]
        part = np.empty(int(np.count_nonzero(here)), dtype=fields)
        part["x"], part["y"], part["z"] = cloud.xyz_mm[band][here].T
        part["sigma"], part["noise"] = cloud.sigma_mm[band][here], cloud.noise_mm[band][here]
        if turned is not None:
            # Readers expect numbers: a point with too few neighbours for a normal gets 0, 0, 0.
            part["nx"], part["ny"], part["nz"] = np.nan_to_num(turned[band][here]).T
        if cloud.colour is not None and white is not None:
            part["red"], part["green"], part["blue"] = eight_bits(cloud.colour[band][here], white).T
        yield part


def _white(colour: NDArray[Any], ok: BoolMap) -> float | None:
    """The brightness of the measured points that becomes white."""
    return white_of(colour.reshape(ok.size, *colour.shape[2:]) if ok.all() else colour[ok])


def _packed(
    cloud: PointCloud, white: float | None, vertex: np.dtype[Any]
) -> Iterator[NDArray[Any]]:
    """Vertices without normals, of maps in single precision, by a kernel."""
    scale = 1.0 if white is None else WHITE / white
    for top in range(0, len(cloud.reason), BAND_ROWS):
        band = slice(top, top + BAND_ROWS)
        shade = None if white is None else _flat(np.asarray(cloud.colour)[band])
        maps = (cloud.xyz_mm, cloud.sigma_mm, cloud.noise_mm, cloud.reason)
        xyz, sigma, noise, reason = (_flat(m[band]) for m in maps)
        packed = _core.pack_vertices(xyz, sigma, noise, reason, shade, scale=scale)
        yield packed.view(vertex)


def _flat(band: NDArray[Any]) -> NDArray[Any]:
    """Rows of a map as kernels take them: all values of a row in one."""
    return np.ascontiguousarray(band.reshape(len(band), -1))


def _write_xyz(path: Path, cloud: PointCloud, _: Kind) -> None:
    ok = cloud.reason == Reason.OK
    table = np.column_stack((cloud.xyz_mm[ok], cloud.sigma_mm[ok]))
    header = ["x_mm y_mm z_mm sigma_mm", *comment_lines(cloud.provenance)]
    np.savetxt(path, table, fmt="%.5f", header="\n".join(header))


def _write_pcd(path: Path, cloud: PointCloud, kind: Kind) -> None:
    if kind == "mesh":
        raise InputError(f"{path.suffix}: expected points, got triangles, which PCD cannot hold")
    ok = cloud.reason == Reason.OK
    comments = ["fringeworks; unit mm", *comment_lines(cloud.provenance)]
    write_pcd(path, _vertices(cloud, ok, kind), int(np.count_nonzero(ok)), comments)


def _write_mcap(path: Path, cloud: PointCloud, kind: Kind) -> None:
    if kind == "mesh":
        raise InputError(f"{path.suffix}: expected points, got triangles, which MCAP cannot hold")
    ok = cloud.reason == Reason.OK
    write_point_bag(path, np.concatenate(list(_vertices(cloud, ok, kind))))


def _write_mat(path: Path, cloud: PointCloud, _: Kind) -> None:
    arrays = {
        name: value
        for name in ("xyz_mm", "sigma_mm", "noise_mm", "reason", "residual_px", "colour", "blur_mm")
        if (value := getattr(cloud, name)) is not None
    }
    arrays["reasons"] = np.array([reason.name.lower() for reason in Reason], object)
    if cloud.provenance is not None:
        arrays[KEY] = str(json_line(cloud.provenance))
    scipy.io.savemat(path, arrays, do_compression=True, oned_as="column")


def _write_npz(path: Path, cloud: PointCloud, _: Kind) -> None:
    write_members(path, CLOUD.arrays(cloud))


Writer = Callable[[Path, PointCloud, Kind], None]
WRITERS: dict[str, Writer] = {
    ".ply": _write_ply,
    ".xyz": _write_xyz,
    ".npz": _write_npz,
    ".pcd": _write_pcd,
    ".mcap": _write_mcap,
    ".mat": _write_mat,
}
"""Writers by suffix."""


def read_cloud(path: StrPath) -> PointCloud:
    """Read a point cloud that ``write_points`` wrote as ``.npz``, organised as the frame.

    Raises
    ------
    FileProblem for a missing or damaged file, and for one that holds something else.
    """
    return CLOUD.read(path)


def read_points(path: StrPath) -> Points:
    """Read points of any program.

    Parameters
    ----------
    path : path
        ``.ply`` (binary or text), ``.pcd`` (binary), ``.xyz`` (columns x y z and, in four columns,
        σ), the ``.npz`` of ``write_points``, or a height map in mm that ``read_surface`` reads.

    Returns
    -------
    Points, those that are not finite left out.

    Raises
    ------
    FileProblem for a missing or damaged file, naming it; InputError for displacements in px.
    """
    path = existing_file(path, "a file of points")
    suffix = path.suffix.lower()
    if suffix == ".npz" and "unit" not in read_npz(path, "points", {"unit": f"?{TEXT}"}):
        cloud = cloud_points(read_cloud(path))
        if not len(cloud.xyz_mm):
            raise FileProblem(f"{path}: {NO_POINTS}", findings=cloud.findings)
        return cloud
    if suffix in SURFACE_READERS:
        return surface_points(read_surface(path), str(path))
    if suffix in TABLES:
        table, comments = TABLES[suffix](path)
        check_unit(path, comments)
        with parsing(path, "points"):
            columns = [columns_of(table, names) for names in ("xyz", NORMAL_AXES, COLOURS)]
            xyz, turned, colour = columns
            sigma, noise = (columns_of(table, (name,)) for name in ("sigma", "noise"))
            return _finite(path, xyz, sigma, from_comments(comments), noise, turned, colour)
    if suffix == ".xyz":
        return _read_xyz(path)
    expected = ", ".join([*TABLES, ".xyz", *SURFACE_READERS])
    raise FileProblem(f"{path}: expected one of {expected}, got {suffix or 'no suffix'}")


def check_unit(path: Path, comments: Iterable[str]) -> None:
    """Refuse displacements in px, which are no points.

    Raises
    ------
    InputError where the comments of a PLY file say so.
    """
    if any(line.startswith("fringeworks") and line.endswith("unit px") for line in comments):
        raise InputError(f"{path}: {IN_PX}")


def columns_of(table: NDArray[Any], names: Iterable[str]) -> Any:
    """Fields of a table of points: one field, (n,), or several, (n, k); None where one is missing.

    Equal channels of colour are one brightness.
    """
    wanted = tuple(names)
    if not set(wanted) <= set(table.dtype.names or ()):
        return None
    columns = np.column_stack([table[name] for name in wanted])
    same = wanted == COLOURS and bool((columns == columns[:, :1]).all())
    return columns[:, 0] if same or len(wanted) == 1 else columns


def cloud_points(cloud: PointCloud) -> Points:
    """The measured points of a cloud."""
    ok = cloud.reason == Reason.OK
    return Points(
        np.asarray(cloud.xyz_mm[ok], np.float64),
        np.asarray(cloud.sigma_mm[ok], np.float64),
        np.asarray(cloud.noise_mm[ok], np.float64),
        findings=cloud.findings,
        provenance=cloud.provenance,
    )


def surface_points(surface: HeightMap, name: str = "height map") -> Points:
    """The measured pixels of a height map in mm, as ``height_map_points`` places them.

    Raises
    ------
    InputError for displacements in px, and for a map without a measured pixel.
    """
    if surface.unit != "mm":
        raise InputError(f"{name}: {IN_PX}")
    xyz, sigma, _ = height_map_points(surface)
    if not len(xyz):
        raise InputError(f"{name}: expected measured pixels, got none", findings=surface.findings)
    known = sigma if bool(np.isfinite(sigma).all()) else None
    found = tuple(dict.fromkeys((*surface.findings, *lateral_findings(surface))))
    return Points(xyz, known, findings=found, provenance=surface.provenance)


def _is_comment(line: str) -> bool:
    return line.startswith("#")


def _read_xyz(path: Path) -> Points:
    content = read_content(path, "points")
    with parsing(path, "columns of numbers"):
        lines = text_of(content).splitlines()
        table = np.loadtxt(lines, ndmin=2)
        comments = [line[1:].strip() for line in takewhile(_is_comment, lines)]
        if table.shape[1] < 3:
            raise FileProblem(f"expected three columns or more, got {table.shape[1]}")
        sigma = table[:, 3] if table.shape[1] == 4 else None
        return _finite(path, table[:, :3], sigma, from_comments(comments))


def _finite(
    path: Path,
    xyz: Any,
    sigma: Any,
    origin: Provenance | None,
    noise: Any = None,
    turned: Any = None,
    colour: Any = None,
) -> Points:
    xyz = np.asarray(xyz, np.float64)
    good = np.isfinite(xyz).all(axis=1)
    if not good.any():
        raise FileProblem(f"{path}: {NO_POINTS}")
    known, alone, directions, seen = (
        None if part is None else np.asarray(part, np.float64)[good]
        for part in (sigma, noise, turned, colour)
    )
    return Points(xyz[good], known, alone, provenance=origin, normals=directions, colour=seen)
