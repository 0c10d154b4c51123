"""Webcams without hardware: video files, image sequences, and a fake driver with faults."""

from __future__ import annotations

import itertools
import os
import threading
import time

import cv2
import numpy as np
import pytest

from fringeworks import InputError, PatternPlan, encode
from fringeworks.devices import frame_reader, webcam
from fringeworks.devices.protocols import Camera, Closing, TriggeredCamera
from fringeworks.devices.webcam import WebcamCamera, grey_of, linux_webcams, webcams
from fringeworks.files import read_stack
from fringeworks.files.images import read_frame, read_frames
from fringeworks.patterns import PhaseSteps, Uniform, equal_steps
from fringeworks.scan.capture import capture
from fringeworks.types import CameraSettings, DeviceProblem, Region


@pytest.fixture(autouse=True)
def no_thread_is_left():
    before = set(threading.enumerate())
    yield
    left = [t for t in threading.enumerate() if t not in before]
    assert not left


def images(count=7, colour=False):
    rng = np.random.default_rng(4)
    shape = (24, 32, 3) if colour else (24, 32)
    return [rng.integers(0, 256, shape, np.uint8) for _ in range(count)]


def sequence(folder, frames):
    for k, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"f-{k:02d}.png"), frame)
    return str(folder / "f-%02d.png")


class Driver:
    """A webcam as OpenCV shows it: frames come at a pace, and the driver queues them.

    A frame holds its own number in the first pixel and its exposure in all others.
    """

    period_s = 0.01
    late_s = 0.0
    """Time until the first frame, s."""
    queue = 3
    opens = True
    """Whether the webcam opens."""
    gone_after = None
    """Number of the frame after which the webcam is unplugged."""
    broken = ()
    """Numbers of frames that cannot be decoded."""
    refuses = ()
    """Properties that the driver refuses."""
    backend = "V4L2"
    made = None

    def __init__(self, *_):
        self.start_s = time.monotonic() + self.late_s
        self.next = 0
        self.properties = {cv2.CAP_PROP_EXPOSURE: 156.0, cv2.CAP_PROP_AUTO_EXPOSURE: 3.0}
        self.history = []
        self.released = False
        self.threads = set()
        Driver.made = self

    def isOpened(self):  # noqa: N802
        return self.opens

    def getBackendName(self):  # noqa: N802
        return self.backend

    def newest(self):
        return int((time.monotonic() - self.start_s) / self.period_s)

    def grab(self):
        self.threads.add(threading.current_thread())
        if self.gone_after is not None and self.next > self.gone_after:
            return False
        # The driver keeps the first frames that nobody took, as UVC drivers do, and drops later
        # ones: this is how frames become stale.
        if self.newest() - self.next > self.queue:
            self.next = self.newest() - self.queue
        time.sleep(max(0.0, self.start_s + self.next * self.period_s - time.monotonic()))
        self.grabbed, self.next = self.next, self.next + 1
        return True

    def retrieve(self):
        if self.grabbed in self.broken:
            return False, None
        image = np.full((12, 16, 3), min(255, self.properties[cv2.CAP_PROP_EXPOSURE]), np.uint8)
        image[0, 0] = self.grabbed % 250
        return True, image

    def set(self, which, value):
        self.history.append((which, value))
        if which in self.refuses:
            return False
        self.properties[which] = value
        return True

    def get(self, which):
        return -1.0 if which in self.refuses else self.properties.get(which, 0.0)

    def release(self):
        self.released = True


@pytest.fixture
def driver(monkeypatch):
    """The fake driver in the place of OpenCV's, with faults set as attributes."""
    made = type("Faulty", (Driver,), {})
    monkeypatch.setattr(cv2, "VideoCapture", made)
    return made


def test_a_sequence_of_images_loses_no_frame(tmp_path):
    frames = images()
    with WebcamCamera(sequence(tmp_path, frames)) as camera:
        assert isinstance(camera, Camera)
        assert not isinstance(camera, TriggeredCamera)
        assert (camera.limits().width_px, camera.limits().height_px) == (32, 24)
        time.sleep(0.05)
        grabs = [camera.grab() for _ in frames]
        for k, (grab, frame) in enumerate(zip(grabs, frames, strict=True)):
            np.testing.assert_array_equal(grab.pixels, frame)
            assert grab.number == k
            assert grab.complete
        assert all(a.host_s <= b.host_s for a, b in itertools.pairwise(grabs))
        with pytest.raises(DeviceProblem, match="got the end of the file"):
            camera.grab()
    with pytest.raises(DeviceProblem, match="got a closed one"):
        camera.grab()
    camera.close()


def test_a_video_file_can_be_read(tmp_path):
    path = tmp_path / "v.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (64, 48))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no Motion JPEG")
    for level in (40, 90, 140):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    with WebcamCamera(str(path)) as camera:
        for level in (40, 90, 140):
            assert np.abs(camera.grab().pixels.astype(int) - level).max() <= 2


@pytest.mark.parametrize("channel", ["luminance", "red", "green", "blue"])
def test_colours_become_grey_as_in_files(tmp_path, channel):
    frames = images(2, colour=True)
    frames[0][3, 4] = frames[1][3, 4] = (255, 10, 20)
    with WebcamCamera(sequence(tmp_path, frames), channel=channel) as camera:
        for k, frame in enumerate(frames):
            grey = camera.grab().pixels
            if channel != "luminance":
                n = ("blue", "green", "red").index(channel)
                np.testing.assert_array_equal(grey, frame[..., n])
                continue
            expected = read_frames([tmp_path / f"f-{k:02d}.png"], stack=True).frames[0]
            assert np.abs(grey - expected).max() <= 0.51
            assert grey[3, 4] == 255
    assert grey_of(np.full((4, 5, 3), 77, np.uint8), "luminance").tolist() == [[77] * 5] * 4
    with pytest.raises(DeviceProblem, match="8 bits in one or three colours"):
        grey_of(np.zeros((4, 5, 3), np.uint16), "luminance")
    with pytest.raises(InputError, match="channel: expected one of"):
        WebcamCamera(0, channel="lime")


def test_frames_are_never_stale(driver):
    driver.period_s = 0.05
    with WebcamCamera(0) as camera:
        made = Driver.made
        time.sleep(0.5)
        for _ in range(5):
            camera.discard()
            at, number = time.monotonic(), made.newest()
            grab = camera.grab()
            assert grab.host_s >= at
            # The frame of that moment or a later one, though the driver queues three.
            assert grab.pixels[0, 0] >= number
            time.sleep(0.17)
        assert camera.waiting() <= 4
        assert camera.limits().frame_s == pytest.approx(0.05, rel=0.3)
        assert len(made.threads) == 1
        assert threading.current_thread() not in made.threads
    assert made.released


@pytest.mark.usefixtures("driver")
def test_frames_that_nobody_grabs_are_counted():
    with WebcamCamera(0) as camera:
        first = camera.grab().number
        time.sleep(0.2)
        later = [camera.grab().number for _ in range(3)]
        assert later[0] > first + 4
        assert later == sorted(set(later))


@pytest.mark.usefixtures("driver")
def test_a_frame_in_decoding_is_discarded_too():
    decoding = threading.Event()
    with WebcamCamera(0) as camera:
        real = Driver.made.retrieve

        def slow():
            decoding.set()
            time.sleep(0.05)
            return real()

        Driver.made.retrieve = slow
        for _ in range(3):
            decoding.clear()
            assert decoding.wait(2)
            at = time.monotonic()
            camera.discard()
            assert camera.grab().host_s >= at


@pytest.mark.usefixtures("driver")
def test_settings_are_read_back():
    with WebcamCamera(0) as camera:
        made = Driver.made
        assert (cv2.CAP_PROP_AUTO_EXPOSURE, 1.0) in made.history
        assert (cv2.CAP_PROP_AUTO_WB, 0.0) in made.history
        used = camera.configure(CameraSettings(exposure_ms=12.34, gain_db=0.0))
        assert used == CameraSettings(12.3, None, Region(0, 0, 16, 12), "Mono8", False)
        assert made.properties[cv2.CAP_PROP_EXPOSURE] == 123
        time.sleep(0.03)
        camera.discard()
        assert camera.grab().pixels[5, 5] == 123
        used = camera.configure(CameraSettings(region=Region(2, 3, 8, 4)))
        assert used.region == Region(2, 3, 8, 4)
        assert camera.grab().pixels.shape == (4, 8)
        for settings, said in (
            (CameraSettings(gain_db=6.0), "expected 0 \\(the lowest gain\\)"),
            (CameraSettings(pixel_format="Mono16"), "expected the pixel format Mono8"),
            (CameraSettings(triggered=True), "webcams have no trigger"),
            (CameraSettings(region=Region(10, 0, 8, 4)), "within 16 × 12 px"),
        ):
            with pytest.raises(InputError, match=said):
                camera.configure(settings)


def test_windows_counts_exposures_in_powers_of_two(driver):
    driver.backend = "DSHOW"
    with WebcamCamera(0) as camera:
        assert camera.configure(CameraSettings(exposure_ms=10.0)).exposure_ms == 1000 / 128
        assert Driver.made.properties[cv2.CAP_PROP_EXPOSURE] == -7


def test_what_the_driver_does_not_tell_is_none(driver):
    driver.refuses = (cv2.CAP_PROP_EXPOSURE,)
    with WebcamCamera(0) as camera:
        assert camera.configure(CameraSettings(exposure_ms=10.0)).exposure_ms is None
    driver.refuses, driver.backend = (), "AVFOUNDATION"
    with WebcamCamera(0) as camera:
        assert camera.configure(CameraSettings()).exposure_ms is None
        with pytest.raises(InputError, match="does not tell its unit, got 10"):
            camera.configure(CameraSettings(exposure_ms=10.0))


def test_an_unplugged_webcam_says_so(driver):
    driver.gone_after = 20
    with WebcamCamera(0) as camera:
        with pytest.raises(DeviceProblem, match="webcam 0: .*the camera was unplugged"):
            for _ in range(100):
                camera.grab(1.0)
        with pytest.raises(DeviceProblem, match="the camera was unplugged"):
            camera.configure(CameraSettings(exposure_ms=5.0))
        assert Driver.made.released


def test_an_error_of_the_driver_ends_the_stream(driver):
    def explode(_):
        raise cv2.error("select() timeout")

    with WebcamCamera(0) as camera:
        driver.grab = explode
        with pytest.raises(DeviceProblem, match="got an error of the driver: select"):
            for _ in range(100):
                camera.grab(1.0)


def test_a_frame_that_cannot_be_decoded_is_incomplete(driver):
    driver.broken = range(5, 9)
    with WebcamCamera(0) as camera:
        grabs = [camera.grab() for _ in range(12)]
    broken = [g for g in grabs if not g.complete]
    # Of frames that wait for a slow test, the oldest are lost.
    assert broken
    assert all(g.complete == (g.number not in driver.broken) for g in grabs)
    assert broken[0].pixels.shape == (12, 16)


def test_a_webcam_without_frames(driver, monkeypatch):
    monkeypatch.setattr(webcam, "_usual_cause", lambda _: "another program uses it")
    driver.gone_after = -1
    with pytest.raises(DeviceProblem, match="first frame, got none; another program uses it"):
        WebcamCamera(0)
    assert Driver.made.released
    driver.gone_after, driver.late_s = None, 0.2
    monkeypatch.setattr(webcam, "FIRST_FRAME_S", 0.01)
    with pytest.raises(DeviceProblem, match="first frame, got none; another program uses it"):
        WebcamCamera(0)
    monkeypatch.undo()
    monkeypatch.setattr(cv2, "VideoCapture", driver)
    driver.broken = range(10)
    with pytest.raises(DeviceProblem, match="expected a frame that can be decoded"):
        WebcamCamera(0)
    assert Driver.made.released


def test_a_driver_that_hangs(driver, monkeypatch):
    freed = threading.Event()
    monkeypatch.setattr(frame_reader, "ANSWER_S", 0.05)
    with WebcamCamera(0) as camera:
        driver.grab = lambda _: freed.wait(5)
        driver.retrieve = lambda _: (False, None)
        time.sleep(0.03)
        with pytest.raises(DeviceProblem, match="answer of the driver within 0.05 s"):
            camera.configure(CameraSettings(exposure_ms=5.0))
        with pytest.raises(DeviceProblem, match="return from a read .*: unplug the camera"):
            camera.close()
        freed.set()


def test_webcams_that_do_not_open(driver, monkeypatch):
    driver.opens = False
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(DeviceProblem, match=r"there is no /dev/video77; .* are there: "):
        WebcamCamera(77)
    real = webcam._usual_cause
    monkeypatch.setattr(webcam, "_usual_cause", lambda _: real("/dev/null"))
    with pytest.raises(DeviceProblem, match="another program uses /dev/null, or it is no camera"):
        WebcamCamera(0)
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(DeviceProblem, match="usermod -aG video"):
        WebcamCamera(0)
    assert Driver.made.released


def test_files_that_are_no_video(tmp_path, capfd):
    with pytest.raises(DeviceProblem, match="got no such file"):
        WebcamCamera(str(tmp_path / "v.avi"))
    (tmp_path / "v.avi").write_bytes(b"nothing" * 100)
    with pytest.raises(DeviceProblem, match="expected a video that OpenCV reads"):
        WebcamCamera(str(tmp_path / "v.avi"))
    assert "cap_" not in capfd.readouterr().err


def test_webcams_of_linux_are_listed(driver, monkeypatch, tmp_path):
    for name, about in (
        ("video0", ("HD Cam\n", "0\n")),
        ("video1", ("HD Cam\n", "1\n")),
        ("video10", None),
    ):
        (tmp_path / name).touch()
        if about:
            (tmp_path / "sys" / name).mkdir(parents=True)
            (tmp_path / "sys" / name / "name").write_text(about[0])
            (tmp_path / "sys" / name / "index").write_text(about[1])
    found = linux_webcams(tmp_path, tmp_path / "sys")
    assert found == {0: "HD Cam", 10: ""}
    monkeypatch.setattr(webcam, "linux_webcams", lambda: found)
    monkeypatch.setattr("sys.platform", "linux")
    listed = list(webcams())
    assert [(c.number, c.model, c.limits.width_px) for c in listed] == [
        (0, "HD Cam", 16),
        (10, "", 16),
    ]
    driver.opens = False
    assert all(isinstance(c, DeviceProblem) for c in webcams())
    monkeypatch.setattr("sys.platform", "darwin")
    assert list(webcams()) == []


def test_a_frame_as_read_from_its_file(tmp_path):
    frame = images(1)[0]
    with WebcamCamera(sequence(tmp_path, [frame])) as camera:
        np.testing.assert_array_equal(camera.grab().pixels, read_frame(tmp_path / "f-00.png")[0])


class Shown(Closing):
    """A projector that remembers what it showed when."""

    name, bits, refresh_s, size_px = "shown", 8, 1 / 60, (64, 48)

    def __init__(self):
        self.pictures = [(0.0, np.zeros((48, 64), np.uint8))]

    def show(self, picture):
        self.pictures.append((time.monotonic(), picture))
        return self.pictures[-1][0]

    def at(self, time_s):
        return next(p for s, p in reversed(self.pictures) if s <= time_s)


def test_a_capture_with_a_webcam(driver, tmp_path):
    """Frames of colour that are exposed while pictures change, behind the driver's queue."""
    shown, rng = Shown(), np.random.default_rng(3)
    tint = np.array((0.5, 0.7, 0.6))

    def retrieve(self):
        end_s = self.start_s + self.grabbed * self.period_s
        # Exposed over one period: a change of the picture in it mixes two.
        both = [shown.at(end_s - part * self.period_s) for part in (0.1, 0.5, 0.9)]
        light = np.mean(both, axis=0)[..., None] * tint + 8
        return True, np.clip(np.rint(light + rng.normal(0, 1, light.shape)), 0, 255).astype(
            np.uint8
        )

    driver.retrieve = retrieve
    plan = PatternPlan(64, 48, (PhaseSteps("x", 16.0, equal_steps(4)), Uniform("white")))
    with WebcamCamera(0) as camera:
        folder = capture(shown, camera, plan, tmp_path / "c")
    stack = read_stack(folder)
    assert (stack.camera, stack.saturation) == ("webcam 0", 255)
    weight = float(tint @ np.array((0.114, 0.587, 0.299)))
    for frame, picture in zip(stack.frames, encode(plan), strict=True):
        assert np.abs(frame - (weight * picture + 8)).mean() < 1
