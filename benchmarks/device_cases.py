"""The projectors and cameras of the device table, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from benchmarks.device_camera import ModelCamera
from benchmarks.device_light import (
    Crystal,
    ModelProjector,
    dithered,
    mirrors,
    pulsed,
    wheel,
)
from fringeworks.devices.clock import SimulatedClock

RGBW = [(0.3, 0.55), (0.25, 1.0), (0.2, 0.3), (0.25, 1.8)]
"""Shares of a turn, and light for a grey camera, of a wheel with a white segment."""
RGBRGB = [(1 / 6, 0.5), (1 / 6, 1.0), (1 / 6, 0.3)] * 2
"""A wheel with six segments."""


@dataclass(frozen=True)
class Case:
    """A projector and a camera."""

    projector: dict[str, Any] = field(default_factory=dict)
    camera: dict[str, Any] = field(default_factory=dict)
    clean: bool = True
    """Whether the devices keep all that a scan needs: nothing may be refused or found then."""
    given_ms: float | None = None
    """Exposure that the user asks for; the set-up chooses one where there is none."""
    crystal: bool = False
    triggered: bool = False
    """Whether the fast scan triggers its frames."""
    hdr: int = 1

    def open(self, seed: int) -> tuple[ModelProjector, ModelCamera]:
        """The devices on a clock of their own."""
        clock = SimulatedClock()
        clock.wait_until(5.0 + 0.619 * seed)
        kind: Callable[..., ModelProjector] = Crystal if self.crystal else ModelProjector
        projector = kind(clock, seed=seed, **self.projector)
        return projector, ModelCamera(clock, projector, seed=seed, **self.camera)


WHOLE_MS = 1e3 / 60

STEADY = {
    "LED": Case(),
    "LED, short": Case({}, {"bright": 6.0, "ambient": 0.1}, given_ms=2.2),
    "LED, bright": Case({}, {"bright": 2.5, "fps": 60.0}),
    "LED, lit room": Case({}, {"ambient": 0.1, "bright": 0.7}),
    "laser, rolling 5 us": Case({}, {"line_us": 5.0, "fps": 60.0}),
    "laser, rolling 12 us": Case({}, {"line_us": 12.0, "fps": 43.0}),
    "laser, rolling 30 us": Case({}, {"line_us": 30.0, "fps": 29.0, "bright": 0.4}),
    "trigger jitter": Case({}, {"trigger_jitter_s": 4e-4}, triggered=True),
    "projector late by 0 to 2": Case({"extra_refreshes": 2, "refresh_hz": 120.0}, {"fps": 80.0}),
    "projector late by 0 to 1, 60 Hz": Case({"extra_refreshes": 1}, {"fps": 59.94}),
    "refresh unknown": Case({"tells": False, "refresh_hz": 59.94}, {"fps": 30.0}),
    "liquid crystal": Case({"scanned": True}, {}, crystal=True),
    "liquid crystal, overdriven": Case(
        {"scanned": True, "rise_s": 0.003, "fall_s": 0.006, "overdrive": 0.25}, {}, crystal=True
    ),
    "liquid crystal, slow": Case(
        {"scanned": True, "rise_s": 0.006, "fall_s": 0.012}, {"line_us": 15.0}, crystal=True
    ),
    "wheel 120 Hz, whole": Case({"emits": wheel(RGBW, gap=0.06)}, {}, given_ms=WHOLE_MS),
    "wheel 180 Hz, whole": Case(
        {"emits": wheel(RGBRGB, per_refresh=3.0)}, {"line_us": 12.0}, given_ms=WHOLE_MS
    ),
    "mirrors, whole": Case({"emits": mirrors()}, {"fps": 55.0}, given_ms=WHOLE_MS),
    "mirrors 120 Hz, three": Case(
        {"emits": mirrors(dark=0.15), "refresh_hz": 120.0}, {"bright": 0.5}, given_ms=25.0
    ),
    "black frames, whole": Case(
        {"emits": pulsed([(0.0, 0.5)], refreshes=2.0), "refresh_hz": 120.0}, given_ms=WHOLE_MS
    ),
    "fields that hold": Case({"interlaced": "hold"}, {"fps": 47.0}),
    "drift of gain": Case({}, {"gain_drift": 0.1}),
    "drift of room": Case({}, {"ambient_drift": 0.02, "ambient": 0.05}),
    "projector warms up": Case({"warms_up": -0.1}, {}),
    "three exposures": Case({}, {"bright": 0.9}, hdr=3),
}
"""Devices whose light and frames are as they should be, or drift slowly."""

PULSED = {
    "wheel 240 Hz, 5 ms": Case(
        {"emits": wheel(RGBW, per_refresh=4.0)}, {"bright": 2.0}, False, given_ms=5.0
    ),
    "wheel 120 Hz, 10 ms": Case(
        {"emits": wheel(RGBRGB, gap=0.08)}, {"bright": 1.2, "line_us": 8.0}, False, given_ms=10.0
    ),
    "wheel 120 Hz, free": Case({"emits": wheel(RGBW)}, {"bright": 1.9}, False),
    "mirrors, 2 ms": Case({"emits": mirrors()}, {"bright": 6.0}, False, given_ms=2.0),
    "mirrors, 9 ms": Case({"emits": mirrors()}, {"bright": 1.3, "fps": 70.0}, False, given_ms=9.0),
    "mirrors, free": Case({"emits": mirrors(dark=0.2)}, {"bright": 2.6}, False),
    "dithered 6 bits": Case({"emits": dithered(6, 4)}, {}, False),
    "dithered 7 bits": Case({"emits": dithered(7, 2)}, {"line_us": 12.0}, False),
    "black frames, 4 ms": Case(
        {"emits": pulsed([(0.5, 1.0)])}, {"bright": 1.8}, False, given_ms=4.0
    ),
    "black frames 120 Hz, free": Case(
        {"emits": pulsed([(0.0, 0.5)], refreshes=2.0), "refresh_hz": 120.0}, {"bright": 1.4}, False
    ),
    "backlight 240 Hz, 3 ms": Case(
        {"emits": pulsed([(k / 4, k / 4 + 0.08) for k in range(4)])},
        {"bright": 3.0},
        False,
        given_ms=3.0,
    ),
    "fields with dark rows": Case({"interlaced": "dark"}, {"bright": 0.6}, False),
    "lamp hunts": Case({"hunts": (0.03, 7.0)}, {}, False),
    "lamp of 100 Hz": Case({"hunts": (0.1, 100.0)}, {"fps": 37.0, "bright": 1.0}, False),
}
"""Devices whose light changes within a picture."""

DELIVERED = {
    "settles after 3 frames": Case({}, {"settles": 3}),
    "exposure in steps": Case({}, {"rounding_ms": 0.1}),
    "driver keeps the oldest": Case({}, {"keeps_oldest": True, "latency_s": 0.06}),
    "slow link": Case({}, {"latency_s": 0.15, "jitter_s": 0.01, "dated": "clock"}),
    "jitter 15 ms": Case({}, {"jitter_s": 0.015}),
    "lost 4 %, counter": Case({}, {"lost": 0.04, "dated": "counter"}),
    "lost 8 %": Case({}, {"lost": 0.08}),
    "doubled 8 %": Case({}, {"doubled": 0.08}),
    "swapped 5 %": Case({}, {"swapped": 0.05}, False),
    "swapped 5 %, counter": Case({}, {"swapped": 0.05, "dated": "counter"}, False),
    "late 4 % by 60 ms": Case({}, {"late": (0.04, 0.06)}, False),
    "first 15 late by 80 ms": Case({}, {"first_late": (15, 0.08)}, False),
    "first 30 late by 120 ms, clock": Case(
        {}, {"first_late": (30, 0.12), "dated": "clock", "line_us": 10.0}, False
    ),
    "automatic gain": Case({}, {"automatic": "gain"}, False),
    "automatic exposure, slow": Case({}, {"automatic": "exposure", "speed": 0.03}, False),
    "automatic white balance": Case({}, {"automatic": "white balance", "speed": 0.06}, False),
    "mains 100 Hz": Case(
        {}, {"mains": (0.8, 100.0), "ambient": 0.15, "bright": 1.2, "fps": 43.0}, False
    ),
    "mains 120 Hz, rolling": Case(
        {}, {"mains": (0.9, 120.0), "ambient": 0.1, "line_us": 15.0, "bright": 1.6}, False
    ),
    "grids": Case({}, {"scene": "near", "blur_px": 0.3, "fill": 0.9}, False),
    "grids, blurred": Case({}, {"scene": "near", "blur_px": 0.45}, False),
    "step": Case({}, {"scene": "step"}),
    "exposures, saturating": Case({}, {"bright": 1.5}, False, hdr=3),
}
"""Cameras as drivers deliver their frames, and scenes."""

CASES = STEADY | PULSED | DELIVERED
