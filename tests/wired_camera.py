"""A camera on a projector's trigger output, for tests: it exposes what the emulator shows."""

from __future__ import annotations

import zlib

import numpy as np

from fringeworks.devices.clock import SimulatedClock
from fringeworks.devices.protocols import CameraLimits, Closing, Grab
from fringeworks.types import CameraSettings, DeviceProblem, Region


class WiredCamera(Closing):
    """A camera that gets a pulse for every picture of a controller; some pulses may be lost.

    ``missed`` holds the numbers of pulses, counted over all sequences, that expose no frame;
    ``torn`` those whose frame arrives incomplete, ``dropped`` those whose frame never arrives
    although the camera counts it.
    """

    name = "wired"

    def __init__(self, scene, controller, *, missed=(), torn=(), dropped=(), clock=None):
        self.scene, self.clock = scene, clock or SimulatedClock()
        self.missed, self.torn, self.dropped = set(missed), set(torn), set(dropped)
        self.pulses, self.number, self.waits, self.gone = 0, 0, False, False
        self.stamps = True
        self.every = 1
        """The camera exposes for every so many-th pulse: 2 for one that is too slow."""
        self.extra = 0
        self._coming = []
        self.settings = CameraSettings(10.0, 0.0, Region(0, 0, *scene.shape[::-1]), "Mono8", False)
        controller.on_play = self.expose

    def expose(self, pictures, entries, _):
        """Take a frame of each picture, at the times that the table of the sequence gives."""
        at_s = self.clock.now_s()
        for n, (picture, entry) in enumerate(zip(pictures, entries, strict=True)):
            pulse = self.pulses
            self.pulses += 1
            if self.waits and pulse not in self.missed and n % self.every == 0:
                self._frame(picture, entry, at_s, pulse)
            at_s += 1e-6 * (entry["exposure"] + entry["dark"])
        for _ in range(self.extra):
            self._frame(pictures[-1], entries[-1], at_s, self.pulses)

    def _frame(self, picture, entry, at_s, pulse):
        number, self.number = self.number, self.number + 1
        if pulse in self.dropped:
            return
        light = self.scene.ambient + self.scene.projected(picture / (2.0 ** entry["depth"] - 1))
        # The noise is that of the picture, so that two captures of it are equal.
        noise = np.random.default_rng(zlib.crc32(picture.tobytes())).standard_normal(light.shape)
        pixels = np.clip(np.rint(255 * light + noise), 0, 255).astype(np.uint8)
        arrival_s = at_s + 1e-6 * entry["exposure"] + 0.005
        stamp = 1000.0 + at_s * (1 + 1e-4) if self.stamps else None
        self._coming.append(Grab(pixels, arrival_s, stamp, number, pulse not in self.torn))

    def _there(self):
        if self.gone:
            raise DeviceProblem("wired: it was unplugged")

    def limits(self):
        self._there()
        return CameraLimits(*self.scene.shape[::-1])

    def configure(self, settings):
        self._there()
        self.settings = settings.over(self.settings)
        if settings.triggered is not None:
            self.waits = False
        return self.settings

    def wait_for_line(self):
        self._there()
        self.waits = True

    def waiting(self):
        return sum(grab.host_s <= self.clock.now_s() for grab in self._coming)

    def grab(self, timeout_s=5.0):
        del timeout_s
        self._there()
        if not self._coming:
            raise DeviceProblem("wired: no frame")
        grab = self._coming.pop(0)
        self.clock.wait_until(grab.host_s)
        return grab

    def discard(self):
        del self._coming[: self.waiting()]
