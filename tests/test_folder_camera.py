"""A folder into which another program writes photographs."""

from __future__ import annotations

import io
import os
import threading
import time

import numpy as np
import pytest
import tifffile
from PIL import Image

from fringeworks import FileProblem, InputError
from fringeworks.devices.folder_camera import FolderCamera
from fringeworks.devices.protocols import Camera
from fringeworks.files.images import write_frame
from fringeworks.types import CameraSettings, DeviceProblem, Region

SETTLED_S = 0.1


def photo(seed=0, shape=(30, 40)):
    return np.random.default_rng(seed).integers(0, 250, shape, np.uint8)


def opened(folder):
    return FolderCamera(folder, settled_s=SETTLED_S)


def test_new_photographs_come_in_their_order(tmp_path):
    write_frame(tmp_path / "old.png", photo(9))
    with opened(tmp_path) as camera:
        assert isinstance(camera, Camera)
        (tmp_path / "notes.txt").write_text("no image")
        write_frame(tmp_path / ".hidden.png", photo(8))
        with pytest.raises(DeviceProblem, match=r"expected a new image within 0.2 s, got none"):
            camera.grab(0.2)
        started_s = time.monotonic()
        # The name says nothing about the order; the time does.
        for k, name in enumerate(("b.png", "a.png", "old.png")):
            write_frame(tmp_path / name, photo(k))
            os.utime(tmp_path / name, ns=(0, time.time_ns() + k * 1000))
        for k in range(3):
            grab = camera.grab(2.0)
            np.testing.assert_array_equal(grab.pixels, photo(k))
            assert grab.number == k
            assert grab.complete
            assert started_s <= grab.host_s <= time.monotonic()
        assert camera.waiting() == 0
    with pytest.raises(DeviceProblem, match="got a closed one"):
        camera.grab()


def test_a_file_that_is_being_written_is_waited_for(tmp_path):
    content = io.BytesIO()
    Image.fromarray(photo()).save(content, "PNG")
    half = len(content.getvalue()) // 2

    def write_slowly():
        with (tmp_path / "a.png").open("wb") as file:
            file.write(content.getvalue()[:half])
            file.flush()
            # Longer than a file must be unchanged: only decoding tells that a part is missing.
            time.sleep(3 * SETTLED_S)
            file.write(content.getvalue()[half:])

    with opened(tmp_path) as camera:
        writer = threading.Thread(target=write_slowly)
        writer.start()
        np.testing.assert_array_equal(camera.grab(3.0).pixels, photo())
        writer.join()


def test_a_file_that_never_becomes_an_image(tmp_path):
    with opened(tmp_path) as camera:
        (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n nothing")
        with pytest.raises(DeviceProblem, match="one that cannot be read: .*a.png"):
            camera.grab(0.4)
        write_frame(tmp_path / "b.png", photo(1))
        np.testing.assert_array_equal(camera.grab(2.0).pixels, photo(1))
        (tmp_path / "c.png").touch()
        with pytest.raises(DeviceProblem, match="c.png, which is still being written"):
            camera.grab(0.3)


def test_discarded_files_do_not_come(tmp_path):
    with opened(tmp_path) as camera:
        write_frame(tmp_path / "a.png", photo(1))
        camera.discard()
        write_frame(tmp_path / "b.png", photo(2))
        np.testing.assert_array_equal(camera.grab(2.0).pixels, photo(2))


def test_settings_belong_to_the_other_program(tmp_path):
    with opened(tmp_path) as camera:
        assert camera.configure(CameraSettings()) == CameraSettings(triggered=False)
        with pytest.raises(InputError, match="exposure_ms: expected no setting, .* set it there"):
            camera.configure(CameraSettings(exposure_ms=5.0, triggered=False))
        with pytest.raises(InputError, match="triggered"):
            camera.configure(CameraSettings(triggered=True))
        write_frame(tmp_path / "a.png", photo())
        limits = camera.limits()
        assert (limits.width_px, limits.height_px) == (40, 30)
        assert camera.configure(CameraSettings()).region == Region(0, 0, 40, 30)
        assert camera.waiting() == 1
        assert camera.grab().number == 0


def test_depths_and_colours(tmp_path):
    with opened(tmp_path) as camera:
        tifffile.imwrite(tmp_path / "a.tif", photo().astype(np.uint16) * 100)
        np.testing.assert_array_equal(camera.grab(2.0).pixels, photo().astype(np.uint16) * 100)
        colours = photo(3, (30, 40, 3))
        colours[2, 3] = (255, 0, 0)
        Image.fromarray(colours).save(tmp_path / "b.png")
        grey = camera.grab(2.0).pixels
        assert grey.dtype == np.uint8
        assert grey[2, 3] == 255
        expected = colours @ np.array((0.299, 0.587, 0.114))
        expected[2, 3] = 255
        assert np.abs(grey - expected).max() <= 0.51
        tifffile.imwrite(tmp_path / "c.tif", photo().astype(np.float32))
        with pytest.raises(
            (FileProblem, DeviceProblem), match="counts of 8 or 16 bit, got float32"
        ):
            camera.grab(0.5)


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(DeviceProblem, match="expected a folder that can be read"):
        FolderCamera(tmp_path / "nowhere")
