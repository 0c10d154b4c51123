"""A GigE Vision camera on loopback whose frames come from a scene in a projector's light.

``python -m tests.fake_gige FOLDER SERIAL [LOST]``: the picture on the projector is read from
``FOLDER/picture.npy``; ``FOLDER/scene.npy`` holds what the camera sees of white and of black. LOST
is the number of lost packets per thousand. Ends when standard input closes.
"""

from __future__ import annotations

import contextlib
import ctypes as c
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from fringeworks.devices.aravis import HANDLE, aravis

REFERENCE_US = 10_000.0
"""Exposure at which white has the counts of the scene."""
FILL = c.CFUNCTYPE(None, c.c_void_p, c.c_void_p, c.c_uint32, c.c_uint32, c.c_uint32)
WIDTH, HEIGHT, SENSOR_WIDTH, SENSOR_HEIGHT, PERIOD = 0x100, 0x104, 0x11C, 0x118, 0x138
"""Addresses of the fake camera's registers: region, size of the sensor, frame period in µs."""


def counts(scene, picture, exposure_us, gain_db):
    """Counts of the camera (h, w): the picture's pixels, enlarged or cut to the scene's size."""
    seen = np.resize(picture, scene.shape[1:]) if picture.shape != scene.shape[1:] else picture
    white, black = scene
    light = black + (white - black) * (seen / 255.0)
    return np.clip(
        np.rint(light * exposure_us / REFERENCE_US * 10 ** (gain_db / 20)), 0, 255
    ).astype(np.uint8)


class FakeCamera:
    """Aravis' fake camera with frames of our own.

    ``pixels(exposure_us, gain)`` returns a frame of 8 bit, of which the camera sends its region.
    ``shape`` is the size of the sensor, and of the region until another one is asked for.
    """

    def __init__(self, serial, pixels, *, lost=0, shape=None):
        self._library, self._pixels = aravis(), pixels
        self._camera = self._library.plain(
            "arv_gv_fake_camera_new",
            HANDLE,
            (c.c_char_p, b"127.0.0.1"),
            (c.c_char_p, serial.encode()),
        )
        set_property = self._library._objects.g_object_set
        set_property.argtypes = [HANDLE, c.c_char_p, c.c_double, c.c_void_p]
        set_property(self._camera, b"gvsp-lost-ratio", lost / 1000, None)
        assert self._library.plain("arv_gv_fake_camera_is_running", c.c_int, (HANDLE, self._camera))
        self._fake = self._library.plain(
            "arv_gv_fake_camera_get_fake_camera", HANDLE, (HANDLE, self._camera)
        )
        if shape is not None:
            for address, value in zip(
                (HEIGHT, WIDTH, SENSOR_HEIGHT, SENSOR_WIDTH), (*shape, *shape), strict=True
            ):
                self._write(address, value)
        self._keep = FILL(self._fill)
        self._library.plain(
            "arv_fake_camera_set_fill_pattern",
            None,
            (HANDLE, self._fake),
            (FILL, self._keep),
            (c.c_void_p, None),
        )

    def set_period(self, period_s):
        """Set the time from one frame to the next, s."""
        self._write(PERIOD, round(1e6 * period_s))

    def run(self):
        """Say that the camera is ready, and wait until standard input closes."""
        print("ready", flush=True)
        sys.stdin.read()

    def _write(self, address, value):
        assert self._library.plain(
            "arv_fake_camera_write_register",
            c.c_int,
            (HANDLE, self._fake),
            (c.c_uint32, address),
            (c.c_uint32, value),
        )

    def _fill(self, buffer, _, exposure_us, gain, __):
        def ask(what, kind, *arguments):
            return self._library.plain(f"arv_buffer_get_{what}", kind, (HANDLE, buffer), *arguments)

        size = c.c_size_t()
        data = ask("data", HANDLE, (c.POINTER(c.c_size_t), c.byref(size)))
        h, w = ask("image_height", c.c_int), ask("image_width", c.c_int)
        sent = np.ctypeslib.as_array((c.c_uint8 * (w * h)).from_address(data)).reshape(h, w)
        sent[:] = self._pixels(exposure_us, gain)[:h, :w]


class CameraProcess:
    """A fake camera in a process of its own: a module of the tests, and its arguments."""

    def __init__(self, serial, module, *arguments):
        self.identifier = f"Aravis-Fake-{serial}"
        self._command = [sys.executable, "-m", module, *map(str, arguments)]
        self.start()

    def start(self):
        """Start the camera, and wait until it is ready."""
        self.process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=Path(__file__).parent.parent,
        )
        assert self.process.stdout.readline() == b"ready\n"

    def stop(self):
        """End the camera, if it runs."""
        if self.process.returncode is None:
            self.process.communicate(timeout=10)

    def kill(self):
        """End the camera without a word to those who use it."""
        os.kill(self.process.pid, signal.SIGKILL)
        self.stop()


@contextlib.contextmanager
def the_only_camera():
    """Wait until no other test has a fake camera: its port is that of the protocol."""
    import fcntl

    with (Path(tempfile.gettempdir()) / "fringeworks-gige.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def main():
    folder, serial = Path(sys.argv[1]), sys.argv[2]
    scene = np.load(folder / "scene.npy")
    picture = np.lib.format.open_memmap(folder / "picture.npy", mode="r")

    def pixels(exposure_us, gain):
        return counts(scene, np.array(picture), exposure_us, gain)

    FakeCamera(serial, pixels, lost=int(sys.argv[3]) if len(sys.argv) > 3 else 0).run()


if __name__ == "__main__":
    main()
