"""A GigE Vision camera on loopback whose frames come from a scene in a projector's light.

``python -m tests.fake_gige FOLDER SERIAL [LOST]``: the picture on the projector is read from
``FOLDER/picture.npy``; ``FOLDER/scene.npy`` holds what the camera sees of white and of black. LOST
is the number of lost packets per thousand. Ends when standard input closes.
"""

from __future__ import annotations

import ctypes as c
import sys
from pathlib import Path

import numpy as np

from fringeworks.devices.aravis import HANDLE, aravis

REFERENCE_US = 10_000.0
"""Exposure at which white has the counts of the scene."""
FILL = c.CFUNCTYPE(None, c.c_void_p, c.c_void_p, c.c_uint32, c.c_uint32, c.c_uint32)


def counts(scene, picture, exposure_us, gain_db):
    """Counts of the camera (h, w): the picture's pixels, enlarged or cut to the scene's size."""
    seen = np.resize(picture, scene.shape[1:]) if picture.shape != scene.shape[1:] else picture
    white, black = scene
    light = black + (white - black) * (seen / 255.0)
    return np.clip(
        np.rint(light * exposure_us / REFERENCE_US * 10 ** (gain_db / 20)), 0, 255
    ).astype(np.uint8)


def main():
    folder, serial = Path(sys.argv[1]), sys.argv[2]
    library = aravis()
    camera = library.plain(
        "arv_gv_fake_camera_new", HANDLE, (c.c_char_p, b"127.0.0.1"), (c.c_char_p, serial.encode())
    )
    if len(sys.argv) > 3:
        library.set_number(camera, b"gvsp-lost-ratio", int(sys.argv[3]) / 1000)
    assert library.plain("arv_gv_fake_camera_is_running", c.c_int, (HANDLE, camera))
    scene = np.load(folder / "scene.npy")
    picture = np.lib.format.open_memmap(folder / "picture.npy", mode="r")

    def fill(buffer, _, exposure_us, gain, __):
        size = c.c_size_t()
        data = library.plain(
            "arv_buffer_get_data", HANDLE, (HANDLE, buffer), (c.POINTER(c.c_size_t), c.byref(size))
        )
        h = library.plain("arv_buffer_get_image_height", c.c_int, (HANDLE, buffer))
        w = library.plain("arv_buffer_get_image_width", c.c_int, (HANDLE, buffer))
        pixels = np.ctypeslib.as_array((c.c_uint8 * (w * h)).from_address(data)).reshape(h, w)
        pixels[:] = counts(scene, np.array(picture), exposure_us, gain)[:h, :w]

    keep = FILL(fill)
    fake = library.plain("arv_gv_fake_camera_get_fake_camera", HANDLE, (HANDLE, camera))
    library.plain(
        "arv_fake_camera_set_fill_pattern", None, (HANDLE, fake), (FILL, keep), (c.c_void_p, None)
    )
    print("ready", flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main()
