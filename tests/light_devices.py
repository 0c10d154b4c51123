"""Projectors and cameras as data sheets describe them, on a clock that jumps.

They share nothing with the package's virtual devices. A projector's light is a function of time and
grey level: DMD bit planes behind a colour wheel, strobed panels, liquid crystals that settle at a
speed of their own between any two greys, or temporal dithering. A camera integrates that light
over each row's exposure, and delivers its frames late, twice, or not at all.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from fringeworks.devices.clock import SimulatedClock
from fringeworks.devices.protocols import CameraLimits, Grab
from fringeworks.types import CameraSettings, DeviceProblem, Region

COLUMNS, ROWS = 192, 128
PHASES = 3840
"""Steps of a table of light over its period: 4.3 µs at 60 Hz, a bit plane's shortest time."""


def steady(gamma=1.0):
    """LED or laser light that a picture holds: light of every grey level over a refresh."""
    light = (np.arange(256) / 255.0) ** gamma
    return np.repeat(light[:, None], PHASES, 1), 1


def strobed(on=0.4, begin=0.3, pulses=1, gamma=1.0):
    """Black frames between the pictures, or a pulsed backlight: light during part of a refresh."""
    phase = (np.arange(PHASES) * pulses / PHASES) % 1.0
    lit = (phase >= begin) & (phase < begin + on)
    light = (np.arange(256) / 255.0) ** gamma
    return light[:, None] * lit / lit.mean(), 1


def bit_planes(segments=((0.36, 1.0),), turns=1, gap=0.0, gamma=1.0, split=8):
    """A DMD: greys are binary planes in time, behind the segments of a wheel with gaps between.

    Segments are (share of a turn, transmission for a mono camera). The long planes are split into
    parts that are spread over the segment.
    """
    shares = np.array([s for s, _ in segments]) / sum(s for s, _ in segments)
    greys = np.rint(255 * (np.arange(256) / 255.0) ** gamma).astype(int)
    order = _spread(split)
    light = np.zeros((256, PHASES))
    at = np.arange(PHASES) * turns % PHASES / PHASES
    begin = 0.0
    for share, (_, passes) in zip(shares, segments, strict=True):
        inside = (at >= begin) & (at < begin + share * (1.0 - gap))
        place = (at[inside] - begin) / (share * (1.0 - gap))
        plane = order[np.minimum((place * len(order)).astype(int), len(order) - 1)]
        on = (greys[:, None] >> plane[None]) & 1
        light[:, inside] = passes * on
        begin += share
    return light / light[255].mean(), 1


def _spread(split):
    """Bit planes of one segment in time, 255 slots: bits 7 to 5 in parts, the others at once."""
    parts = []
    for bit in range(8):
        slots = 2**bit
        count = max(1, min(split, slots // 16))
        for k in range(count):
            parts.append(((k + 0.5) / count + 0.013 * bit, bit, slots // count))
    parts.sort()
    return np.array([bit for _, bit, n in parts for _ in range(n)])


def dithered(bits=6):
    """A panel of six bits that alternates between two of its levels over four refreshes."""
    step = 2 ** (8 - bits)
    low = np.arange(256) // step
    part = np.arange(256) % step
    turn = np.arange(PHASES) * step // PHASES
    order = np.array([0, 2, 1, 3])[turn % 4] if step == 4 else turn
    light = np.minimum(low[:, None] + (part[:, None] > order[None]), 2**bits - 1)
    return light / light[255].mean(), step


@dataclass
class Segment:
    """Light of one picture, from its time on."""

    from_s: np.ndarray
    """(rows, 1): a row changes at once."""
    grey: np.ndarray
    start: np.ndarray | None = None
    tau_s: np.ndarray | None = None
    asymptote: np.ndarray | None = None


@dataclass
class LightProjector:
    """Shows pictures at its refreshes."""

    clock: SimulatedClock
    table: tuple = field(default_factory=steady)
    refresh_hz: float = 60.0
    delay_s: float = 0.03
    jitter_refreshes: int = 0
    crystal_s: float = 0.0
    """Time constant of a liquid crystal; 0 for none. Steps between near greys are three times as
    slow (response tables of panel makers: grey-to-grey against black-to-white)."""
    overdrive: float = 0.0
    raster: bool = False
    """Whether rows change one after the other over a refresh."""
    tell_refresh: bool = True
    warm_up: float = 0.0
    """Share of the light that is lost over the first minute."""
    seed: int = 0
    size_px = (COLUMNS, ROWS)
    bits = 8
    name = "light projector"

    def __post_init__(self):
        self.rng = np.random.default_rng(self.seed)
        light, self.turns = self.table
        mean = np.concatenate((np.zeros((256, 1)), np.cumsum(light, axis=1)), axis=1) / PHASES
        self.cumulative = mean
        self.parity = np.zeros((ROWS, 1))
        if self.turns > 1:
            self.parity = np.add.outer(np.arange(ROWS), np.arange(COLUMNS)) % 2
        black = np.zeros((ROWS, COLUMNS), int)
        light0 = np.zeros((ROWS, COLUMNS))
        one = np.ones((ROWS, COLUMNS))
        since = np.full((ROWS, 1), -1e9)
        self.shown = deque([Segment(since, black, light0, one * 1e-3, light0)], maxlen=240)
        self.pending = deque()

    @property
    def refresh_s(self):
        return 1.0 / self.refresh_hz if self.tell_refresh else None

    def show(self, picture):
        period = 1.0 / self.refresh_hz
        handed = (np.floor(self.clock.now_s() / period) + 1) * period
        late = self.rng.integers(0, self.jitter_refreshes + 1) * period
        rows = np.arange(ROWS)[:, None] / ROWS * period * self.raster
        from_s = handed + self.delay_s + late + rows
        from_s = np.maximum(from_s, self.shown[-1].from_s)
        grey = np.array(picture, int)
        if not self.crystal_s:
            self.shown.append(Segment(from_s, grey))
        else:
            self._settle(from_s, grey, period)
        self.clock.wait_until(handed)
        return float(handed)

    def _settle(self, from_s, grey, period):
        last = self.shown[-1]
        now = last.asymptote + (last.start - last.asymptote) * np.exp(
            -np.maximum(from_s - last.from_s, 0.0) / last.tau_s
        )
        target = grey / 255.0
        tau = self.crystal_s * (1.0 + 2.0 * (1.0 - np.abs(target - now)))
        if self.overdrive:
            driven = np.clip(target + self.overdrive * (target - last.grey / 255.0), 0.0, 1.0)
            self.shown.append(Segment(from_s, grey, now, tau, driven))
            now = driven + (now - driven) * np.exp(-period / tau)
            from_s = from_s + period
        self.shown.append(Segment(from_s, grey, now, tau, target))

    def light(self, from_s, until_s, seen):
        """Integral of the light of projector pixels over exposures, s.

        Times are those of rows, (rows, 1); ``seen`` is a rectangle of pixels, as two slices.
        """
        total = np.zeros(self.shown[0].grey[seen].shape)
        first_s, last_s = float(from_s.min()), float(until_s.max())
        ends = [s.from_s for s in list(self.shown)[1:]] + [np.full((ROWS, 1), 1e9)]
        for one, end in zip(self.shown, ends, strict=True):
            if end[-1, 0] <= first_s or one.from_s[0, 0] >= last_s:
                continue
            start = np.maximum(from_s, one.from_s[seen[0]])
            stop = np.minimum(until_s, end[seen[0]])
            open_ = stop > start
            if not open_.any():
                continue
            if self.crystal_s:
                t0, tau = one.from_s[seen[0]], one.tau_s[seen]
                goal, first = one.asymptote[seen], one.start[seen]
                slow = tau * (np.exp(-(start - t0) / tau) - np.exp(-(stop - t0) / tau))
                part = goal * (stop - start) + (first - goal) * slow
            else:
                grey = one.grey[seen]
                shift = self.parity[seen if self.turns > 1 else seen[0]]
                part = self._sum(stop, grey, shift) - self._sum(start, grey, shift)
            total += np.where(open_, part, 0.0)
        if self.warm_up:
            total = total * (1.0 - self.warm_up * (1.0 - np.exp(-np.mean(from_s) / 20.0)))
        return total

    def _sum(self, time_s, grey, shift):
        """Light from time 0 until then."""
        period = self.turns / self.refresh_hz
        turns = time_s / period + shift * 0.5
        whole = np.floor(turns)
        place = (turns - whole) * PHASES
        at = np.minimum(place.astype(int), PHASES - 1)
        table, row = self.cumulative.ravel(), grey * (PHASES + 1)
        below, above = table.take(row + at), table.take(row + at + 1)
        return period * (whole * table.take(row + PHASES) + below + (above - below) * (place - at))

    def close(self):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass


@dataclass
class LightCamera:
    """Films the projector's pixels one to one, from a corner of the picture."""

    clock: SimulatedClock
    projector: LightProjector
    fps: float = 60.0
    exposure_ms: float = 16.667
    reference_ms: float = 16.667
    line_s: float = 0.0
    """Time from row to row of a rolling shutter, s; 0 for a global one."""
    latency_s: float = 0.02
    trigger_jitter_s: float = 0.0
    late: tuple[float, float] = (0.0, 0.0)
    """Probability that a frame arrives late, and by how much, s."""
    starts_late: tuple[int, float] = (0, 0.0)
    """Number of frames after every restart that arrive late, and by how much, s."""
    lost: float = 0.0
    doubled: float = 0.0
    dated: str = "arrival"
    """``arrival``, ``device`` (a clock of its own) or ``counter``."""
    noise: float = 1.0
    shot: float = 0.02
    white: float = 0.7
    ambient: float = 0.03
    gain_drift: float = 0.0
    """Relative change of the gain per second."""
    mains: float = 0.0
    """Depth of the flicker of the ambient light, 100 Hz."""
    albedo: object = None
    kept: int = 4
    seed: int = 0
    name = "light camera"
    shape = (96, 144)

    def __post_init__(self):
        self.rng = np.random.default_rng(self.seed + 1)
        self.seen = np.s_[10 : 10 + self.shape[0], 20 : 20 + self.shape[1]]
        self.reflects = np.ones(self.shape) if self.albedo is None else self.albedo
        self.settings = CameraSettings(
            self.exposure_ms, 0.0, Region(0, 0, *self.shape[::-1]), "Mono8", False
        )
        self.number = 0
        self._restart()

    def limits(self):
        return CameraLimits(
            *self.shape[::-1], (0.02, 1000.0), (0.0, 24.0), ("Mono8",), self._period
        )

    @property
    def _exposure(self):
        return 1e-3 * self.settings.exposure_ms

    @property
    def _period(self):
        return max(1.0 / self.fps, self._exposure + 2e-4)

    def configure(self, settings):
        new = settings.over(self.settings)
        changed = new != self.settings or settings.triggered is not None
        self.settings = new
        if changed:
            self._restart()
        return self.settings

    def _restart(self):
        self.queue = deque()
        self.next_s = self.clock.now_s() + 1e-3 * (1.0 + 15.0 * self.rng.random())
        self.started = self.number
        self.arrived_s = self.clock.now_s()
        self.last = None

    def _expect(self, start_s):
        n, self.number = self.number, self.number + 1
        if self.rng.random() < self.lost:
            return
        start_s += self.trigger_jitter_s * self.rng.random()
        readout = self.line_s * self.shape[0] if self.line_s else 2e-3
        arrives = start_s + self._exposure + readout + self.latency_s
        if self.rng.random() < self.late[0]:
            arrives += self.late[1]
        if n - self.started < self.starts_late[0]:
            arrives += self.starts_late[1]
        self.arrived_s = max(arrives, self.arrived_s + 1e-4)
        self.queue.append((n, start_s, self.arrived_s))
        if self.rng.random() < self.doubled:
            self.arrived_s += 1e-3
            self.queue.append((n, start_s, self.arrived_s))

    def _advance(self):
        now = self.clock.now_s()
        if not self.settings.triggered:
            skip = int((now - self.next_s) / self._period) - 60
            if skip > 0:
                self.next_s += skip * self._period
                self.number += skip
            while self.next_s <= now + 0.5:
                self._expect(self.next_s)
                self.next_s += self._period
                if self.queue and self.queue[-1][2] > now:
                    break
        while sum(q[2] <= now for q in self.queue) > self.kept:
            self.queue.popleft()

    def trigger(self):
        now = self.clock.now_s()
        self._expect(now)
        return now

    def waiting(self):
        self._advance()
        now = self.clock.now_s()
        return sum(q[2] <= now for q in self.queue)

    def discard(self):
        for _ in range(self.waiting()):
            self.queue.popleft()

    def grab(self, timeout_s=5.0):
        self._advance()
        tries = 0
        while not self.queue and tries < 200:
            tries += 1
            self.clock.wait_until(self.clock.now_s() + timeout_s / 200)
            self._advance()
        if not self.queue:
            raise DeviceProblem(f"light camera: no frame within {timeout_s} s")
        n, start_s, arrives = self.queue.popleft()
        self.clock.wait_until(arrives)
        device = 1234.5 + start_s * (1.0 + 5e-5) if self.dated == "device" else None
        count = n if self.dated in ("counter", "device") else None
        if self.last is not None and self.last[0] == n:
            pixels = self.last[1]
        else:
            pixels = self._pixels(start_s)
        self.last = (n, pixels)
        return Grab(pixels, arrives, device, count)

    def _pixels(self, start_s):
        from_s = start_s + self.line_s * np.arange(self.shape[0])[:, None]
        until_s = from_s + self._exposure
        light = self.projector.light(from_s, until_s, self.seen)
        turn = 2.0 * np.pi * 100.0
        room = self._exposure + self.mains * (np.sin(turn * until_s) - np.sin(turn * from_s)) / turn
        sent = (self.white * light + self.ambient * room) * self.reflects * 1e3 / self.reference_ms
        gain = 10.0 ** ((self.settings.gain_db or 0.0) / 20.0) * (1.0 + self.gain_drift * start_s)
        counts = 255.0 * sent * gain
        sigma = np.sqrt((self.noise * gain) ** 2 + self.shot * gain * np.maximum(counts, 0.0))
        counts = counts + sigma * self.rng.standard_normal(self.shape)
        return np.clip(np.rint(counts), 0, 255).astype(np.uint8)

    def close(self):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass


def devices(projector=None, camera=None, *, seed=0):
    """A projector and a camera on one clock; both arguments are their options."""
    clock = SimulatedClock()
    clock.wait_until(10.0 + 0.37 * seed)
    shows = LightProjector(clock, seed=seed, **(projector or {}))
    return shows, LightCamera(clock, shows, seed=seed, **(camera or {}))
