"""A window on a virtual screen: every pixel exact, and a whole measurement through the screen."""

from __future__ import annotations

import os
import shutil
import subprocess
import time

import numpy as np
import pytest

from fringeworks import PatternPlan, encode
from fringeworks.devices.protocols import Closing, Grab, Projector
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.devices.window import Monitor, WindowProjector, chosen_monitor, monitors
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.pipeline.stacks import measure
from fringeworks.rig.pinhole import pose
from fringeworks.scan.capture import capture
from fringeworks.simulate.bodies import Body, Plane
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import CameraSettings, DeviceProblem, InputError

pytestmark = pytest.mark.system

glfw = pytest.importorskip("glfw")
mss = pytest.importorskip("mss")
pytest.importorskip("moderngl")
if shutil.which("Xvfb") is None:
    pytest.skip("Xvfb is not installed (apt install xvfb)", allow_module_level=True)


class Screen:
    """An X server without a screen."""

    def __init__(self, width, height):
        read, write = os.pipe()
        command = [
            "Xvfb",
            "-displayfd",
            str(write),
            "-screen",
            "0",
            f"{width}x{height}x24",
            "-nolisten",
            "tcp",
        ]
        self.process = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as file:
            self.display = f":{file.readline().strip()}"

    def close(self):
        self.process.terminate()
        self.process.wait(10)


@pytest.fixture
def screen(monkeypatch, request):
    made = Screen(*request.param)
    monkeypatch.setenv("DISPLAY", made.display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    yield made
    glfw.terminate()
    made.close()


def grabbed(source):
    return np.asarray(source.grab(source.monitors[0]))[:, :, :3]


@pytest.mark.parametrize("screen", [(1920, 1200)], indirect=True)
@pytest.mark.usefixtures("screen")
def test_no_byte_differs():
    plan = PatternPlan(
        1920,
        1200,
        tuple(
            PhaseSteps(a, p, equal_steps(3))
            for a, p in (("x", 16.0), ("x", 18.0), ("y", 16.0), ("y", 18.0))
        ),
    )
    pictures = list(encode(plan))
    with WindowProjector() as window, mss.MSS() as source:
        assert isinstance(window, Projector)
        assert window.size_px == (1920, 1200)
        for k in range(4 * len(pictures)):
            picture = pictures[k % len(pictures)]
            window.show(picture)
            shown = grabbed(source)
            for colour in range(3):
                assert np.array_equal(shown[:, :, colour], picture), k


@pytest.mark.parametrize("screen", [(642, 400)], indirect=True)
@pytest.mark.usefixtures("screen")
def test_no_byte_differs_in_colours():
    steps = PhaseSteps("x", 16.0, equal_steps(3))
    pictures = list(encode(PatternPlan(642, 400, (steps,), colours=True)))
    with WindowProjector() as window, mss.MSS() as source:
        assert window.shows_colours
        for picture in (*pictures, pictures[0][..., 0], *pictures):
            window.show(np.ascontiguousarray(picture))
            shown = grabbed(source)[:, :, ::-1]  # blue comes first
            assert np.array_equal(shown, np.broadcast_to(np.atleast_3d(picture), shown.shape))


@pytest.mark.parametrize("screen", [(640, 400)], indirect=True)
@pytest.mark.usefixtures("screen")
def test_what_cannot_be_shown_is_refused():
    assert [
        m.size_px if hasattr(m, "size_px") else (m.width_px, m.height_px) for m in monitors()
    ] == [(640, 400)]
    with pytest.raises(DeviceProblem, match="expected one of 0: screen, 640 × 400 px"):
        WindowProjector("beamer")
    window = WindowProjector(0)
    with pytest.raises(InputError, match="expected 640 × 400 px of uint8"):
        window.show(np.zeros((100, 100), np.uint8))
    window.close()
    window.close()
    with pytest.raises(DeviceProblem, match="a closed one"):
        window.show(np.zeros((400, 640), np.uint8))


def test_no_display_is_said(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(DeviceProblem, match="expected a display, got none"):
        monitors()


class ScreenCamera(Closing):
    """A camera that looks at a scene in the light of what is really on the screen."""

    name = "screen camera"

    def __init__(self, scene, source):
        self._scene, self._source = scene, source
        self._rng = np.random.default_rng(0)
        self._number = 0

    def configure(self, settings):  # noqa: ARG002, nothing can be set
        return CameraSettings(pixel_format="Mono8")

    def grab(self, timeout_s=5.0):  # noqa: ARG002, the screen is always there
        picture = grabbed(self._source)[:, :, 1] / 255.0
        counts = 255 * (self._scene.projected(0.01 + 0.99 * picture) + self._scene.ambient)
        counts = counts + self._rng.normal(0, 1.0, counts.shape)
        self._number += 1
        return Grab(
            np.clip(np.rint(counts), 0, 255).astype(np.uint8), time.monotonic(), None, self._number
        )

    def waiting(self):
        return 0

    def discard(self):
        pass


RIG = standard_rig(scale=0.25)


@pytest.mark.parametrize(
    "screen", [(RIG.projector.width_px, RIG.projector.height_px)], indirect=True
)
@pytest.mark.usefixtures("screen")
def test_points_through_the_screen_lie_on_the_surface(tmp_path):
    """Plan → window → screen → optics of the virtual rig → frames → coordinates → points."""
    turn = np.radians(20.0)
    R = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    plane = pose(R, np.array([0.0, 0.0, 500.0]))
    scene = RigScene(look(RIG, [Body(Plane(200.0, 160.0), plane)]), Optics(exposure=0.8))
    plan = PatternPlan(
        *screen_size(), tuple(PhaseSteps("x", p, equal_steps(4)) for p in (14.0, 16.0, 19.0))
    )
    with WindowProjector() as window, mss.MSS() as source:
        folder = capture(window, ScreenCamera(scene, source), plan, tmp_path / "c")
    points = measure(folder, RIG).points
    xyz = points.xyz_mm.reshape(-1, 3)
    sigma = points.sigma_mm.reshape(-1)
    normal = R[:, 2]
    distance = (xyz - plane[:3, 3]) @ normal
    # σ is along the camera's ray; its part across the plane is the normal's.
    ray = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
    score = distance / (sigma * np.abs(ray @ normal))
    known = np.isfinite(score)
    assert known.sum() > 10_000
    assert np.mean(np.abs(score[known]) < 1) == pytest.approx(0.68, abs=0.02)


def screen_size():
    return RIG.projector.width_px, RIG.projector.height_px


def test_the_screen_that_is_not_the_main_one_is_taken():
    first = Monitor(0, "DP-1", 2560, 1440, 60.0, 1.0, True)
    beamer = Monitor(1, "HDMI-1", 1920, 1080, 60.0, 1.0, False)
    third = Monitor(2, "HDMI-2", 1920, 1080, None, 1.5, False)
    assert chosen_monitor([first], None) == first
    assert chosen_monitor([first, beamer], None) == beamer
    assert chosen_monitor([first, beamer], "dp-1") == first
    assert chosen_monitor([first, beamer, third], 2) == third
    with pytest.raises(
        DeviceProblem, match=r"0: DP-1, .* main screen; 1: HDMI-1, .*; 2: HDMI-2, .* scaled by 1.5"
    ):
        chosen_monitor([first, beamer, third], None)
    with pytest.raises(DeviceProblem, match="no such screen"):
        chosen_monitor([first], "HDMI-1")
