"""The node: parameters, topics and services of ROS 2 around the core."""

from __future__ import annotations

import array
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

import fringeworks as fw
from fringeworks.files.ros_messages import RosMessages
from fringeworks_ros.core import Answer, Parameters, ScannerCore

LATCHED = QoSProfile(
    depth=1,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    reliability=ReliabilityPolicy.RELIABLE,
)
"""Those who come later get the last message, too."""
DIAGNOSTICS_S = 1.0
"""Time between two messages of diagnostics, s: aggregators call a device stale after five."""


def kinds(name: str) -> Any:
    """The class of a message by its name, such as ``sensor_msgs/msg/Image``."""
    package, part, kind = name.split("/")
    return getattr(import_module(f"{package}.{part}"), kind)


def numbers(values: NDArray[Any]) -> Any:
    """Numbers as rclpy takes them without a check of each: an array of the standard library."""
    return array.array("d" if values.dtype == np.float64 else "B", values.tobytes())


def byte(value: int) -> bytes:
    """A field of one byte, as rclpy takes it."""
    return bytes([value])


class ScannerNode(Node):
    """A scanner in ROS 2."""

    def __init__(self) -> None:
        super().__init__("scanner")
        given = {
            name: self.declare_parameter(name, default).value
            for name, default in Parameters.names().items()
        }
        make = RosMessages(kinds, numbers, byte)
        self.core = ScannerCore(Parameters(**given), make)
        self._topics: dict[str, Any] = {
            "points": self.create_publisher(PointCloud2, "~/points", LATCHED),
            "depth/image_raw": self.create_publisher(Image, "~/depth/image_raw", LATCHED),
            "depth/sigma": self.create_publisher(Image, "~/depth/sigma", LATCHED),
            "depth/camera_info": self.create_publisher(CameraInfo, "~/depth/camera_info", LATCHED),
            "findings": self.create_publisher(DiagnosticArray, "~/findings", LATCHED),
            "/diagnostics": self.create_publisher(DiagnosticArray, "/diagnostics", 10),
            "/tf_static": self.create_publisher(TFMessage, "/tf_static", LATCHED),
        }
        # One scan at a time; diagnostics go on meanwhile.
        scans, others = MutuallyExclusiveCallbackGroup(), ReentrantCallbackGroup()
        calls = {
            "capture": self.core.capture,
            "take_pose": self.core.take_pose,
            "calibrate": self.core.calibrate,
        }
        for name, call in calls.items():
            self.create_service(Trigger, f"~/{name}", self._answering(call), callback_group=scans)
        self.create_timer(DIAGNOSTICS_S, self._diagnose, callback_group=others)
        self._topics["/tf_static"].publish(self.core.transforms(self._now_ns()))

    def _answering(
        self, call: Callable[[int], Answer]
    ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        """What answers to a service: publishes what the core gives, and says what came of it."""

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            found = call(self._now_ns())
            for topic, message in found.messages.items():
                self._topics[topic].publish(message)
            response.success, response.message = found.good, found.said
            if not found.good:
                self.get_logger().error(found.said)
            return response

        return answer

    def _diagnose(self) -> None:
        self._topics["/diagnostics"].publish(self.core.diagnostics(self._now_ns()))

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds


def main() -> None:
    """Run the node until it is interrupted."""
    rclpy.init()
    try:
        node = ScannerNode()
    except fw.InputError as problem:
        rclpy.shutdown()
        raise SystemExit(f"fringeworks: {problem}") from None
    executor = MultiThreadedExecutor(num_threads=2)
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.core.close()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
