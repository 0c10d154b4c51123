"""A GigE Vision camera that sees the virtual rig, and the projector before it, in two processes.

``python -m tests.wire_rig FOLDER SCENE SERIAL LOST`` is the camera; ``Screen`` is the projector.
Pictures and the times from which they are lit go through files in FOLDER. A frame integrates the
light over its exposure, so that it mixes two pictures where they change in it.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from fringeworks.devices.protocols import checked_picture
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.simulate.bodies import Body, Sphere
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import standard_rig
from fringeworks.simulate.virtual_rig import highlight, look

REFRESH_S = 1 / 60
"""Time from one picture of the projector to the next, s."""
REFERENCE_MS = 16.666
"""Exposure at which the scene's light is meant, ms."""
DELAY_S = 0.012
"""Time from the refresh at which a picture is handed over until its light appears, s."""
SLOTS = 6
"""Number of the last pictures that are kept; an exposure of 50 ms sees three at most."""
GAP_S = 0.004
"""Time between two exposures, s: a camera needs it for readout."""
SHORTEST_S = 0.02
"""Shortest time from one frame to the next, s."""
RIG = standard_rig(scale=0.2)
"""256 × 205 px of the camera, and 384 × 240 px of the projector."""
SPHERE_MM = 40.0
"""Radius of the ball of the scene ``sphere``, mm."""


def scene_named(name: str) -> RigScene:
    """``sphere``: an even ball. ``glossy``: paint of 0.02 to 1 and a highlight."""
    if name == "glossy":
        from tests.hdr_scene import glossy_view

        view = glossy_view(0)
        lobe = highlight(view, strength=4.0, shininess=400.0)
        return RigScene(view, Optics(exposure=0.2), highlight=lobe)
    middle = np.eye(4)
    middle[2, 3] = 500.0
    return RigScene(look(RIG, [Body(Sphere(SPHERE_MM), middle, albedo=0.7)]), Optics(exposure=1.0))


def frame_of(scene, parts, exposure_ms, gain_db):
    """Counts of the camera, (h, w), free of noise; parts are pictures and shares of the exposure."""
    light = scene.ambient.copy()
    for picture, share in parts:
        light += share * scene.projected(0.005 + 0.995 * picture / 255.0)
    counts = 255 * light * exposure_ms / REFERENCE_MS * 10 ** (gain_db / 20)
    return np.clip(np.rint(counts), 0, 255).astype(np.uint8)


class Board:
    """The files through which the projector's pictures reach the camera."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.pictures = np.load(folder / "pictures.npy", mmap_mode="r+")
        self.times_s = np.load(folder / "times.npy", mmap_mode="r+")
        """Time from which the picture of each slot is lit; at the end, the number of pictures."""

    @staticmethod
    def make(folder: Path) -> None:
        """Make the files: black since ever."""
        columns, rows = RIG.projector.width_px, RIG.projector.height_px
        np.save(folder / "pictures.npy", np.zeros((SLOTS, rows, columns), np.uint8))
        times = np.full(SLOTS + 1, np.inf)
        times[0], times[-1] = -np.inf, 1
        np.save(folder / "times.npy", times)

    def add(self, picture, from_s):
        count = int(self.times_s[-1])
        slot = count % SLOTS
        self.times_s[slot] = np.inf
        self.pictures[slot] = picture
        self.times_s[slot] = from_s
        self.times_s[-1] = count + 1

    def seen(self, start_s, stop_s):
        """Pictures that lit an exposure, with their shares of it."""
        count = int(self.times_s[-1])
        slots = [n % SLOTS for n in range(max(0, count - SLOTS + 1), count)]
        # A picture that is about to replace the oldest one has a slot of its own.
        edges = np.clip([*self.times_s[slots], np.inf], start_s, stop_s)
        edges[0] = start_s
        shares = np.diff(edges) / (stop_s - start_s)
        parts = [(self.pictures[n].copy(), s) for n, s in zip(slots, shares, strict=True) if s > 0]
        # One picture is exactly itself, free of rounding.
        return parts if len(parts) > 1 else [(parts[0][0], 1.0)]


class Screen:
    """A projector whose pictures reach the camera through files.

    FOLDER/hold names a frame: once its file is written, the projector says so with a file FOLDER/held
    and waits until FOLDER/hold is gone before it shows the next picture.
    """

    name, bits, refresh_s = "wire", 8, REFRESH_S
    size_px = RIG.projector.width_px, RIG.projector.height_px

    def __init__(self, folder):
        self._board = Board(Path(folder))

    def show(self, picture):
        picture = checked_picture(picture, self.size_px, self.bits)
        hold = self._board.folder / "hold"
        if hold.exists() and Path(hold.read_text()).exists():
            (self._board.folder / "held").touch()
            while hold.exists():
                time.sleep(0.01)
        handed_s = (time.monotonic() // REFRESH_S + 1) * REFRESH_S
        self._board.add(picture, handed_s + DELAY_S)
        time.sleep(max(0.0, handed_s - time.monotonic()))
        return handed_s

    def close(self):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()


def main():
    from tests.fake_gige import FakeCamera

    folder, name, serial, lost = Path(sys.argv[1]), sys.argv[2], sys.argv[3], int(sys.argv[4])
    scene, board = scene_named(name), Board(folder)
    cache = {}

    def pixels(exposure_us, gain_db):
        fake.set_period(max(SHORTEST_S, 1e-6 * exposure_us + GAP_S))
        stop_s = time.monotonic()
        parts = board.seen(stop_s - 1e-6 * exposure_us, stop_s)
        key = len(parts) == 1 and (parts[0][0].tobytes(), exposure_us, gain_db)
        if key and key in cache:
            return cache[key]
        frame = frame_of(scene, parts, 1e-3 * exposure_us, gain_db)
        if key:
            cache.clear()
            cache[key] = frame
        return frame

    fake = FakeCamera(serial, pixels, lost=lost, shape=scene.shape)
    fake.run()


if __name__ == "__main__":
    main()
