"""Points as a ROS 2 bag: one PointCloud2 message in an MCAP file, by the package rosbags."""

from __future__ import annotations

import tempfile
from datetime import datetime
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import MissingPackage

TOPIC = "/points"
"""Name under which the points are published."""
METRE = 1e-3
"""m/mm: ROS counts in metres."""
LENGTHS = ("x", "y", "z", "sigma", "noise")
"""Fields in mm, which become metres."""
FLOAT32 = 7
"""Number of the type in PointField."""
NANOSECONDS = 1_000_000_000
"""ns/s: ROS counts in nanoseconds."""
BAG_VERSION: Final = 9
"""Version of the description of a ROS 2 bag; the newest that rosbags writes."""


def need_rosbags() -> None:
    """Refuse to write a bag without the package for it.

    Raises
    ------
    MissingPackage where the package ``rosbags`` (the extra "ros") is not installed.
    """
    try:
        import_module("rosbags.rosbag2")
    except ImportError as error:
        raise MissingPackage(
            "ROS bags: expected the package rosbags, got none; pip install 'fringeworks[ros]'"
        ) from error


def write_point_bag(
    path: Path, points: NDArray[Any], shape: tuple[int, int], frame: str, date: str
) -> None:
    """Write points as a bag of one message ``sensor_msgs/msg/PointCloud2``.

    Parameters
    ----------
    path : Path
        MCAP file to write.
    points : (n,) structured array
        Fields x, y, z, sigma, noise in mm, perhaps nx, ny, nz and red, green, blue. Colours become
        the field ``rgb`` that viewers know.
    shape : (rows, columns)
        Of the frame whose pixels the points are, row by row; one row for others.
    frame : str
        Name of the coordinates, such as "camera" (x right, y down, z forward) or "base".
    date : str
        When the points were measured, UTC, ISO 8601: the time stamp.

    Raises
    ------
    MissingPackage where the package ``rosbags`` (the extra "ros") is not installed.
    """
    need_rosbags()
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    stamp = datetime.fromisoformat(date)
    message = _message(store.types, _packed(points), shape, frame, stamp)
    name = message.__msgtype__
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        bag = Path(folder) / "bag"
        with Writer(bag, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
            topic = writer.add_connection(TOPIC, name, typestore=store)
            writer.write(
                topic, int(stamp.timestamp()) * NANOSECONDS, store.serialize_cdr(message, name)
            )
        next(bag.glob("*.mcap")).replace(path)


def _packed(points: NDArray[Any]) -> NDArray[np.float32]:
    """Fields of single precision in metres, with the colour in one of them."""
    names = [n for n in points.dtype.names or () if n not in ("red", "green", "blue")]
    colour = "red" in (points.dtype.names or ())
    packed = np.zeros(len(points), [(n, "<f4") for n in (*names, *(["rgb"] if colour else []))])
    for name in names:
        packed[name] = points[name] * (METRE if name in LENGTHS else 1.0)
    if colour:
        red, green, blue = (points[n].astype(np.uint32) for n in ("red", "green", "blue"))
        packed["rgb"] = ((red << 16) | (green << 8) | blue).astype("<u4").view("<f4")
    return packed


def _message(
    types: Any, packed: NDArray[Any], shape: tuple[int, int], frame: str, stamp: datetime
) -> Any:
    field = types["sensor_msgs/msg/PointField"]
    names = packed.dtype.names or ()
    time = types["builtin_interfaces/msg/Time"](sec=int(stamp.timestamp()), nanosec=0)
    rows, columns = shape
    return types["sensor_msgs/msg/PointCloud2"](
        header=types["std_msgs/msg/Header"](stamp=time, frame_id=frame),
        height=rows,
        width=columns,
        fields=[field(n, 4 * k, FLOAT32, 1) for k, n in enumerate(names)],
        is_bigendian=False,
        point_step=packed.itemsize,
        row_step=packed.itemsize * columns,
        data=packed.view(np.uint8).reshape(-1),
        is_dense=bool(np.isfinite(packed["x"]).all()),
    )
