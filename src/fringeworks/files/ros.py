"""Points as a ROS 2 bag: one PointCloud2 message in an MCAP file, by the package rosbags."""

from __future__ import annotations

import tempfile
from datetime import datetime
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from fringeworks.files.ros_messages import NANOSECONDS, RosMessages, packed_points
from fringeworks.types import MissingPackage

TOPIC = "/points"
"""Name under which the points are published."""
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
    stamp_ns = int(datetime.fromisoformat(date).timestamp()) * NANOSECONDS
    made = RosMessages(store.types.__getitem__)
    message = made.points(packed_points(points), shape, made.header(stamp_ns, frame))
    name = message.__msgtype__
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        bag = Path(folder) / "bag"
        with Writer(bag, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
            topic = writer.add_connection(TOPIC, name, typestore=store)
            writer.write(topic, stamp_ns, store.serialize_cdr(message, name))
        next(bag.glob("*.mcap")).replace(path)
