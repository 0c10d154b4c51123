"""The node of ROS 2: its messages in a bag, its calls, and its shell against stubs of rclpy."""

from __future__ import annotations

import importlib
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags")

import fringeworks as fw
from fringeworks.devices.clock import clock_of
from fringeworks.devices.virtual_camera import VirtualCamera
from fringeworks.files.ros_messages import RosMessages
from fringeworks.types import RobotFrame
from tests import fake_rclpy

pytestmark = pytest.mark.system
ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "ros" / "fringeworks_ros"
STAMP = fake_rclpy.Node.now_ns


@pytest.fixture(scope="module")
def store():
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


@pytest.fixture
def core(monkeypatch):
    monkeypatch.syspath_prepend(str(PACKAGE))
    yield importlib.import_module("fringeworks_ros.core")
    for name in [name for name in sys.modules if name.startswith("fringeworks_ros")]:
        del sys.modules[name]


@pytest.fixture
def files(tmp_path):
    """A rig on a robot, and a plan, of the virtual devices."""
    T = np.eye(4)
    T[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    T[:3, 3] = 100.0, 200.0, 300.0
    rig = replace(fw.devices.virtual_rig(), robot=RobotFrame("base", T))
    fw.files.write_rig(tmp_path / "rig.toml", rig)
    plan = fw.simulate.fringe_plan(rig, both=False)
    # With a white picture, which is the colour of the points.
    blocks = (fw.patterns.Uniform("white"), *plan.blocks)
    fw.files.write_plan(tmp_path / "plan.toml", replace(plan, blocks=blocks))
    return {
        "rig": str(tmp_path / "rig.toml"),
        "plan": str(tmp_path / "plan.toml"),
        "projector": "virtual",
        "camera": "virtual:sphere",
        "poses": str(tmp_path / "poses"),
        "calibrated_rig": str(tmp_path / "new.toml"),
    }


def bagged(store, path, messages):
    """The messages as a bag gives them back, by topic."""
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, message in messages.items():
            name = message.__msgtype__
            connection = writer.add_connection(topic, name, typestore=store)
            writer.write(connection, STAMP, store.serialize_cdr(message, name))
    with Reader(path) as reader:
        return {
            connection.topic: store.deserialize_cdr(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
        }


def table_of(message):
    """The points of a message, by row and column."""
    table = message.data.view([(f.name, "<f4") for f in message.fields])
    assert message.point_step == table.itemsize
    assert message.row_step * message.height == len(message.data)
    return table.reshape(message.height, message.width)


def projected(info, xyz):
    """Pixels of points, by the camera that the message describes (plumb_bob)."""
    K, (k1, k2, p1, p2, k3) = info.k.reshape(3, 3), info.d
    x, y = xyz[..., 0] / xyz[..., 2], xyz[..., 1] / xyz[..., 2]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return K[0, 0] * u + K[0, 2], K[1, 1] * v + K[1, 2]


def rotated(transform, point):
    """A point by a transform of ROS: the quaternion has w last."""
    q, t = transform.rotation, transform.translation
    axis, w = np.array([q.x, q.y, q.z]), q.w
    turned = point + 2.0 * np.cross(axis, np.cross(axis, point) + w * point)
    return turned + np.array([t.x, t.y, t.z])


class PtpClock(VirtualCamera):
    """A camera whose frames carry the network's time, ahead of that of the node by so much."""

    ahead_s = zero_s = 0.0
    follows = False

    def synchronise(self, timeout_s=15.0):
        del timeout_s
        self.follows = True
        return 0.0

    def grab(self, *given, **named):
        got = super().grab(*given, **named)
        at_s = 1e-9 * STAMP + PtpClock.ahead_s + got.host_s - PtpClock.zero_s
        return replace(got, device_s=at_s, clock="ptp") if self.follows else got


def stamps_ns(found):
    return {m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in found.messages.values()}


@pytest.mark.parametrize("ahead_s", [0.0, 37.0, -3600.0])
def test_time_stamps_are_those_of_a_camera_with_ptp(core, files, store, monkeypatch, ahead_s):
    made = RosMessages(store.types.__getitem__)
    monkeypatch.setattr("fringeworks.devices.bench.VirtualCamera", PtpClock)
    monkeypatch.setattr(PtpClock, "ahead_s", ahead_s)
    scanner = core.ScannerCore(core.Parameters(**files, ptp=True), made)
    scanner.capture(STAMP)
    clock = clock_of(scanner._bench.projector)
    monkeypatch.setattr(PtpClock, "zero_s", clock.now_s())
    found = scanner.capture(STAMP)
    ended_s = clock.now_s() - PtpClock.zero_s
    assert found.good, found.said
    (stamp,) = stamps_ns(found)
    said = {one.key: one.value for one in scanner.diagnostics(STAMP).status[0].values}["time stamp"]
    if ahead_s < 0:
        assert stamp == STAMP
        assert said == "node; the camera's PTP time is -3600.0 s from it"
    else:
        assert STAMP < stamp < STAMP + 1e9 * ended_s
        assert said == ("PTP, TAI less 37 s" if ahead_s else "PTP")
    scanner.close()
    # Without it, the node's clock stays.
    plain = core.ScannerCore(core.Parameters(**files), made)
    assert stamps_ns(plain.capture(STAMP)) == {STAMP}
    plain.close()


def test_a_camera_without_ptp_is_named(core, files, store):
    made = RosMessages(store.types.__getitem__)
    scanner = core.ScannerCore(core.Parameters(**files, ptp=True), made)
    found = scanner.capture(STAMP)
    assert not found.good
    assert "expected a camera with PTP, got one without; set the parameter ptp" in found.said


def test_a_bag_of_the_node_is_read_by_rosbags(core, files, store, tmp_path):
    scanner = core.ScannerCore(core.Parameters(**files), RosMessages(store.types.__getitem__))
    found = scanner.capture(STAMP)
    assert found.good, found.said
    messages = {f"/scanner/{topic}": message for topic, message in found.messages.items()}
    messages["/tf_static"] = scanner.transforms(STAMP)
    messages["/diagnostics"] = scanner.diagnostics(STAMP)
    scanner.close()
    read = bagged(store, tmp_path / "bag", messages)
    assert set(read) == set(messages)

    cloud = read["/scanner/points"]
    rows, columns = fw.devices.virtual_rig().camera.shape
    assert (cloud.height, cloud.width) == (rows, columns)
    assert {"x", "y", "z", "sigma", "noise", "rgb"} <= {f.name for f in cloud.fields}
    header = cloud.header
    assert header.frame_id == "scanner_optical_frame"
    assert (header.stamp.sec, header.stamp.nanosec) == divmod(STAMP, 10**9)
    table = table_of(cloud)
    ok = np.isfinite(table["x"])
    assert 3000 < ok.sum() < ok.size
    assert not cloud.is_dense
    colour = np.ascontiguousarray(table["rgb"]).view("<u4")[ok]
    assert colour.max() == 0xFFFFFF  # the brightest points are white
    # A sphere at about 0.5 m: lengths are metres, and σ is small against it.
    assert 0.3 < np.median(table["z"][ok]) < 0.8
    assert 0 < np.median(table["sigma"][ok]) < 1e-4

    depth, sigma = read["/scanner/depth/image_raw"], read["/scanner/depth/sigma"]
    for image, name in ((depth, "z"), (sigma, "sigma")):
        assert (image.encoding, image.step, image.height) == ("32FC1", 4 * columns, rows)
        values = image.data.view("<f4").reshape(rows, columns)
        assert np.allclose(values[ok], table[name][ok], rtol=1e-6)
        assert np.isnan(values[~ok]).all()

    # Each point is seen in its own pixel by the camera that is published.
    info = read["/scanner/depth/camera_info"]
    xyz = np.stack([table[n] for n in "xyz"], axis=-1).astype(np.float64)
    u, v = projected(info, xyz)
    places = np.indices((rows, columns))
    assert np.abs(u - places[1])[ok].max() < 0.01
    assert np.abs(v - places[0])[ok].max() < 0.01
    assert info.distortion_model == "plumb_bob"

    first, second = read["/tf_static"].transforms
    assert (first.header.frame_id, first.child_frame_id) == (
        *("scanner_optical_frame", "scanner_projector_frame"),
    )
    T = fw.devices.virtual_rig().T_projector_camera
    point = np.array([0.03, -0.02, 0.5])
    there = (T[:3, :3] @ (1e3 * point) + T[:3, 3]) * 1e-3
    assert np.allclose(rotated(first.transform, there), point)
    assert (second.header.frame_id, second.child_frame_id) == (
        *("base_link", "scanner_optical_frame"),
    )
    assert np.allclose(rotated(second.transform, point), [0.12, 0.23, 0.8])

    (status,) = read["/diagnostics"].status
    assert status.level < 2
    assert status.message == found.said
    assert {v.key: v.value for v in status.values}["scans"] == "1"
    assert read["/scanner/findings"].status[0].name == "noise"


@pytest.mark.parametrize(
    ("mount", "given", "frame"),
    [("base", "", "base_link"), ("hand", "", "tool0"), ("hand", "flange", "flange")],
)
def test_the_camera_hangs_on_base_or_flange(core, files, store, mount, given, frame):
    """A camera in the hand is not one that stands on the base."""
    rig = fw.files.read_rig(files["rig"])
    fw.files.write_rig(files["rig"], replace(rig, robot=replace(rig.robot, mount=mount)))
    make = RosMessages(store.types.__getitem__)
    scanner = core.ScannerCore(core.Parameters(**files | {"mount_frame": given}), make)
    assert scanner.transforms(STAMP).transforms[1].header.frame_id == frame


@pytest.mark.parametrize(
    ("changed", "call", "said"),
    [
        ({"rig": ""}, "capture", "expected a rig file, got none"),
        ({"camera": "virtual:nothing"}, "capture", "virtual scene 'nothing'"),
        ({"camera": ""}, "capture", "expected a projector and a camera"),
        ({}, "calibrate", "board: expected one"),
        ({"board": "chessboard:11x8:12"}, "calibrate", "expected a folder with a stack per pose"),
        ({"poses": "/dev/null/poses"}, "take_pose", "Not a directory"),
    ],
)
def test_what_fails_is_said(core, files, store, changed, call, said):
    make = RosMessages(store.types.__getitem__)
    scanner = core.ScannerCore(core.Parameters(**files | changed), make)
    found = getattr(scanner, call)(STAMP)
    assert not found.good
    assert said in found.said
    status = scanner.diagnostics(STAMP).status[0]
    assert (status.level, status.message) == (2, found.said)
    scanner.close()


def test_poses_that_were_deleted_or_interrupted_are_in_nobodys_way(
    core, files, store, tmp_path, monkeypatch
):
    """A bad pose is deleted, and one in which the camera was unplugged is taken anew."""
    scanner = core.ScannerCore(core.Parameters(**files), RosMessages(store.types.__getitem__))
    for name in ("pose_00", "pose_01"):
        assert name in scanner.take_pose(STAMP).said
    shutil.rmtree(tmp_path / "poses" / "pose_00")
    assert "pose_02" in scanner.take_pose(STAMP).said
    grab, left = VirtualCamera.grab, iter(range(5))

    def unplugged(camera, *given, **named):
        if next(left, None) is None:
            raise fw.DeviceProblem("camera: it was unplugged")
        return grab(camera, *given, **named)

    with monkeypatch.context() as patch:
        patch.setattr(VirtualCamera, "grab", unplugged)
        found = scanner.take_pose(STAMP)
        assert (found.good, found.said) == (False, "camera: it was unplugged")
    found = scanner.take_pose(STAMP)
    assert found.good, found.said
    names = sorted(path.name for path in (tmp_path / "poses").iterdir())
    assert names == ["pose_01", "pose_02", "pose_03"]
    fw.files.read_stack(tmp_path / "poses" / "pose_03")


def test_poses_are_taken_and_calibrate(core, files, store, tmp_path):
    """The rig file that the node started with stays as it is."""
    make = RosMessages(store.types.__getitem__)
    plan = fw.simulate.fringe_plan(fw.devices.virtual_rig())
    fw.files.write_plan(tmp_path / "both.toml", plan)
    before = (tmp_path / "rig.toml").read_bytes()
    given = files | {"plan": str(tmp_path / "both.toml"), "board": "chessboard:11x8:12"}
    for k in range(6):
        words = given | {"camera": f"virtual:board-{k}"}
        scanner = core.ScannerCore(core.Parameters(**words), make)
        found = scanner.take_pose(STAMP)
        assert found.good, found.said
        assert f"pose_{k:02d}" in found.said
        scanner.close()
    found = scanner.calibrate(STAMP)
    assert found.good, found.said
    assert found.said.startswith("good for ±")
    assert "hand-eye is run again" in found.said
    assert (tmp_path / "rig.toml").read_bytes() == before
    rig = fw.files.read_rig(tmp_path / "new.toml")
    assert abs(rig.camera.focal_px[0] / fw.devices.virtual_rig().camera.focal_px[0] - 1.0) < 0.01
    assert [t.child_frame_id for t in found.messages["/tf_static"].transforms] == [
        "scanner_projector_frame"
    ]
    assert scanner.rig.camera == rig.camera


def test_the_shell_publishes_what_the_core_gives(core, files, store, monkeypatch):  # noqa: ARG001
    """The node itself, on a stand-in for rclpy that checks types as rclpy does."""
    fake_rclpy.install(monkeypatch, store.types)
    monkeypatch.setattr(fake_rclpy.Node, "given", files)
    node = importlib.import_module("fringeworks_ros.node").ScannerNode()
    assert set(node.services) == {f"/scanner/{n}" for n in ("capture", "take_pose", "calibrate")}
    assert len(node.topics["/tf_static"].messages) == 1
    answer = node.call("capture")
    assert answer.success, answer.message
    names = {"points", "depth/image_raw", "depth/sigma", "depth/camera_info", "findings"}
    for name in names:
        topic = node.topics[f"/scanner/{name}"]
        assert topic.latched
        (message,) = topic.messages
        store.serialize_cdr(message, message.__msgtype__)
    assert not node.topics["/diagnostics"].latched
    node.timers[0]()
    (message,) = node.topics["/diagnostics"].messages
    store.serialize_cdr(message, message.__msgtype__)
    answer = node.call("calibrate")
    assert not answer.success
    assert node.errors == [answer.message]
    node.core.close()


def test_the_shell_agrees_with_the_stubs_of_rclpy(tmp_path):
    done = subprocess.run(
        [
            *(sys.executable, "-m", "mypy", "--strict", "--follow-imports", "silent"),
            *("--cache-dir", str(tmp_path), "--config-file", str(ROOT / "pyproject.toml")),
            *("-p", "fringeworks_ros"),
        ],
        env={
            "MYPYPATH": f"{PACKAGE}:{ROOT / 'ros' / 'stubs'}:{ROOT / 'src'}",
            "PATH": "",
            "HOME": str(tmp_path),
        },
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_package_says_what_it_uses(core):
    tree = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert tree.findtext("name") == "fringeworks_ros"
    assert tree.findtext("version") == fw.__version__
    needed = {one.text for one in tree.findall("exec_depend")}
    text = "".join(p.read_text() for p in (PACKAGE / "fringeworks_ros").glob("*.py"))
    text += (ROOT / "src/fringeworks/files/ros_messages.py").read_text()
    for name in needed - {"ros2launch"}:
        assert name in text, name
    for name in ("sensor_msgs", "diagnostic_msgs", "std_srvs", "tf2_msgs", "geometry_msgs"):
        assert name in needed
    setup = (PACKAGE / "setup.py").read_text()
    assert f'version="{fw.__version__}"' in setup
    assert f"=={fw.__version__}" in setup
    for path in ("launch/scanner.launch.py", "config/scanner.yaml", "package.xml"):
        assert path in setup
        assert (PACKAGE / path).is_file()
    assert (PACKAGE / "resource" / "fringeworks_ros").is_file()
    names = core.Parameters.names()
    lines = (PACKAGE / "config" / "scanner.yaml").read_text().splitlines()[2:]
    assert {line.strip().partition(":")[0] for line in lines} <= set(names)
