"""Cameras of the GenICam standard: one set of tests for both libraries that talk to them.

Aravis meets a real peer of GigE Vision, its fake camera on loopback with frames of our own. GenTL
meets a producer built for the tests.
"""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

import numpy as np
import pytest

from fringeworks import InputError, MissingPackage, PatternPlan, encode
from fringeworks.devices.aravis import aravis
from fringeworks.devices.genicam import GenicamCamera, genicam_cameras
from fringeworks.devices.gentl import GentlCamera
from fringeworks.devices.gentl_system import gentl_cameras
from fringeworks.devices.opening import list_devices, open_camera
from fringeworks.devices.protocols import Camera, Closing, LineCamera, TriggeredCamera
from fringeworks.files import read_stack
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.scan.agreement import MAX_INCOMPLETE
from fringeworks.scan.capture import capture
from fringeworks.scan.delay import measure_delay
from fringeworks.scan.exposure_proof import exposure_obeys
from fringeworks.types import CameraSettings, DeviceProblem, Region
from tests.fake_gentl import GentlPeer, compiler
from tests.fake_gige import CameraProcess, counts, the_only_camera

pytestmark = pytest.mark.system

SIZE = 128
"""Rows and columns of the pictures and of the camera's region: packets on loopback are cheap."""


class SharedProjector(Closing):
    """A projector whose picture another process reads from a file."""

    name, bits, refresh_s, size_px = "shared", 8, 1 / 60, (SIZE, SIZE)

    def __init__(self, path):
        self._picture = np.lib.format.open_memmap(
            path, mode="w+", dtype=np.uint8, shape=(SIZE, SIZE)
        )

    def show(self, picture):
        self._picture[:] = picture
        return time.monotonic()


def scene():
    y, x = np.mgrid[:SIZE, :SIZE]
    white = 120 + 60 * np.sin(x / 30) * np.cos(y / 25)
    return np.stack((white, 0.04 * white + 2))


class Peer(CameraProcess):
    """The fake camera in a process of its own, and the projector that it looks at."""

    def __init__(self, folder: Path, serial: str, lost: int = 0):
        self.scene = scene()
        np.save(folder / "scene.npy", self.scene)
        self.projector = SharedProjector(folder / "picture.npy")
        super().__init__(serial, "tests.fake_gige", folder, serial, lost)

    def expected(self, picture, exposure_ms=10.0, gain_db=0.0):
        return counts(self.scene, picture, 1e3 * exposure_ms, gain_db)


class OverAravis:
    """Cameras through Aravis."""

    kind, camera, wide, cameras = "genicam", GenicamCamera, "Mono16", staticmethod(genicam_cameras)

    @staticmethod
    @contextlib.contextmanager
    def peer(folder, serial, **options):
        with the_only_camera():
            made = Peer(folder, serial, **options)
            made.maker, made.serial = "Aravis Fake", serial
            try:
                yield made
            finally:
                made.stop()

    @staticmethod
    def check():
        try:
            aravis()
        except MissingPackage as error:
            pytest.skip(f"{error}")


class OverGentl:
    """Cameras through a producer of GenTL."""

    kind, camera, wide, cameras = "gentl", GentlCamera, "Mono12", staticmethod(gentl_cameras)

    @staticmethod
    @contextlib.contextmanager
    def peer(*_, **options):
        made = GentlPeer(scene(), **options)
        made.maker, made.serial = "Fringeworks Fake", made.identifier
        try:
            yield made
        finally:
            made.stop()

    @staticmethod
    def check():
        pytest.importorskip("genicam.gentl", reason="needs genicam")
        if compiler() is None:
            pytest.skip("needs a C compiler for the producer")


@pytest.fixture(params=[OverAravis, OverGentl], ids=["aravis", "gentl"])
def over(request):
    request.param.check()
    return request.param


def opened(over, made):
    camera = over.camera(made.identifier)
    camera.configure(CameraSettings(exposure_ms=10.0, gain_db=0.0, region=Region(0, 0, SIZE, SIZE)))
    return camera


def triggered(camera):
    """The moment of a trigger and its frame: again where packets were lost, as captures do."""
    for _ in range(MAX_INCOMPLETE):
        sent_s = camera.trigger()
        if (grab := camera.grab()).complete:
            break
    return sent_s, grab


def plan():
    return PatternPlan(
        SIZE, SIZE, tuple(PhaseSteps("x", p, equal_steps(4)) for p in (16.0, 18.0, 20.0))
    )


def test_a_line_exposes_the_frames_until_triggers_end(over, tmp_path):
    """Nobody pulses the line of the fake camera: no frame comes until it runs freely again."""
    with over.peer(tmp_path, "FW9") as made, opened(over, made) as camera:
        assert isinstance(camera, LineCamera)
        camera.wait_for_line()
        with pytest.raises(DeviceProblem, match="expected a frame, got none within 0.3 s"):
            camera.grab(0.3)
        camera.configure(CameraSettings(triggered=False))
        # A busy computer loses packets.
        assert any(camera.grab().complete for _ in range(MAX_INCOMPLETE))


def test_frames_without_their_first_packet_arrive_now(tmp_path):
    """Half of the packets are lost, so half of the frames have no time stamp of the library."""
    OverAravis.check()
    with OverAravis.peer(tmp_path, "FW10", lost=500) as made, opened(OverAravis, made) as camera:
        for _ in range(6):
            asked_s = time.monotonic()
            grab = camera.grab()
            assert not grab.complete
            assert asked_s - 1.0 < grab.host_s <= time.monotonic()


def test_discovery_settings_and_triggers(over, tmp_path):
    with over.peer(tmp_path, "FW1") as made:
        assert [c.serial for c in over.cameras() if c.identifier == made.identifier] == [
            made.serial
        ]
        with opened(over, made) as camera:
            assert isinstance(camera, TriggeredCamera)
            assert isinstance(camera, Camera)
            assert camera.name == f"{made.maker} {made.serial}"
            limits = camera.limits()
            assert "Mono8" in limits.pixel_formats
            assert limits.exposure_ms == pytest.approx((0.01, 10_000))
            used = camera.configure(
                CameraSettings(
                    exposure_ms=7.0, gain_db=3.0, region=Region(0, 0, 64, 48), triggered=True
                )
            )
            assert used == CameraSettings(7.0, 3.0, Region(0, 0, 64, 48), "Mono8", True)
            picture = next(iter(encode(plan())))
            made.projector.show(picture)
            (sent, first), (again, second) = triggered(camera), triggered(camera)
            assert first.complete
            np.testing.assert_array_equal(first.pixels, made.expected(picture, 7.0, 3.0)[:48, :64])
            assert second.number > first.number
            assert second.device_s > first.device_s
            for grab, at in ((first, sent), (second, again)):
                assert 0 <= grab.host_s - at < 1.0
            with pytest.raises(DeviceProblem, match="expected a frame, got none"):
                camera.grab(0.2)
            with pytest.raises(InputError, match="exposure_ms: expected 0.01 to 10000, got 20000"):
                camera.configure(CameraSettings(exposure_ms=20_000.0))
            with pytest.raises(InputError, match="pixel format"):
                camera.configure(CameraSettings(pixel_format="Mono12p"))
            with pytest.raises(DeviceProblem, match="not in use"):
                over.camera(made.identifier)
        with pytest.raises(DeviceProblem, match="got a closed one"):
            camera.grab()


def test_sixteen_bit_frames(over, tmp_path):
    with over.peer(tmp_path, "FW2") as made, opened(over, made) as camera:
        used = camera.configure(CameraSettings(pixel_format=over.wide))
        assert used.pixel_format == over.wide
        assert camera.grab().pixels.dtype == np.uint16


@pytest.mark.parametrize("fast", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_capture_over_the_wire_is_exact(over, tmp_path, fast):
    with over.peer(tmp_path, "FW3") as made, opened(over, made) as camera:
        delay = measure_delay(made.projector, camera, triggered=True) if fast else None
        folder = capture(made.projector, camera, plan(), tmp_path / "c", delay=delay)
        stack = read_stack(folder)
        assert stack.camera == f"{made.maker} {made.serial}"
        for frame, picture in zip(stack.frames, encode(plan()), strict=True):
            np.testing.assert_array_equal(frame, made.expected(picture))


def test_lost_packets_do_not_change_the_frames(over, tmp_path):
    with over.peer(tmp_path, "FW4", lost=50) as made, opened(over, made) as camera:
        stack = read_stack(capture(made.projector, camera, plan(), tmp_path / "c"))
        for frame, picture in zip(stack.frames, encode(plan()), strict=True):
            np.testing.assert_array_equal(frame, made.expected(picture))


@pytest.mark.long
def test_a_killed_camera_leaves_what_was_taken(over, tmp_path):
    with over.peer(tmp_path, "FW5") as made:
        taken = []

        def kill_at_five(label):
            taken.append(label)
            if len(taken) == 5:
                made.kill()

        with opened(over, made) as camera, pytest.raises(DeviceProblem):
            capture(made.projector, camera, plan(), tmp_path / "c", progress=kill_at_five)
        assert 5 <= len(list((tmp_path / "c").glob("*.png"))) < 12
        made.start()
        with opened(over, made) as camera:
            folder = capture(made.projector, camera, plan(), tmp_path / "c", resume=True)
            whole = capture(made.projector, camera, plan(), tmp_path / "d")
        for frame, other in zip(read_stack(folder).frames, read_stack(whole).frames, strict=True):
            np.testing.assert_array_equal(frame, other)


def test_a_camera_without_ptp_says_so(tmp_path):
    OverAravis.check()
    with OverAravis.peer(tmp_path, "FW6") as made, GenicamCamera(made.identifier) as camera:
        with pytest.raises(DeviceProblem, match=r"Fake FW6: expected a camera with PTP"):
            camera.synchronise()
        assert camera.grab().clock == "camera"


def test_an_unknown_camera_names_those_there(over, tmp_path):
    with over.peer(tmp_path, "FW6") as made:
        listed = f"{made.identifier}: {made.maker}"
        with pytest.raises(DeviceProblem, match=f"cameras found: {listed}"):
            over.camera("Basler-123")


def test_the_camera_is_listed_and_opened_by_words(over, tmp_path):
    with over.peer(tmp_path, "FW7") as made:
        words = f"{over.kind}:{made.identifier}"
        listed = {line.words: line for line in list_devices()[1]}
        assert "exposure 0.01 to 10000 ms" in listed[words].description
        assert "Mono8" in str(listed[words])
        with open_camera(words) as camera:
            assert camera.name == f"{made.maker} {made.serial}"
            busy = {line.words: line for line in list_devices()[1]}[words]
            assert not busy.usable
            assert "in use" in busy.description


@pytest.mark.long
def test_the_exposure_obeys_over_the_wire(over, tmp_path):
    with over.peer(tmp_path, "FW8") as made, opened(over, made) as camera:
        found = exposure_obeys(made.projector, camera)
        assert found.obeyed
        assert found.ratio == pytest.approx(2.0, abs=0.05)
