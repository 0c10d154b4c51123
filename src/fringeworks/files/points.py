"""Point clouds as files of every kind."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.files.atomic import StrPath, check_target, replacing
from fringeworks.files.csv_table import CSV
from fringeworks.files.limits import existing_file, parsing, read_content, text_of, told
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
from fringeworks.files.placement import PLACEMENT, placement_from_json, placement_json
from fringeworks.files.point_readers import (
    FRAMES,
    IN_PX,
    TABLE_READERS,
    cloud_of,
    holds_points,
)
from fringeworks.files.point_table import COLOURS, NORMAL_AXES, Kind, PointTable, fields_of
from fringeworks.files.point_writers import (
    TABLE_WRITERS,
    check_kind,
    need_package,
    write_table_as_ply,
)
from fringeworks.files.provenance import KEY, from_comments, json_line
from fringeworks.files.surfaces import READERS as SURFACE_READERS
from fringeworks.files.surfaces import read_surface
from fringeworks.files.vtk import VTI, VTP, write_cloud_as_vti, write_points_as_vtp
from fringeworks.surface.cloud import cloud_triangles
from fringeworks.surface.height_map import height_map_points, lateral_findings
from fringeworks.types import (
    NUMBERS,
    FileProblem,
    HeightMap,
    InputError,
    PointCloud,
    Points,
    Provenance,
    Reason,
)

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
        PLACEMENT: Entry(f"?{TEXT}", placement_json, lambda text: placement_from_json(str(text))),
        KEY: ORIGIN,
        "findings": replace(FINDINGS, layout=f"?{TEXT}"),
    },
)
"""A cloud that is organised as the frame."""

NO_POINTS = "expected points, got none"
"""What is said about a file without points."""


def write_points(path: StrPath, cloud: PointCloud, *, kind: Kind = "points") -> None:
    """Write a point cloud in the format of the file's suffix, whole or not at all.

    Parameters
    ----------
    path : path
        ``.ply`` points or mesh with σ, noise and colour; ``.xyz`` text, x y z σ in mm; ``.npz``
        everything, organised as the frame is; ``.mat`` the same arrays for MATLAB, with the names
        of the reasons from 0 on; ``.pcd`` what PLY points have, for the Point Cloud Library;
        ``.csv`` the same as a table, colours in counts; ``.e57``, ``.las`` and ``.laz`` the same
        in metres; ``.mcap`` as a ROS 2 bag with one PointCloud2, in metres. Points of PCD and
        MCAP are organised as the frame is, NaN where nothing was measured. For ParaView, ``.vtp``
        has points or the mesh, and ``.vti`` the pixels of the frame, with σ and reasons.
    cloud : PointCloud
    kind : "points", "normals", "mesh" or "frame"
        Content of the file: points alone, with their normals, connected by triangles, which PLY
        and VTP can hold, or all pixels of the frame with their rows, columns and reasons, which
        PCD, CSV and E57 can hold. NPZ, MAT, MCAP and VTI hold the frame in any
        case.

    Raises
    ------
    FileProblem for another suffix and a folder that cannot be written to; InputError for a cloud
    without points, and for what the format cannot hold; MissingPackage where a format needs a
    package that is not installed: MCAP (the extra "ros"), E57, LAS and LAZ (the extra "export").
    """
    check_target(path, WRITERS)
    if not (cloud.reason == Reason.OK).any():
        raise InputError(f"{path}: expected points to write, got none", findings=cloud.findings)
    suffix = Path(path).suffix.lower()
    check_kind(Path(path), kind)
    need_package(suffix)
    with replacing(path) as temporary:
        if suffix in CLOUD_WRITERS:
            CLOUD_WRITERS[suffix](temporary, cloud)
        elif kind == "mesh" and suffix in MESH_WRITERS:
            _write_mesh(temporary, cloud, suffix)
        else:
            TABLE_WRITERS[suffix](temporary, PointTable(cloud, kind))


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
        raise InputError(f"{path}: expected points to write, got none", findings=points.findings)
    if provenance is not None:
        points = replace(points, provenance=provenance)
    with replacing(path) as temporary:
        TABLE_WRITERS[suffix](temporary, PointTable(points))


MESH_WRITERS: dict[str, Callable[[Path, PointTable, NDArray[np.int32]], None]] = {
    ".ply": write_table_as_ply,
    VTP: write_points_as_vtp,
}
"""Writers of points that triangles connect, by suffix."""


def _write_mesh(path: Path, cloud: PointCloud, suffix: str) -> None:
    ok = cloud.reason == Reason.OK
    place = np.cumsum(ok.ravel()) - 1
    faces = place[cloud_triangles(cloud)].astype(np.int32)
    MESH_WRITERS[suffix](path, PointTable(cloud, "mesh"), faces)


def _write_mat(path: Path, cloud: PointCloud) -> None:
    arrays = {
        name: value
        for name in ("xyz_mm", "sigma_mm", "noise_mm", "reason", "residual_px", "colour", "blur_mm")
        if (value := getattr(cloud, name)) is not None
    }
    arrays["frame"] = cloud.frame
    if cloud.placement is not None:
        arrays["T_frame_camera"] = cloud.placement.T_frame_camera
    arrays["reasons"] = np.array([reason.name.lower() for reason in Reason], object)
    if cloud.provenance is not None:
        arrays[KEY] = str(json_line(cloud.provenance))
    scipy.io.savemat(path, arrays, do_compression=True, oned_as="column")


def _write_npz(path: Path, cloud: PointCloud) -> None:
    write_members(path, CLOUD.arrays(cloud))


CLOUD_WRITERS: dict[str, Callable[[Path, PointCloud], None]] = {
    ".npz": _write_npz,
    ".mat": _write_mat,
    VTI: write_cloud_as_vti,
}
"""Writers of clouds as arrays, by suffix."""
WRITERS = (".ply", ".xyz", ".npz", ".pcd", ".mcap", ".mat", CSV, ".e57", ".las", ".laz", VTP, VTI)
"""Suffixes of files of clouds."""


def read_cloud(path: StrPath) -> PointCloud:
    """Read a point cloud that ``write_points`` wrote with all pixels of its frame.

    Parameters
    ----------
    path : path
        ``.npz``; or ``.pcd``, ``.csv`` or ``.e57`` of the kind "frame", which hold colours of 8
        bits but for CSV, and findings but for PCD.

    Raises
    ------
    FileProblem for a missing or damaged file, and for one that holds something else.
    """
    path = Path(path)
    if path.suffix.lower() not in FRAMES:
        return CLOUD.read(path)
    found = read_point_file(path)
    if not isinstance(found, PointCloud):
        raise FileProblem(
            f"{path}: expected all pixels of a frame, got points without their places in it; write "
            'them with kind="frame", or as .npz'
        )
    return found


def read_points(path: StrPath) -> Points:
    """Read points of any program.

    Parameters
    ----------
    path : path
        ``.ply`` (binary or text), ``.pcd`` (binary, text or compressed), ``.xyz`` (columns x y z
        and, in four columns, σ), ``.csv`` (columns x, y, z with or without units, by default mm),
        ``.e57``, ``.las`` and ``.laz`` (in metres), the ``.npz`` of ``write_points``, or a height
        map in mm that ``read_surface`` reads.

    Returns
    -------
    Points, those that are not finite left out.

    Raises
    ------
    FileProblem for a missing or damaged file, naming it; InputError for displacements in px;
    MissingPackage where a format needs a package that is not installed.
    """
    path = existing_file(path, "a file of points")
    suffix = path.suffix.lower()
    if suffix == ".npz" and "unit" not in read_npz(path, "points", {"unit": f"?{TEXT}"}):
        return _measured(path, read_cloud(path))
    if suffix in SURFACE_READERS and not (suffix == CSV and holds_points(path)):
        return surface_points(read_surface(path), str(path))
    found = read_point_file(path)
    return _measured(path, found) if isinstance(found, PointCloud) else found


def _measured(path: Path, cloud: PointCloud) -> Points:
    points = cloud_points(cloud)
    if not len(points.xyz_mm):
        raise FileProblem(f"{path}: {NO_POINTS}", findings=cloud.findings)
    return points


def read_point_file(path: StrPath) -> Points | PointCloud:
    """Read points as ``read_points``; all pixels of a frame as a PointCloud, if they are there.

    Raises
    ------
    The errors of ``read_points``.
    """
    path = existing_file(path, "a file of points")
    suffix = path.suffix.lower()
    if suffix == ".xyz":
        return _read_xyz(path)
    if suffix not in TABLE_READERS:
        expected = ", ".join(dict.fromkeys([*TABLE_READERS, ".xyz", *SURFACE_READERS]))
        raise FileProblem(f"{path}: expected one of {expected}, got {suffix or 'no suffix'}")
    read = TABLE_READERS[suffix](path)
    with parsing(path, "points"):
        if read.shape is not None and "reason" in fields_of(read.table):
            return cloud_of(read)
        columns = {name: columns_of(read.table, (name,)) for name in ("sigma", "noise")}
        turned, seen = (columns_of(read.table, names) for names in (NORMAL_AXES, COLOURS))
        if seen is None:
            seen = columns_of(read.table, ("brightness",))
        xyz = columns_of(read.table, "xyz")
        if xyz is None:
            raise FileProblem(f"expected fields x, y and z, got {told(fields_of(read.table))}")
        found = _finite(
            path, xyz, columns["sigma"], read.provenance, columns["noise"], turned, seen
        )
        return replace(found, findings=read.findings) if read.findings else found


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
