"""Faults of GenTL cameras, and what is said where a package or a producer is missing."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import time
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest

from fringeworks import PatternPlan, encode
from fringeworks.devices.gentl import GentlCamera
from fringeworks.devices.gentl_nodes import _description
from fringeworks.devices.gentl_system import gentl_cameras
from fringeworks.devices.opening import list_devices, open_camera
from fringeworks.devices.protocols import PtpCamera
from fringeworks.files import read_stack
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.scan.together import CameraGroup, capture_together
from fringeworks.types import CameraSettings, DeviceProblem, InputError, MissingPackage, Region
from tests.fake_gentl import SIZE, GentlPeer, compiler

pytestmark = pytest.mark.system

WITHIN_S = 0.1
"""Time within which both frames are exposed here, s: threads of a busy machine need some."""


def test_without_genicam(monkeypatch):
    monkeypatch.setitem(sys.modules, "genicam.gentl", None)
    sentence = r"expected the package genicam, got none; pip install 'fringeworks\[gentl\]'"
    with pytest.raises(MissingPackage, match=sentence):
        open_camera("gentl")
    lines = {line.words: line.description for line in list_devices()[1]}
    assert "expected the package genicam" in lines["gentl"]


def test_descriptions_come_from_the_camera_or_a_file(tmp_path):
    xml = "<RegisterDescription/>"
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("camera.xml", xml)
    (tmp_path / "a camera.zip").write_bytes(packed.getvalue())

    def port(*urls, memory=b""):
        return SimpleNamespace(
            url_info_list=[SimpleNamespace(url=url) for url in urls],
            read=lambda address, size: (size, memory[address - 256 : address - 256 + size]),
        )

    plain = xml.encode() + b"\0\0"
    web = "http://maker.example/camera.xml"
    assert _description(port(web, f"Local:c.xml;100;{len(plain):x}", memory=plain)) == xml
    size = f"{len(packed.getvalue()):X}?SchemaVersion=1.1.0"
    assert _description(port(f"Local:///c.zip;100;{size}", memory=packed.getvalue())) == xml
    assert _description(port((tmp_path / "a camera.zip").as_uri().replace("file", "File"))) == xml
    with pytest.raises(DeviceProblem, match="brings its description, got http://maker"):
        _description(port(web))


@pytest.fixture
def peer():
    pytest.importorskip("genicam.gentl", reason="needs genicam")
    if compiler() is None:
        pytest.skip("needs a C compiler for the producer")
    made = GentlPeer(np.stack((np.full((SIZE, SIZE), 200.0), np.full((SIZE, SIZE), 5.0))))
    yield made
    made.stop()


@pytest.mark.usefixtures("peer")
def test_without_a_producer_and_with_a_broken_one(monkeypatch, tmp_path):
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(tmp_path))
    with pytest.raises(DeviceProblem, match=r"expected a producer, a file \.cti in a folder"):
        GentlCamera()
    (tmp_path / "broken.cti").write_bytes(b"no library")
    with pytest.raises(DeviceProblem, match=r"expected a producer that loads, got broken\.cti: "):
        GentlCamera()


def test_unplugged_is_said_within_a_second_and_the_camera_comes_back(peer):
    with GentlCamera() as camera:
        camera.grab()
        peer.kill()
        camera.discard()
        begin_s = time.monotonic()
        with pytest.raises(DeviceProblem, match="unplugged or switched off.*connect it and resume"):
            camera.grab()
        assert time.monotonic() - begin_s < 1.0
        with pytest.raises(DeviceProblem, match="unplugged"):
            camera.configure(CameraSettings(exposure_ms=5.0))
        with pytest.raises(DeviceProblem, match="cameras found: none"):
            GentlCamera()
        # The camera that is plugged in again is another one: the old handle stays void.
        peer.start()
        with pytest.raises(DeviceProblem, match="unplugged"):
            camera.grab(2.0)
    with GentlCamera() as camera:
        assert camera.grab().complete


def test_lost_and_incomplete_frames(peer):
    with GentlCamera() as camera:
        camera.configure(CameraSettings(triggered=True))
        peer.projector.show(np.full((SIZE, SIZE), 255, np.uint8))
        camera.trigger()
        first = camera.grab()
        peer.lose(1, 1)
        camera.trigger()
        with pytest.raises(DeviceProblem, match="expected a frame, got none within 0.2 s"):
            camera.grab(0.2)
        camera.trigger()
        half = camera.grab()
        assert not half.complete
        assert not half.pixels.any()
        camera.trigger()
        whole = camera.grab()
        assert whole.complete
        assert [g.number - first.number for g in (half, whole)] == [2, 3]
        np.testing.assert_array_equal(whole.pixels, first.pixels)
        assert first.pixels.min() == 200


def test_twelve_bits_and_wrong_settings(peer):
    with GentlCamera() as camera:
        camera.configure(CameraSettings(pixel_format="Mono12", exposure_ms=10.0, triggered=True))
        peer.projector.show(np.full((SIZE, SIZE), 255, np.uint8))
        camera.trigger()
        assert np.all(camera.grab().pixels == 3200)
        with pytest.raises(DeviceProblem, match=r"Fake FWCAM0: Value = 4000 must be equal or sma"):
            camera.configure(CameraSettings(region=Region(0, 0, 4000, 64)))
        # A refused setting leaves a camera that works.
        camera.trigger()
        assert camera.grab().complete


@pytest.mark.usefixtures("peer")
def test_it_opens_by_serial_number_and_ends_cleanly():
    script = (
        "from tests.fake_gentl import producer; producer()\n"
        "from fringeworks.devices import open_camera\n"
        "camera = open_camera('gentl:FWCAM0'); print(camera.grab().pixels.shape)\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, f"({SIZE}, {SIZE})\n", "")


def test_two_cameras_by_the_clock_of_the_network(peer, tmp_path):
    """Both frames of a picture are within a stated time of each other, or it is said."""
    peer.both(ptp_offset_ns=400)
    with GentlCamera("FWCAM0") as one, GentlCamera("FWCAM1") as two:
        assert isinstance(one, PtpCamera)
        for camera in (one, two):
            camera.configure(CameraSettings(exposure_ms=5.0, triggered=True))
        group = CameraGroup([one, two], within_s=WITHIN_S)
        group.trigger()
        with pytest.raises(InputError, match="within_s: expected cameras whose clocks follow"):
            group.grab()
        assert one.synchronise() == 0.0
        assert two.synchronise() == pytest.approx(4e-7)
        group.trigger()
        assert group.grab().clock == "ptp"
        plan = PatternPlan(SIZE, SIZE, (PhaseSteps("x", 16.0, equal_steps(4)),))
        folders = [tmp_path / "one", tmp_path / "two"]
        peer.lose(0, 1)
        capture_together(
            peer.projector,
            [one, two],
            plan,
            folders,
            settings=CameraSettings(triggered=False),
        )
        taken = [read_stack(folder) for folder in folders]
        assert [stack.camera for stack in taken] == [one.name, two.name]
        for stack in taken:
            for frame, picture in zip(stack.frames, encode(plan), strict=True):
                np.testing.assert_array_equal(frame, peer.expected(picture, 5.0))
        # A camera that misses a trigger is one frame late for ever: the clocks tell.
        group.configure(CameraSettings(triggered=True))
        one.trigger()
        time.sleep(2 * WITHIN_S)
        two.trigger()
        with pytest.raises(DeviceProblem, match="FWCAM1: expected frames within 100 ms of each"):
            group.grab()


@pytest.mark.usefixtures("peer")
def test_a_camera_opened_again_has_its_own_clock():
    with GentlCamera() as camera:
        camera.synchronise()
        assert camera.grab().device_s > 1.5e9
        assert camera.grab().clock == "ptp"
    with GentlCamera() as camera:
        assert camera.grab().clock == "camera"


def test_a_producer_that_fails_is_named_where_no_other_finds_a_camera(peer, monkeypatch, tmp_path):
    """The camera may be that of the producer that fails."""
    (tmp_path / "broken.cti").write_bytes(b"no library")
    folders = os.environ["GENICAM_GENTL64_PATH"]
    monkeypatch.setenv("GENICAM_GENTL64_PATH", os.pathsep.join([str(tmp_path), folders]))
    assert [one.identifier for one in gentl_cameras()] == ["FWCAM0"]
    peer._control["plugged"] = 0
    with pytest.raises(DeviceProblem, match=r"expected a producer that loads, got broken\.cti"):
        GentlCamera()
