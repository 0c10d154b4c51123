"""Cameras of the device table: rows are exposed in turn, and frames arrive as drivers send them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.device_light import Floats, ModelProjector, Taps, taps_of
from fringeworks.devices.clock import SimulatedClock
from fringeworks.devices.protocols import CameraLimits, Grab
from fringeworks.types import CameraSettings, DeviceProblem, Region

HEIGHT, WIDTH = 120, 160
"""Size of all cameras, px."""
AHEAD_S = 0.5
"""Time over which frames are planned ahead, s."""


class Expected(NamedTuple):
    """A frame on its way."""

    arrives_s: float
    number: int
    start_s: float
    settings: CameraSettings
    """Those that it was exposed with."""


def seen_px(kind: str = "bent") -> tuple[Floats, Floats]:
    """Projector columns and rows at the camera's pixels."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    x = 28.0 + 1.17 * u + 0.11 * v + 3.0 * np.sin(u / 23.0 + v / 31.0)
    y = 16.0 + 1.06 * v + 0.03 * u
    if kind == "near":  # a camera that resolves the projector's pixels
        return 60.0 + 0.68 * u + 0.05 * v, 30.0 + 0.69 * v + 0.02 * u
    if kind == "step":
        x = np.where(u > 0.55 * WIDTH, x + 17.0, x)
    return x, y


@dataclass
class ModelCamera:
    """Sees a screen that its projector lights."""

    clock: SimulatedClock
    projector: ModelProjector
    seed: int = 0
    scene: str = "bent"
    blur_px: float = 0.7
    fill: float = 1.0
    fps: float = 51.0
    exposure_ms: float = 1e3 / 60
    bright: float = 0.75
    """White over full scale at the albedo of 1, after one sixtieth of a second at 0 dB."""
    ambient: float = 0.02
    """Light of the room on the same scale."""
    line_us: float = 0.0
    """Time from one row of a sensor of 1 000 rows to the next; 0 for a global shutter."""
    latency_s: float = 0.006
    jitter_s: float = 0.0
    """Of arrivals."""
    trigger_jitter_s: float = 0.0
    lost: float = 0.0
    doubled: float = 0.0
    swapped: float = 0.0
    """Share of frames that arrive after the next one."""
    late: tuple[float, float] = (0.0, 0.0)
    """Share of frames that are late, and by how much, s."""
    first_late: tuple[int, float] = (0, 0.0)
    """Frames after a restart that arrive late, and by how much, s."""
    settles: int = 0
    """Frames after new settings that are still exposed with the old ones."""
    keeps_oldest: bool = False
    """Whether a full queue refuses new frames (Video4Linux) rather than dropping old ones."""
    queue: int = 4
    dated: str = ""
    """``clock`` or ``counter``; frames are dated by their arrival otherwise."""
    clock_ppm: float = 40.0
    automatic: str = ""
    """``gain``, ``exposure`` or ``white balance``: what follows the scene by itself."""
    speed: float = 0.12
    """Share of the way to its aim that the automatic goes in a frame."""
    read: float = 1.1
    shot: float = 0.025
    mains: tuple[float, float] = (0.0, 100.0)
    """Relative depth and frequency of the room's light, Hz."""
    gain_drift: float = 0.0
    """Relative change of the gain in a minute."""
    ambient_drift: float = 0.0
    """Change of the room's light in a minute, on the scale of ``bright``."""
    paint: bool = True
    rounding_ms: float = 0.0
    """Steps of the exposure; 0 for none."""
    own_range: tuple[float, float] = (0.02, 500.0)
    gains_db: tuple[float, float] = (0.0, 18.0)
    name = "model camera"
    pending: list[Expected] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([self.seed, 2])
        self.truth_px, y = seen_px(self.scene)
        self.taps: Taps = taps_of(self.truth_px, y, blur_px=self.blur_px, fill=self.fill)
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        wave = 0.15 * np.sin(u / 11.0 + 0.4) * np.cos(v / 14.0)
        self.albedo = 0.8 + (wave if self.paint else 0.0)
        self.set = CameraSettings(
            self.exposure_ms, 0.0, Region(0, 0, WIDTH, HEIGHT), "Mono8", False
        )
        self.number = 0
        self.factor = 1.0
        self.old: deque[CameraSettings] = deque()
        self.arrived: deque[Expected] = deque()
        self.followed = 0
        self.last: tuple[int, NDArray[np.uint8]] = (-1, np.zeros((HEIGHT, WIDTH), np.uint8))
        self._restart()

    def limits(self) -> CameraLimits:
        return CameraLimits(
            WIDTH, HEIGHT, self.own_range, self.gains_db, ("Mono8",), self._period_s
        )

    @property
    def _period_s(self) -> float:
        return max(1.0 / self.fps, 1e-3 * (self.set.exposure_ms or 0.0) + 3e-4)

    def configure(self, settings: CameraSettings) -> CameraSettings:
        before, new = self.set, settings.over(self.set)
        if self.rounding_ms and new.exposure_ms is not None:
            steps = max(1, round(new.exposure_ms / self.rounding_ms))
            new = CameraSettings(exposure_ms=steps * self.rounding_ms).over(new)
        self.set = new
        if new != before or settings.triggered is not None:
            self.old = deque([before] * self.settles)
            self._restart()
        return self.set

    def _restart(self) -> None:
        self.pending = []
        self.arrived.clear()
        self.next_s = self.clock.now_s() + 2e-3 + self._period_s * float(self.rng.random())
        self.first = self.number

    def _expose(self, start_s: float) -> None:
        number, self.number = self.number, self.number + 1
        used = self.old.popleft() if self.old else self.set
        if self.rng.random() < self.lost:
            return
        start_s += self.trigger_jitter_s * float(self.rng.random())
        readout_s = 1e-3 * self.line_us if self.line_us else 1.5e-3
        arrives = start_s + 1e-3 * (used.exposure_ms or 0.0) + readout_s + self.latency_s
        arrives += self.jitter_s * float(self.rng.random())
        if self.rng.random() < self.late[0]:
            arrives += self.late[1]
        if number - self.first < self.first_late[0]:
            arrives += self.first_late[1]
        if self.rng.random() < self.swapped:
            arrives += 1.2 * self._period_s
        elif self.pending and not self.swapped:
            arrives = max(arrives, self.pending[-1].arrives_s + 2e-4)
        self.pending.append(Expected(arrives, number, start_s, used))
        if self.rng.random() < self.doubled:
            self.pending.append(Expected(arrives + 8e-4, number, start_s, used))
        self.pending.sort()

    def _advance(self) -> None:
        now = self.clock.now_s()
        if not self.set.triggered:
            idle = int((now - self.next_s) / self._period_s) - 40
            if idle > 0:
                self.next_s += idle * self._period_s
                self.number += idle
            while self.next_s <= now + 2.0 * self._period_s:
                self._expose(self.next_s)
                self.next_s += self._period_s
        while self.pending and self.pending[0].arrives_s <= now:
            one = self.pending.pop(0)
            if len(self.arrived) < self.queue:
                self.arrived.append(one)
            elif not self.keeps_oldest:
                self.arrived.popleft()
                self.arrived.append(one)

    def trigger(self) -> float:
        now = self.clock.now_s()
        self._expose(now)
        return now

    def waiting(self) -> int:
        self._advance()
        return len(self.arrived)

    def discard(self) -> None:
        self._advance()
        self.arrived.clear()

    def grab(self, timeout_s: float = 5.0) -> Grab:
        end_s = self.clock.now_s() + timeout_s
        self._advance()
        while not self.arrived:
            due = self.pending[0].arrives_s if self.pending else self.clock.now_s() + 0.01
            if due > end_s:
                self.clock.wait_until(end_s)
                raise DeviceProblem(f"{self.name}: no frame within {timeout_s} s")
            self.clock.wait_until(max(due, self.clock.now_s() + 1e-6))
            self._advance()
        one = self.arrived.popleft()
        if self.last[0] != one.number:
            self.last = one.number, self._pixels(one)
        own = 77.0 + one.start_s * (1.0 + 1e-6 * self.clock_ppm) if self.dated == "clock" else None
        number = one.number if self.dated else None
        return Grab(self.last[1], max(one.arrives_s, 0.0), own, number)

    def _pixels(self, one: Expected) -> NDArray[np.uint8]:
        exposure_s = 1e-3 * (one.settings.exposure_ms or 0.0)
        rows = np.arange(HEIGHT) / HEIGHT * 1e-3 * self.line_us
        from_s = one.start_s + rows
        until_s = from_s + exposure_s * (self.factor if self.automatic == "exposure" else 1.0)
        light = self.projector.light(from_s, until_s, self.taps)
        depth, hertz = self.mains
        turn = 2.0 * np.pi * hertz
        swing = depth * (np.sin(turn * until_s) - np.sin(turn * from_s)) / turn
        minutes = one.start_s / 60.0
        room = (self.ambient + self.ambient_drift * minutes) * (until_s - from_s + swing)
        sent = 60.0 * (self.bright * light + room[:, None]) * self.albedo
        gain = 10.0 ** ((one.settings.gain_db or 0.0) / 20.0) * (1.0 + self.gain_drift * minutes)
        if self.automatic in ("gain", "white balance"):
            gain *= self.factor
        counts = 255.0 * gain * sent
        sigma = np.sqrt((self.read * gain) ** 2 + self.shot * gain * np.maximum(counts, 0.0))
        seen = counts + sigma * self.rng.standard_normal(counts.shape)
        pixels = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
        if self.automatic:
            self._follow(float(pixels.mean()), one.number)
        return pixels

    def _follow(self, mean: float, number: int) -> None:
        """Go a part of the way to a mean of 100 counts in every frame, grabbed or not."""
        wanted = self.factor * 100.0 / max(mean, 4.0)
        most = 1.12 if self.automatic == "white balance" else 6.0
        frames, self.followed = max(number - self.followed, 1), number
        part = 1.0 - (1.0 - self.speed) ** frames
        self.factor *= float(np.clip(wanted / self.factor, 0.25, 4.0)) ** part
        self.factor = float(np.clip(self.factor, 1.0 / most, most))

    def close(self) -> None:
        pass

    def __enter__(self) -> ModelCamera:
        return self

    def __exit__(self, *error: object) -> None:
        pass
