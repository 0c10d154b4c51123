"""The files of a cloud: NPZ, PLY, and raw depth with its σ, in camera or base coordinates."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fringeworks.files.atomic import replacing
from fringeworks.files.npz import write_members
from fringeworks.files.point_table import PointTable
from fringeworks.files.point_writers import write_table_as_ply
from fringeworks.files.points import CLOUD, read_cloud, write_points
from fringeworks.files.robot_poses import parse_robot_pose
from fringeworks.rig.robot.base import in_base
from fringeworks.service.models import Format, FrameName, MeasureRequest, ScanRequest
from fringeworks.service.store import Store
from fringeworks.types import FileProblem, InputError, PointCloud, Rig

CLOUD_FILE = "cloud.npz"
"""The result itself: all others are made from it."""
MEDIA = {
    "npz": "application/zip",
    "ply": "application/octet-stream",
    "depth": "application/octet-stream",
}
"""Media types by format."""
SUFFIXES: dict[str, str] = {"npz": ".npz", "ply": ".ply", "depth": ".depth"}
"""Suffixes of files by format."""


def cloud_file(folder: Path, form: Format, frame: FrameName) -> Path:
    """Where a cloud of a result is, once it is written."""
    stem = "cloud" if frame == "camera" else "base"
    return folder / f"{stem}{SUFFIXES[form]}"


def placed(cloud: PointCloud, rig: Rig, wanted: ScanRequest | MeasureRequest) -> PointCloud:
    """The points in the coordinates of the robot's base.

    Raises
    ------
    InputError as ``in_base``, and for a pose that cannot be read.
    """
    if wanted.robot_pose is None:
        return in_base(cloud, rig)
    try:
        pose = parse_robot_pose(wanted.robot_pose, wanted.poses_as)
    except FileProblem as error:
        # No file of the service: the request is wrong.
        raise InputError(str(error)) from error
    return in_base(cloud, rig, pose)


def check_frame(rig: Rig, wanted: ScanRequest | MeasureRequest, frame: FrameName) -> None:
    """Refuse coordinates that the rig or the request does not tell, before anything is scanned.

    Raises
    ------
    InputError
    """
    if frame == "camera" and wanted.robot_pose is None:
        return
    nothing = np.full((1, 1), np.nan, np.float32)
    none = PointCloud(
        np.full((1, 1, 3), np.nan, np.float32), nothing, nothing, np.ones((1, 1), np.uint8)
    )
    placed(none, rig, wanted)


def write_cloud(path: Path, cloud: PointCloud, form: Format) -> None:
    """Write a cloud, whole or not at all.

    Raises
    ------
    InputError for a PLY without points; FileProblem where it cannot be written.
    """
    if form == "ply":
        write_points(path, cloud)
        return
    with replacing(path) as temporary:
        _write(temporary, cloud, form)


def write_cloud_in_half(path: Path, cloud: PointCloud, form: Format) -> None:
    """Write a cloud into a folder that is not whole yet; whoever makes it whole syncs its files."""
    try:
        _write(path, cloud, form)
    except OSError as error:
        raise FileProblem(f"{path}: could not be written: {error.strerror}") from error


def _write(path: Path, cloud: PointCloud, form: Format) -> None:
    if form == "npz":
        # Compressing takes longer than measuring.
        write_members(path, CLOUD.arrays(cloud), compressed=False)
    elif form == "ply":
        write_table_as_ply(path, PointTable(cloud, "points"))
    else:
        path.write_bytes(depth_bytes(cloud))


def depth_bytes(cloud: PointCloud) -> bytes:
    """Depth and σ as raw numbers: two maps of rows × columns, little-endian float32, mm."""
    if cloud.placement is not None:
        raise InputError("depth: expected frame=camera, because depth is along the camera's axis")
    maps = (cloud.xyz_mm[..., 2], cloud.sigma_mm)
    return b"".join(np.ascontiguousarray(one, "<f4").tobytes() for one in maps)


def made_cloud(
    store: Store,
    number: int,
    form: Format,
    frame: FrameName,
    rig: Rig,
    wanted: ScanRequest | MeasureRequest,
) -> Path:
    """The file of a cloud, made from the result where it is not there yet.

    Raises
    ------
    InputError for coordinates that are not known; FileProblem for files.
    """
    folder = store.whole(number)
    path = cloud_file(folder, form, frame)
    if path.is_file():
        return path
    cloud = read_cloud(folder / CLOUD_FILE)
    write_cloud(path, cloud if frame == "camera" else placed(cloud, rig, wanted), form)
    return path
