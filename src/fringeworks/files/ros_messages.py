"""Messages of ROS 2 from clouds, rigs and findings: for bags, and for a node.

The types of the messages come from outside: from the package rosbags or from rclpy, whose classes
are called alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.files.point_table import PointTable
from fringeworks.types import Finding, FloatMap, Pinhole, PointCloud

METRE = 1e-3
"""m/mm: ROS counts in metres."""
LENGTHS = ("x", "y", "z", "sigma", "noise")
"""Fields in mm, which become metres."""
FLOAT32 = 7
"""Number of the type in PointField."""
NANOSECONDS = 1_000_000_000
"""ns/s: ROS counts in nanoseconds."""
LEVELS = {"note": 0, "warning": 1, "error": 2}
"""Levels of DiagnosticStatus (OK, WARN, ERROR) by the severity of a finding."""


def packed_points(points: NDArray[Any]) -> NDArray[Any]:
    """Points as fields of single precision in metres, with the colour in one of them.

    Parameters
    ----------
    points : (n,) structured array
        Fields x, y, z, sigma, noise in mm, perhaps nx, ny, nz and red, green, blue. Colours become
        the field ``rgb`` that viewers know.
    """
    names = [n for n in points.dtype.names or () if n not in ("red", "green", "blue")]
    colour = "red" in (points.dtype.names or ())
    packed = np.zeros(len(points), [(n, "<f4") for n in (*names, *(["rgb"] if colour else []))])
    for name in names:
        packed[name] = points[name] * (METRE if name in LENGTHS else 1.0)
    if colour:
        red, green, blue = (points[n].astype(np.uint32) for n in ("red", "green", "blue"))
        packed["rgb"] = ((red << 16) | (green << 8) | blue).astype("<u4").view("<f4")
    return packed


@dataclass(frozen=True)
class RosMessages:
    """Makes messages.

    Parameters
    ----------
    kinds : callable
        Gives the class of a message by its name, such as ``"sensor_msgs/msg/Image"``.
    array : callable
        Makes the value of a field of numbers from an array.
    byte : callable
        Makes the value of a field of one byte.
    """

    kinds: Callable[[str], Any]
    array: Callable[[NDArray[Any]], Any] = np.asarray
    byte: Callable[[int], Any] = int

    def header(self, stamp_ns: int, frame: str) -> Any:
        """``std_msgs/msg/Header``: time and coordinates."""
        seconds, rest = divmod(stamp_ns, NANOSECONDS)
        time = self.kinds("builtin_interfaces/msg/Time")(sec=seconds, nanosec=rest)
        return self.kinds("std_msgs/msg/Header")(stamp=time, frame_id=frame)

    def points(self, packed: NDArray[Any], shape: tuple[int, int], header: Any) -> Any:
        """``sensor_msgs/msg/PointCloud2`` of packed points, row by row of their frame."""
        field = self.kinds("sensor_msgs/msg/PointField")
        names = packed.dtype.names or ()
        rows, columns = shape
        return self.kinds("sensor_msgs/msg/PointCloud2")(
            header=header,
            height=rows,
            width=columns,
            fields=[
                field(name=n, offset=4 * k, datatype=FLOAT32, count=1) for k, n in enumerate(names)
            ],
            is_bigendian=False,
            point_step=packed.itemsize,
            row_step=packed.itemsize * columns,
            data=self.array(packed.view(np.uint8).reshape(-1)),
            is_dense=bool(np.isfinite(packed["x"]).all()),
        )

    def cloud(self, cloud: PointCloud, header: Any) -> Any:
        """``sensor_msgs/msg/PointCloud2`` of a cloud, organised as its frame; σ and noise in m."""
        rows = np.concatenate(list(PointTable(cloud, organised=True).parts()))
        return self.points(packed_points(rows), cloud.shape, header)

    def depth(self, depth_mm: FloatMap, header: Any) -> Any:
        """``sensor_msgs/msg/Image`` of the encoding 32FC1, m; NaN where nothing was measured."""
        rows, columns = depth_mm.shape
        metres = np.ascontiguousarray(depth_mm * METRE, "<f4")
        return self.kinds("sensor_msgs/msg/Image")(
            header=header,
            height=rows,
            width=columns,
            encoding="32FC1",
            is_bigendian=0,
            step=4 * columns,
            data=self.array(metres.view(np.uint8).reshape(-1)),
        )

    def camera_info(self, camera: Pinhole, header: Any) -> Any:
        """``sensor_msgs/msg/CameraInfo``: the pinhole and its distortion, ``plumb_bob``.

        Its five coefficients have the order of ``Pinhole.distortion``. A lens field has no place.
        """
        (fx, fy), (cx, cy) = camera.focal_px, camera.principal_px
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        region = self.kinds("sensor_msgs/msg/RegionOfInterest")
        return self.kinds("sensor_msgs/msg/CameraInfo")(
            header=header,
            height=camera.height_px,
            width=camera.width_px,
            distortion_model="plumb_bob",
            d=self.array(np.array(camera.distortion, np.float64)),
            k=K.ravel(),
            r=np.eye(3).ravel(),
            p=np.column_stack([K, np.zeros(3)]).ravel(),
            binning_x=0,
            binning_y=0,
            roi=region(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
        )

    def transform(self, T_parent_child: FloatMap, header: Any, child: str) -> Any:
        """``geometry_msgs/msg/TransformStamped``: maps child coordinates to those of the header."""
        x, y, z = (float(v) for v in T_parent_child[:3, 3] * METRE)
        turn = scipy.spatial.transform.Rotation.from_matrix(T_parent_child[:3, :3]).as_quat()
        quaternion = dict(zip("xyzw", map(float, turn), strict=True))
        kinds = self.kinds
        return kinds("geometry_msgs/msg/TransformStamped")(
            header=header,
            child_frame_id=child,
            transform=kinds("geometry_msgs/msg/Transform")(
                translation=kinds("geometry_msgs/msg/Vector3")(x=x, y=y, z=z),
                rotation=kinds("geometry_msgs/msg/Quaternion")(**quaternion),
            ),
        )

    def findings(self, findings: Iterable[Finding], header: Any, device: str) -> Any:
        """``diagnostic_msgs/msg/DiagnosticArray``: a status for each finding."""
        return self.diagnostics(
            [self.status(LEVELS[f.severity], f.kind, f.text, device, f.figures) for f in findings],
            header,
        )

    def diagnostics(self, statuses: list[Any], header: Any) -> Any:
        """``diagnostic_msgs/msg/DiagnosticArray``."""
        return self.kinds("diagnostic_msgs/msg/DiagnosticArray")(header=header, status=statuses)

    def status(
        self, level: int, name: str, message: str, device: str, values: Mapping[str, object]
    ) -> Any:
        """``diagnostic_msgs/msg/DiagnosticStatus``; level 0 is good, 1 a warning, 2 an error."""
        pair = self.kinds("diagnostic_msgs/msg/KeyValue")
        return self.kinds("diagnostic_msgs/msg/DiagnosticStatus")(
            level=self.byte(level),
            name=name,
            message=message,
            hardware_id=device,
            values=[pair(key=key, value=str(value)) for key, value in values.items()],
        )
