"""Devices opened and listed by words, from the package and from outside."""

from __future__ import annotations

import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import fringeworks as fw
from fringeworks import InputError
from fringeworks.devices import kinds, registry
from fringeworks.devices.folder_camera import FolderCamera
from fringeworks.devices.opening import (
    camera_kind,
    camera_kinds,
    list_devices,
    open_camera,
    open_devices,
    open_projector,
    projector_kind,
    projector_kinds,
    scanner_kind,
)
from fringeworks.devices.protocols import Camera, CameraLimits
from fringeworks.devices.registry import ListedDevice, load_plugin
from fringeworks.devices.webcam import Webcam
from fringeworks.files import read_stack, write_patterns
from fringeworks.types import CameraSettings, DeviceProblem, MissingPackage
from tests.virtual_devices import plan

EXAMPLE = Path(__file__).parent.parent / "examples" / "vendor_camera.py"


@pytest.fixture(autouse=True)
def kinds_are_put_back():
    """Kinds that a test registers are gone after it."""
    registries = (registry.CAMERA_KINDS, registry.PROJECTOR_KINDS, registry.BOTH_KINDS)
    before = [dict(kinds) for kinds in registries]
    yield
    for kinds_now, had in zip(registries, before, strict=True):
        kinds_now.clear()
        kinds_now.update(had)


def test_words_open_devices(tmp_path):
    cv2.imwrite(str(tmp_path / "f-0.png"), np.full((8, 9), 7, np.uint8))
    with open_camera(f"webcam:{tmp_path / 'f-%d.png'}") as camera:
        assert camera.grab().pixels.shape == (8, 9)
    with open_camera(f"folder:{tmp_path}") as camera:
        assert isinstance(camera, FolderCamera)
        assert camera.name == f"folder {tmp_path}"
    write_patterns(tmp_path / "p", plan())
    with open_projector(f"memory:{tmp_path / 'p'}") as projector:
        assert projector.size_px == (128, 96)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "kinect:0",
            "camera 'kinect:0': expected a kind of .*folder, genicam, .*webcam.*got 'kinect'",
        ),
        ("", "expected a kind of .*, got ''"),
        ("0", "expected a kind of .*, got '0'"),
        ("folder", "folder: expected folder:PATH, got folder alone"),
        ("folder:/does/not/exist", "expected a folder that can be read"),
        ("webcam:none.avi", "got no such file"),
    ],
)
def test_cameras_that_do_not_open(words, said):
    with pytest.raises(DeviceProblem, match=said):
        open_camera(words)


def test_projectors_that_do_not_open():
    with pytest.raises(
        DeviceProblem, match="projector 'beamer': expected a kind of .*memory, screen"
    ):
        open_projector("beamer")
    with pytest.raises(DeviceProblem, match="memory: expected memory:FOLDER"):
        open_projector("memory")


def test_numbers_and_names_reach_the_devices(monkeypatch):
    opened = []
    for place, name in (
        ("fringeworks.devices.webcam", "WebcamCamera"),
        ("fringeworks.devices.genicam", "GenicamCamera"),
        ("fringeworks.devices.gentl", "GentlCamera"),
        ("fringeworks.devices.window", "WindowProjector"),
    ):
        monkeypatch.setattr(
            f"{place}.{name}",
            lambda *args, name=name, channel="luminance": opened.append(
                (name, *args) if channel == "luminance" else (name, *args, channel)
            ),
        )
    for words in (
        "webcam",
        "webcam:2",
        "webcam:/dev/video0",
        "genicam",
        "genicam:Acme:1",
        "gentl:7",
        "webcam:1,channel=blue",
        "genicam:Acme:1,channel=raw",
    ):
        open_camera(words)
    for words in ("screen", "screen:1", "screen:HDMI-1"):
        open_projector(words)
    assert opened == [
        ("WebcamCamera", 0),
        ("WebcamCamera", 2),
        ("WebcamCamera", "/dev/video0"),
        ("GenicamCamera", None),
        ("GenicamCamera", "Acme:1"),
        ("GentlCamera", "7"),
        ("WebcamCamera", 1, "blue"),
        ("GenicamCamera", "Acme:1", "raw"),
        ("WindowProjector", None),
        ("WindowProjector", "1"),
        ("WindowProjector", "HDMI-1"),
    ]


def test_a_taken_or_odd_name_is_refused():
    for decorator, name in ((camera_kind, "webcam"), (projector_kind, "screen")):
        with pytest.raises(InputError, match=f"'{name}': expected a name that is free"):
            decorator(name)(lambda words: words)
    # A scanner stands in the place of both.
    for name in ("webcam", "screen", "virtual"):
        with pytest.raises(InputError, match=f"'{name}': expected a name that is free"):
            scanner_kind(name)(lambda words: words)
    with pytest.raises(InputError, match="'virtual': expected a name that is free"):
        camera_kind("virtual")(lambda words: words)
    with pytest.raises(InputError, match="expected small letters"):
        camera_kind("Acme:1")(lambda words: words)
    # The same function again is no mistake: its file may be loaded twice.
    camera_kind("webcam")(kinds.open_webcam)
    assert camera_kinds()["webcam"].summary.startswith("``webcam``")
    assert {"screen", "memory"} <= projector_kinds().keys()


PLUGIN = """
from fringeworks.devices.opening import camera_kind, projector_kind
from fringeworks.types import DeviceProblem

@camera_kind("{camera}")
def open_it(words):
    "Opens nothing."
    raise DeviceProblem("mine: " + words)

@projector_kind("mine-too")
def open_that(words):
    raise DeviceProblem("mine-too: " + words)
{more}
"""


def test_a_plugin_file_brings_kinds(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(PLUGIN.format(camera="mine", more=""))
    assert load_plugin(path) == load_plugin(path) == ["mine", "mine-too"]
    with pytest.raises(DeviceProblem, match="mine: 5"):
        open_camera("mine:5")
    for name, camera, more, said in (
        ("taken.py", "webcam", "", "'webcam': expected a name that is free"),
        ("broken.py", "other", "1 / 0", "ZeroDivisionError"),
    ):
        (tmp_path / name).write_text(
            PLUGIN.format(camera=camera, more=more).replace("mine-too", name[:-3])
        )
        with pytest.raises(InputError, match=said):
            load_plugin(tmp_path / name)
        assert "other" not in camera_kinds()
        assert name[:-3] not in projector_kinds()
    (tmp_path / "empty.py").write_text("")
    with pytest.raises(InputError, match="projector_kind or scanner_kind, got none"):
        load_plugin(tmp_path / "empty.py")


def test_a_projector_and_a_camera_in_one_device():
    """One name opens both, with which one at either; half of it is refused."""

    @scanner_kind("head")
    def open_head(which):
        return None, which

    for projector, camera, which in (("head", "head", ""), ("head:1", "head", "1")):
        assert open_devices(projector, camera) == (None, which)
    assert open_devices("head", "head:2")[1] == open_devices("head:2", "head:2")[1] == "2"
    for projector, camera in (("head", "webcam:0"), ("screen", "head"), ("head:1", "head:2")):
        with pytest.raises(DeviceProblem, match="head: opens a projector and a camera together"):
            open_devices(projector, camera)
    for opens in (open_camera, open_projector):
        with pytest.raises(DeviceProblem, match="expected it for both"):
            opens("head")


def test_a_plugin_file_may_bring_a_method_too(tmp_path):
    path = tmp_path / "method.py"
    path.write_text("import fringeworks as fw\n@fw.method('calm')\ndef calm(pair, *, a=1): ...\n")
    assert load_plugin(path) == ["calm"]


def test_installed_plugins_bring_kinds(monkeypatch):
    class Entry:
        name, value = "acme", "acme_camera"

        def load(self):
            camera_kind("installed")(lambda words: words)

    def entry_points(group):
        return [Entry()] if group == "fringeworks.devices" else []

    monkeypatch.setattr(importlib.metadata, "entry_points", entry_points)
    registry.load_installed.cache_clear()
    try:
        assert open_camera("installed:x") == "x"
    finally:
        registry.load_installed.cache_clear()


NO_PI = (
    "a camera of the Raspberry Pi: expected the package picamera2, got none; apt install "
    "python3-picamera2, in a virtual environment with --system-site-packages"
)


def test_the_list_says_what_is_there_and_what_is_missing(monkeypatch):
    def missing():
        raise MissingPackage("a window needs glfw: pip install 'fringeworks[capture]'")

    limits = CameraLimits(640, 480, (0.1, 100.0), (0.0, 24.0), ("Mono8", "Mono12"), 1 / 30)
    monkeypatch.setattr("fringeworks.devices.window.monitors", missing)
    monkeypatch.setattr("fringeworks.devices.hid_link.hid_serials", lambda _: ["S1"])
    monkeypatch.setattr(
        "fringeworks.devices.webcam.webcams",
        lambda: iter([Webcam(2, "HD Cam", limits), DeviceProblem("webcam 3: in use")]),
    )
    monkeypatch.setattr("fringeworks.devices.genicam.genicam_cameras", list)
    monkeypatch.setattr("fringeworks.devices.gentl_system.gentl_cameras", list)
    monkeypatch.setitem(sys.modules, "picamera2", None)
    monkeypatch.setattr(
        "fringeworks.devices.photo_camera.photo_cameras", lambda: {"usb:001,004": "Canon EOS 100D"}
    )
    camera_kind("acme", find=lambda: [ListedDevice("acme:1", "Acme 1")])(lambda words: words)
    projectors, cameras = list_devices()
    assert [str(line) for line in projectors] == [
        "screen: a window needs glfw: pip install 'fringeworks[capture]'",
        "dlpc900:S1: a projector with the controller DLPC900",
        "dlpc350: a projector with the controller DLPC350, serial number S1",
    ]
    assert [(str(line), line.usable) for line in cameras] == [
        (
            "webcam:2: HD Cam, 640 × 480 px, exposure 0.1 to 100 ms, gain 0 to 24 dB, Mono8, "
            "Mono12, 30 frames per second",
            True,
        ),
        ("webcam: webcam 3: in use", False),
        ("genicam: none found", False),
        ("gentl: none found", False),
        (f"picamera: {NO_PI}", False),
        ("gphoto2:usb:001,004: Canon EOS 100D", True),
        ("acme:1: Acme 1", True),
    ]


def test_what_is_on_this_machine_is_listed():
    """Whatever is missing here, there is a line for each kind that can be listed."""
    projectors, cameras = list_devices()
    assert {line.words.partition(":")[0] for line in projectors} >= {"screen"}
    assert {line.words.partition(":")[0] for line in cameras} >= {"webcam", "genicam"}


def test_screens_are_opened_by_name_or_number(monkeypatch):
    from fringeworks.devices.window import Monitor

    found = [
        Monitor(k, name, 1280, 800, 60.0, 1.0, k == 0)
        for k, name in enumerate(("eDP-1", "DP", "DP"))
    ]
    monkeypatch.setattr("fringeworks.devices.window.monitors", lambda: found)
    listed = [line.words for line in list_devices()[0] if line.words.startswith("screen")]
    assert listed == ["screen:eDP-1", "screen:1", "screen:2"]


@pytest.mark.system
def test_the_vendors_camera_captures(tmp_path):
    """The example runs as it stands, and its kind opens from a plug-in file."""
    ran = subprocess.run(
        [sys.executable, str(EXAMPLE), str(tmp_path / "c")],
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    stack = read_stack(tmp_path / "c")
    assert stack.camera == "Acme SN1"
    assert len(ran.stdout.splitlines()) == len(stack.frames) == 12
    decoded = fw.decode(stack)
    assert np.isfinite(decoded.x.coordinate_px).mean() > 0.2
    assert load_plugin(EXAMPLE) == ["acme"]
    with open_camera("acme:SN1") as camera:
        assert isinstance(camera, Camera)
        assert camera.configure(CameraSettings(exposure_ms=5.0)).exposure_ms == pytest.approx(5.0)
        camera.discard()
        assert camera.grab().pixels.shape[::-1] == (
            camera.limits().width_px,
            camera.limits().height_px,
        )
    with pytest.raises(DeviceProblem, match="Acme SN9: expected a camera that is connected"):
        open_camera("acme:SN9")


def test_devices_print_their_names():
    projector, camera = fw.open_devices("virtual:sphere", "virtual:sphere")
    with projector, camera:
        assert repr(projector) == "<VirtualProjector virtual>"
        assert repr(camera) == "<VirtualCamera virtual>"
