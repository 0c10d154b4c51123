"""Photo cameras through gphoto2, against a program of that name."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.devices.photo_camera import PhotoCamera, _milliseconds
from fringeworks.devices.protocols import Camera, Closing
from fringeworks.files import read_stack
from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from fringeworks.scan.capture import capture
from fringeworks.types import CameraSettings, DeviceProblem, InputError, MissingPackage, Region

pytestmark = pytest.mark.system
PLAN = PatternPlan(128, 96, (PhaseSteps("x", 32.0, equal_steps(3)),))


class Studio(Closing):
    """A projector, and the state of the camera that looks at it."""

    name, size_px, bits, refresh_s = "wall", (128, 96), 8, 1 / 60

    def __init__(self, folder):
        self.folder, self.shown = folder, 0
        self.state(gone=False, full=False, shutter="1/15")
        self.show(np.zeros((96, 128), np.uint8))

    def state(self, **changed):
        path = self.folder / "state.json"
        had = json.loads(path.read_text()) if path.exists() else {}
        path.write_text(json.dumps(had | changed))
        return json.loads(path.read_text())

    def show(self, picture):
        np.save(self.folder / "picture.npy", picture)
        self.shown += 1
        return time.monotonic()


@pytest.fixture
def studio(tmp_path, monkeypatch):
    place = tmp_path / "peer"
    place.mkdir()
    program = place / "gphoto2"
    peer = Path(__file__).parent / "fake_gphoto2.py"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} {peer} "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(place))
    monkeypatch.setenv("GPHOTO_PEER", str(place))
    return Studio(place)


def test_cameras_are_listed_without_a_photograph(studio, monkeypatch):
    def listed():
        return [str(c) for c in fw.devices.list_devices()[1] if c.words.startswith("gphoto2")]

    assert listed() == ["gphoto2:usb:001,004: Canon EOS 100D"]
    with fw.devices.open_camera("gphoto2:usb:001,004") as camera:
        assert camera.name == "Canon EOS 100D"
    studio.state(gone=True)
    assert listed() == ["gphoto2: none found"]
    monkeypatch.setenv("PATH", "")
    (said,) = listed()
    assert "expected the program gphoto2, got none; apt install gphoto2" in said


def test_a_plan_is_captured_in_raw(studio, tmp_path):
    with fw.devices.open_camera("gphoto2:usb:001,004") as camera:
        assert isinstance(camera, Camera)
        assert camera.name == "Canon EOS 100D"
        limits = camera.limits()
        assert (limits.width_px, limits.height_px) == (128, 96)
        assert limits.exposure_ms == pytest.approx((4.0, 1000.0))
        assert (camera.waiting(), camera.configure(CameraSettings()).exposure_ms) == (
            1, pytest.approx(1000 / 15),
        )  # fmt: skip
        folder = capture(
            studio, camera, PLAN, tmp_path / "c", settings=CameraSettings(exposure_ms=16.0)
        )
    assert studio.state()["shutter"] == "1/60"
    stack = read_stack(folder)
    # Of the two files of a photograph, that with 16 bits is read.
    for frame, picture in zip(stack.frames, fw.encode(PLAN), strict=True):
        assert np.abs(frame / 257 - (20 + 0.7 * picture) / 4).mean() < 2
        assert frame.max() > 10_000


def test_unplugged_in_the_middle(studio, tmp_path):
    gone = []
    show = studio.show

    def interrupted(picture):
        if studio.shown == 6 and not gone:
            gone.append(time.monotonic())
            studio.state(gone=True)
        return show(picture)

    studio.show = interrupted
    with (
        PhotoCamera() as camera,
        pytest.raises(
            DeviceProblem, match="Canon EOS 100D: expected a camera .*, got: Error: No cam"
        ),
    ):
        capture(studio, camera, PLAN, tmp_path / "c")
    assert time.monotonic() - gone[0] < 1.0
    kept = {path: path.read_bytes() for path in (tmp_path / "c").glob("*.png")}
    assert kept
    studio.state(gone=False)
    with PhotoCamera() as camera:
        capture(studio, camera, PLAN, tmp_path / "c", resume=True)
    assert all(path.read_bytes() == data for path, data in kept.items())


def test_what_it_cannot_do(studio, monkeypatch):
    with PhotoCamera() as camera:
        for settings, said in (
            (
                CameraSettings(exposure_ms=8.0),
                "expected about one of the camera's own, 4 to 1000, got 8",
            ),
            (CameraSettings(gain_db=3.0), "gain_db: expected no such setting"),
            (CameraSettings(triggered=True), "triggered: expected no such setting"),
            (CameraSettings(region=Region(0, 0, 5, 5)), "region: expected no such"),
        ):
            with pytest.raises(InputError, match=said):
                camera.configure(settings)
        studio.state(full=True)
        with pytest.raises(DeviceProblem, match="expected a photograph, got none: its card"):
            camera.grab()
    with pytest.raises(DeviceProblem, match="expected an open camera, got a closed one"):
        camera.grab()
    with pytest.raises(DeviceProblem, match="gphoto2 usb:9: .*ports of cameras found: usb:001,004"):
        PhotoCamera("usb:9")
    studio.state(gone=True)
    with pytest.raises(
        DeviceProblem, match="switched on and not mounted as a disk, got none; .*none"
    ):
        PhotoCamera()
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(MissingPackage, match="expected the program gphoto2, got none; apt install"):
        PhotoCamera()


def test_exposures_as_cameras_write_them():
    for word, time_ms in (
        ("1/60", 1000 / 60),
        ("0.5", 500.0),
        ("30", 30_000.0),
        ("1.3s", 1300.0),
        ("0.3 s", 300.0),
    ):
        assert _milliseconds(word) == pytest.approx(time_ms)
    for word in ("bulb", "auto", "", "1/0", "0"):
        assert _milliseconds(word) is None
