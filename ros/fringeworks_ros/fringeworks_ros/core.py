"""What the node does, without ROS: scans, poses of a board, calibration, and their messages."""

from __future__ import annotations

import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

import fringeworks as fw
from fringeworks.devices.clock import clock_of
from fringeworks.files.capture_writer import UNFINISHED_FILE
from fringeworks.files.ros_messages import NANOSECONDS, RosMessages
from fringeworks.scan.bench import Bench, Take, open_bench, take, take_in_memory
from fringeworks.types import FloatMap

TAI_LESS_UTC_S = 37.0
"""Seconds by which the atomic time that PTP distributes is ahead of UTC, since 2017 (IERS, Bulletin
C)."""
STAMPED_S = 1.0
"""Largest difference of a frame's PTP time from the node's clock when it arrives, s: exposure,
readout and network. With more, the two count from different moments."""
MOUNT_FRAMES: dict[str, str] = {"base": "base_link", "hand": "tool0"}
"""Names of the coordinates that hold the camera, by where it is: those of the robots of
ROS-Industrial. ``tool0`` is the flange as the robot's controller states its poses (REP 199)."""
OK, WARNING, ERROR = 0, 1, 2
"""Levels of DiagnosticStatus."""


@dataclass(frozen=True)
class Parameters:
    """Parameters of the node, by their names. Empty texts stand for none."""

    setup: str = ""
    """Set-up file: devices, settings, delay and plan."""
    rig: str = ""
    """Rig file; without one, only poses of a board can be taken."""
    projector: str = ""
    camera: str = ""
    """Words of devices, in place of those of the set-up."""
    plan: str = ""
    """Plan file, in place of that of the set-up."""
    board: str = ""
    """Board for the calibration, such as chessboard:11x8:12."""
    poses: str = "poses"
    """Folder of the poses of the board."""
    calibrated_rig: str = "rig-calibrated.toml"
    """File that a calibration writes; the present rig file is never replaced."""
    camera_frame: str = "scanner_optical_frame"
    """Coordinates of the camera: x right, y down, z forward."""
    projector_frame: str = "scanner_projector_frame"
    mount_frame: str = ""
    """Coordinates of the robot's base, or of its flange with the camera in the hand. Empty for
    ``MOUNT_FRAMES``."""
    auto_exposure: bool = False
    average: int = 1
    ptp: bool = False
    """Let the camera's clock follow the network's (PTP), and take the time stamps from it."""

    @classmethod
    def names(cls) -> dict[str, str | bool | int]:
        """Names of the parameters and their defaults."""
        return {one.name: one.default for one in fields(cls)}  # type: ignore[misc]


@dataclass
class Answer:
    """What a call gives: messages by topic, and a sentence."""

    good: bool
    said: str
    messages: dict[str, Any] = field(default_factory=dict)


class ScannerCore:
    """A scanner that answers with messages.

    Parameters
    ----------
    parameters : Parameters
    messages : RosMessages
        Makes messages of the types of rclpy, or of rosbags.

    Raises
    ------
    fw.InputError for a rig that cannot be read.
    """

    def __init__(self, parameters: Parameters, messages: RosMessages) -> None:
        self.parameters, self._make = parameters, messages
        self.rig = fw.files.read_rig(parameters.rig) if parameters.rig else None
        self._opened = ExitStack()
        self._bench: Bench | None = None
        self._last = "no scan yet"
        self._level = OK
        self._values: dict[str, object] = {}
        self._scans = 0

    def close(self) -> None:
        """Release the devices."""
        self._bench = None
        with suppress(fw.DeviceProblem):
            self._opened.close()

    def capture(self, stamp_ns: int) -> Answer:
        """Scan: points, depth and its σ, the camera, and findings."""
        try:
            if self.rig is None:
                raise fw.InputError("rig: expected a rig file, got none; calibrate first")
            grabs: list[fw.devices.Grab] = []  # the first of each picture, for its time
            called_s = time.monotonic()
            bench = self._devices()
            # The clock of frames that arrive, at the moment of the node's time stamp.
            begun_s = clock_of(bench.projector).now_s() - (time.monotonic() - called_s)
            stack = take_in_memory(
                bench, self._how(), grabbed=lambda _, some: grabs.extend(some[:1])
            )
            found = fw.measure(stack, self.rig)
        except fw.InputError as problem:
            return self._failed(problem, stamp_ns)
        cloud = found.points
        self._scans += 1
        count = int((cloud.reason == fw.Reason.OK).sum())
        worst = max((f.rank for f in cloud.findings), default=0)
        said = f"{count} points, {len(cloud.findings)} findings"
        stamp_ns, stamped = self._stamp(grabs[0], stamp_ns, begun_s)
        values = {"points": count, "seconds": f"{found.seconds:.3f}", "time stamp": stamped}
        self._tell(min(worst, WARNING), said, values)
        header = self._make.header(stamp_ns, self.parameters.camera_frame)
        messages = {
            "points": self._make.cloud(cloud, header),
            "depth/image_raw": self._make.depth(_where(cloud, cloud.xyz_mm[..., 2]), header),
            "depth/sigma": self._make.depth(_where(cloud, cloud.sigma_mm), header),
            "depth/camera_info": self._make.camera_info(self.rig.camera, header),
            "findings": self._make.findings(cloud.findings, header, self._device),
        }
        return Answer(True, said, messages)

    def _stamp(self, first: fw.devices.Grab, stamp_ns: int, begun_s: float) -> tuple[int, str]:
        """Time stamp of a scan, ns: that of its first frame by PTP, where the camera has it; and
        whose time it is."""
        if first.clock != "ptp" or first.device_s is None:
            return stamp_ns, "node"
        arrived_s = 1e-9 * stamp_ns + (first.host_s - begun_s)
        for ahead_s, name in ((0.0, "PTP"), (TAI_LESS_UTC_S, "PTP, TAI less 37 s")):
            if abs(first.device_s - ahead_s - arrived_s) <= STAMPED_S:
                return round((first.device_s - ahead_s) * NANOSECONDS), name
        off_s = first.device_s - arrived_s
        return stamp_ns, f"node; the camera's PTP time is {off_s:+.1f} s from it"

    def take_pose(self, stamp_ns: int) -> Answer:
        """Take the frames of one pose of the board."""
        try:
            folder = Path(self.parameters.poses)
            folder.mkdir(parents=True, exist_ok=True)
            name = _next_pose(folder)
            # An interrupted pose is taken anew: the board may have moved since.
            take(self._devices(), folder / name, replace(self._how(), force=True))
        except (fw.InputError, OSError) as problem:
            return self._failed(problem, stamp_ns)
        self._tell(OK, f"took {name}", {})
        return Answer(True, f"took {name} into {folder}")

    def calibrate(self, stamp_ns: int) -> Answer:
        """Calibrate the rig from the poses that were taken, and use it from now on."""
        try:
            if not self.parameters.board:
                raise fw.InputError("board: expected one, such as chessboard:11x8:12, got none")
            found = fw.calibrate(self.parameters.poses, self.parameters.board)
            target = Path(self.parameters.calibrated_rig)
            robot = None if self.rig is None else self.rig.robot
            fw.files.write_rig(target, found.rig)
        except fw.InputError as problem:
            return self._failed(problem, stamp_ns)
        self.rig = found.rig
        said = f"{fw.rig.verdict(found).text}; wrote {target}"
        if robot is not None:
            said += "; the camera's place on the robot is unknown until hand-eye is run again"
        self._tell(OK, said, {})
        header = self._make.header(stamp_ns, self.parameters.camera_frame)
        findings = self._make.findings(fw.rig.diagnose(found), header, self._device)
        return Answer(True, said, {"findings": findings, "/tf_static": self.transforms(stamp_ns)})

    def transforms(self, stamp_ns: int) -> Any:
        """``tf2_msgs/msg/TFMessage`` of the rig: the projector, and the camera on the robot."""
        given, made = self.parameters, []
        if self.rig is not None:
            T = np.linalg.inv(self.rig.T_projector_camera)
            header = self._make.header(stamp_ns, given.camera_frame)
            made.append(self._make.transform(T, header, given.projector_frame))
            if self.rig.robot is not None:
                mount = given.mount_frame or MOUNT_FRAMES[self.rig.robot.mount]
                header = self._make.header(stamp_ns, mount)
                T = self.rig.robot.T_mount_camera
                made.append(self._make.transform(T, header, given.camera_frame))
        return self._make.kinds("tf2_msgs/msg/TFMessage")(transforms=made)

    def diagnostics(self, stamp_ns: int) -> Any:
        """``diagnostic_msgs/msg/DiagnosticArray``: how the scanner is."""
        values = self._values | {"scans": self._scans, "devices open": self._bench is not None}
        if self.rig is not None and self.rig.camera.field is not None:
            values["lens field"] = "part of the points; camera_info cannot hold it"
        status = self._make.status(self._level, "scanner", self._last, self._device, values)
        return self._make.diagnostics([status], self._make.header(stamp_ns, ""))

    @property
    def _device(self) -> str:
        return "fringeworks" if self._bench is None else self._bench.camera.name

    def _how(self) -> Take:
        return Take(auto_exposure=self.parameters.auto_exposure, average=self.parameters.average)

    def _devices(self) -> Bench:
        """The devices, opened where they are not open."""
        if self._bench is None:
            given = self.parameters
            bench = open_bench(
                given.setup or None,
                projector=given.projector or None,
                camera=given.camera or None,
                plan=given.plan or None,
            )
            opened = self._opened.enter_context(bench)
            if given.ptp:
                if not isinstance(opened.camera, fw.devices.PtpCamera):
                    raise fw.DeviceProblem(
                        f"{opened.camera.name}: expected a camera with PTP, got one without; set "
                        "the parameter ptp to false"
                    )
                opened.camera.synchronise()
            self._bench = opened
        return self._bench

    def _failed(self, problem: Exception, stamp_ns: int) -> Answer:
        """A call that failed: the sentence, and what was found until then."""
        said = str(problem)
        if isinstance(problem, fw.DeviceProblem):
            self.close()  # the next call opens the devices again
            self._opened = ExitStack()
        self._tell(ERROR, said, {})
        header = self._make.header(stamp_ns, self.parameters.camera_frame)
        findings = problem.findings if isinstance(problem, fw.InputError) else ()
        return Answer(
            False, said, {"findings": self._make.findings(findings, header, self._device)}
        )

    def _tell(self, level: int, said: str, values: dict[str, object]) -> None:
        self._level, self._last, self._values = level, said, values


def _next_pose(folder: Path) -> str:
    """Name of the next pose: that of one that was interrupted, or after the largest, so that poses
    may be deleted."""
    half = sorted(folder.glob(f"pose_*/{UNFINISHED_FILE}"))
    if half:
        return half[0].parent.name
    numbers = (path.name.removeprefix("pose_") for path in folder.glob("pose_*"))
    return f"pose_{1 + max((int(n) for n in numbers if n.isdecimal()), default=-1):02d}"


def _where(cloud: fw.PointCloud, values: FloatMap) -> FloatMap:
    """A map that is NaN where there is no point."""
    return np.asarray(np.where(cloud.reason == fw.Reason.OK, values, np.nan), np.float32)
