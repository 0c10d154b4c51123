"""Cameras of the Raspberry Pi, against a library that stands for picamera2."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.devices.protocols import Camera, Closing
from fringeworks.devices.raspberry_camera import RaspberryCamera
from fringeworks.files import read_stack
from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from fringeworks.scan.capture import capture
from fringeworks.types import CameraSettings, DeviceProblem, InputError, MissingPackage, Region
from tests import fake_picamera2

PLAN = PatternPlan(128, 96, (PhaseSteps("x", 32.0, equal_steps(4)),))


class Wall(Closing):
    """A projector and what a camera sees of it."""

    name, size_px, bits, refresh_s = "wall", (128, 96), 8, 1 / 60

    def __init__(self):
        self.picture = np.zeros((96, 128), np.uint8)
        self.rng, self.shown = np.random.default_rng(3), 0

    def show(self, picture):
        self.picture, self.shown = picture.copy(), self.shown + 1
        return time.monotonic()

    def frame(self, exposure_us, gain):
        light = (20 + 0.7 * self.picture) * exposure_us / 20_000 * gain
        return light + self.rng.normal(0, 1.0, light.shape)


@pytest.fixture
def wall(monkeypatch):
    wall = Wall()
    module, wall.state = fake_picamera2.library(wall.frame)
    monkeypatch.setitem(sys.modules, "picamera2", module)
    return wall


def test_settings_wait_for_their_frames(wall):
    with RaspberryCamera() as camera:
        assert isinstance(camera, Camera)
        limits = camera.limits()
        assert limits.exposure_ms == pytest.approx((0.06, 700.0))
        assert limits.gain_db == pytest.approx((0.0, 24.08), abs=0.01)
        controls = wall.state.cameras[0].configured["controls"]
        assert not controls["AeEnable"]
        assert not controls["AwbEnable"]
        wall.picture[:] = 100
        for exposure_ms, gain_db in ((10.0, 0.0), (5.0, 6.0), (15.01, 0.0)):
            used = camera.configure(CameraSettings(exposure_ms=exposure_ms, gain_db=gain_db))
            assert used.exposure_ms == pytest.approx(exposure_ms, abs=0.011)
            assert used.gain_db == pytest.approx(gain_db, abs=1e-6)
            seen = camera.grab().pixels
            assert seen.mean() == pytest.approx(
                90 * used.exposure_ms / 20 * 10 ** (gain_db / 20), abs=1.5
            )
        assert used.region == Region(0, 0, 128, 96)
        # A camera that does not obey is read back as it is.
        wall.state.obeys = False
        assert camera.configure(CameraSettings(exposure_ms=3.0)).exposure_ms == used.exposure_ms
    assert wall.state.closed


def test_colours_become_luminance(wall):
    wall.state.tint = (0.0, 0.0, 1.0)
    wall.picture[:] = 200
    with RaspberryCamera() as camera:
        red = camera.grab().pixels.mean()
    # 160 counts of red alone.
    assert red == pytest.approx(0.299 * 160, abs=1.0)


def test_a_plan_is_captured(wall, tmp_path):
    with fw.devices.open_camera("picamera:0") as camera:
        folder = capture(
            wall, camera, PLAN, tmp_path / "c", settings=CameraSettings(exposure_ms=10.0)
        )
    for frame, picture in zip(read_stack(folder).frames, fw.encode(PLAN), strict=True):
        assert np.abs(frame - (20 + 0.7 * picture) / 2).mean() < 2


def test_a_camera_that_stops_is_said_within_a_second(wall, tmp_path):
    gone = []
    show = wall.show

    def interrupted(picture):
        if not gone and any((tmp_path / "c").glob("*.png")):
            gone.append(time.monotonic())
            wall.state.gone.set()
        return show(picture)

    wall.show = interrupted
    with (
        RaspberryCamera() as camera,
        pytest.raises(
            DeviceProblem, match="picamera 0: expected a frame, got none: the camera was unpl"
        ),
    ):
        capture(wall, camera, PLAN, tmp_path / "c")
    assert time.monotonic() - gone[0] < 1.0
    kept = {path: path.read_bytes() for path in (tmp_path / "c").glob("*.png")}
    assert kept
    wall.state.gone.clear()
    with RaspberryCamera() as camera:
        capture(wall, camera, PLAN, tmp_path / "c", resume=True)
    assert all(path.read_bytes() == data for path, data in kept.items())
    assert len(read_stack(tmp_path / "c").frames) == 4


def test_what_it_cannot_do(wall, monkeypatch):
    del wall
    with RaspberryCamera() as camera:
        for settings, said in (
            (CameraSettings(exposure_ms=900.0), "exposure_ms: expected 0.06 to 700, got 900"),
            (CameraSettings(gain_db=30.0), "gain_db: expected 0 to 24.0"),
            (CameraSettings(triggered=True), "expected no trigger"),
            (CameraSettings(region=Region(0, 0, 10, 10)), "the whole sensor"),
        ):
            with pytest.raises(InputError, match=said):
                camera.configure(settings)
    with pytest.raises(
        DeviceProblem, match="expected one of 1 cameras that are connected, got number 1"
    ):
        RaspberryCamera(1)
    listed = [str(one) for one in fw.devices.list_devices()[1] if one.words.startswith("picamera")]
    assert listed == ["picamera:0: imx477"]
    monkeypatch.setitem(sys.modules, "picamera2", None)
    with pytest.raises(
        MissingPackage, match="expected the package picamera2, got none; apt install"
    ):
        RaspberryCamera()
