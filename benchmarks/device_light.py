"""Projectors of the device table, as data sheets describe their light in time.

They share nothing with the virtual devices of the package and of the tests. The light of a pixel is
a sum of periodic parts: bit planes of a micromirror, segments of a colour wheel, sub-frames of a
panel that dithers, pulses of a backlight. A picture sets the weights of the parts. Panels that
settle are ``Crystal`` projectors.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.clock import SimulatedClock

Floats = NDArray[np.float64]
Picture = NDArray[Any]

COLUMNS, ROWS = 256, 160
"""Size of all projectors, px."""
GREYS = np.arange(256)
SHARES = GREYS / 255.0
SETTLED = 25.0
"""Time constants after which a liquid crystal is taken to be steady: 4e-10 of the step is left."""
HISTORY = 600
"""Pictures that a projector remembers, because frames of a camera may come late."""
LEADING_S = -1e9
"""Time of the first, black picture, s: before everything."""


@dataclass(frozen=True)
class Light:
    """Periodic light: Σ weight(code, part) · part(time), with white at a mean of 1."""

    edges: Floats
    """(n + 1,), times within a period from 0 to 1."""
    parts: Floats
    """(p, n), light of every part between the edges."""
    weights: Floats
    """(256, p)."""
    refreshes: float = 1.0
    """Refresh periods of one period of the light."""
    classes: int = 1
    """Pixels whose light is ahead by 0, 1/classes, … of a period, in a 2 × 2 pattern."""

    def doses(self, time_s: Floats, refresh_s: float) -> Floats:
        """Light of every part from time 0 until then, s: shape of ``time_s`` and (p,)."""
        period = self.refreshes * refresh_s
        turns = time_s / period
        whole = np.floor(turns)
        sums = np.concatenate(
            (np.zeros((len(self.parts), 1)), np.cumsum(self.parts * np.diff(self.edges), axis=1)), 1
        )
        within = np.stack([np.interp(turns - whole, self.edges, one) for one in sums], -1)
        return period * (whole[..., None] * sums[:, -1] + within)


def normalised(edges: Floats, parts: Floats, weights: Floats, **more: Any) -> Light:
    """The light with white at a mean of 1."""
    white = float((weights[255] @ parts) @ np.diff(edges))
    return Light(edges, parts, weights / white, **more)


def continuous(gamma: float = 1.0) -> Light:
    """A laser or LED behind a panel without memory: light of a grey does not change."""
    return normalised(np.array([0.0, 1.0]), np.ones((1, 1)), (SHARES**gamma)[:, None])


def pulsed(windows: list[tuple[float, float]], *, refreshes: float = 1.0) -> Light:
    """A backlight or shutter that is open in windows (from, until) of a period."""
    edges = np.unique([0.0, 1.0, *(e for window in windows for e in window)])
    middle = 0.5 * (edges[1:] + edges[:-1])
    lit = sum((middle > a) & (middle < b) for a, b in windows)
    return normalised(edges, np.asarray(lit, float)[None], SHARES[:, None], refreshes=refreshes)


def wheel(
    segments: list[tuple[float, float]],
    *,
    per_refresh: float = 2.0,
    gap: float = 0.05,
    planes: int = 8,
) -> Light:
    """A micromirror behind a wheel of (share of a turn, light for a grey camera) segments.

    Every segment plays all bit planes, the long ones in parts; the mirrors are off while a spoke
    between two segments is in the beam.
    """
    spans: list[tuple[float, float, int, float]] = []
    begin = 0.0
    total = sum(share for share, _ in segments)
    for share, passes in segments:
        length = share / total
        spans += _planes(begin + 0.5 * gap * length, (1.0 - gap) * length, passes, planes)
        begin += length
    return _from_spans(spans, 1.0 / per_refresh)


def mirrors(*, planes: int = 8, dark: float = 0.0, refreshes: float = 1.0) -> Light:
    """A micromirror with one LED: bit planes through a refresh, dark for a share at its end."""
    return _from_spans(_planes(0.0, 1.0 - dark, 1.0, planes), refreshes)


def _planes(
    begin: float, length: float, passes: float, planes: int
) -> list[tuple[float, float, int, float]]:
    """Spans (from, until, bit, light): the highest bit in four parts, the next in two."""
    order = [7, 5, 6, 3, 7, 1, 4, 6, 7, 0, 2, 5, 6, 7] if planes == 8 else list(range(planes))
    counts = {bit: order.count(bit) for bit in order}
    sizes = [2.0**bit / counts[bit] for bit in order]
    ends = begin + length * np.cumsum(sizes) / sum(sizes)
    starts = np.concatenate(([begin], ends[:-1]))
    return [(a, b, bit, passes) for a, b, bit in zip(starts, ends, order, strict=True)]


def _from_spans(spans: list[tuple[float, float, int, float]], refreshes: float) -> Light:
    edges = np.unique([0.0, 1.0, *(e for span in spans for e in span[:2])])
    middle = 0.5 * (edges[1:] + edges[:-1])
    parts = np.zeros((8, len(middle)))
    for first, last, bit, passes in spans:
        parts[bit, (middle > first) & (middle < last)] += passes
    bits = ((GREYS[:, None] >> np.arange(8)) & 1).astype(float)
    return normalised(edges, parts, bits, refreshes=refreshes)


def dithered(bits: int = 6, frames: int = 4, *, classes: int = 4) -> Light:
    """A panel of few bits that shows the levels between in turns, spread over 2 × 2 pixels."""
    step = 2 ** (8 - bits)
    low = GREYS // step
    order = np.argsort(np.argsort((np.arange(frames) * 0.618) % 1.0)) * step / frames
    level = np.minimum(low[:, None] + (GREYS[:, None] % step > order), 2**bits - 1)
    return normalised(
        np.linspace(0.0, 1.0, frames + 1),
        np.eye(frames),
        level.astype(float),
        refreshes=float(frames),
        classes=classes,
    )


@dataclass
class Shown:
    """A picture, from its time on, until the next one is there."""

    from_s: Floats
    """(rows,)."""
    codes: Picture
    start: Floats | None = None
    target: Floats | None = None
    tau_s: Floats | None = None
    seen: Floats | None = None
    """(parts, h, w), what a camera sees of the parts of the light; kept once it was needed."""


@dataclass
class ModelProjector:
    """Shows pictures at its refreshes."""

    clock: SimulatedClock
    seed: int = 0
    emits: Light = field(default_factory=continuous)
    refresh_hz: float = 60.0
    latency_s: float = 0.021
    """From the refresh at which a picture is handed over to its light."""
    extra_refreshes: int = 0
    """Most refreshes by which a picture comes late, at random."""
    scanned: bool = False
    """Whether rows change one after the other over a refresh."""
    interlaced: str = ""
    """``hold``: fields update every other row; ``dark``: rows of the other field are dark."""
    warms_up: float = 0.0
    """Relative change of the light over the first five minutes."""
    hunts: tuple[float, float] = (0.0, 0.0)
    """Relative amplitude and frequency, Hz, of a lamp's flicker."""
    tells: bool = True
    """Whether the refresh period is known to the program."""
    name = "model projector"
    size_px = (COLUMNS, ROWS)
    bits = 8

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng([self.seed, 1])
        black = np.zeros((ROWS, COLUMNS), np.uint8)
        first = Shown(np.full(ROWS, LEADING_S), black)
        self._begin(first)
        self.shown: deque[Shown] = deque([first], maxlen=HISTORY)

    @property
    def refresh_s(self) -> float | None:
        return 1.0 / self.refresh_hz if self.tells else None

    def show(self, picture: Picture) -> float:
        period = 1.0 / self.refresh_hz
        number = np.floor(self.clock.now_s() / period) + 1
        handed = float(number * period)
        late = int(self.rng.integers(0, self.extra_refreshes + 1))
        rows = np.arange(ROWS)
        from_s = handed + self.latency_s + late * period + self.scanned * rows / ROWS * period
        if self.interlaced:
            from_s = from_s + period * ((rows + int(number) + late) % 2)
        from_s = np.maximum(from_s, self.shown[-1].from_s)
        self._append(from_s, np.asarray(picture))
        self.clock.wait_until(handed)
        return handed

    def _begin(self, first: Shown) -> None:
        """Complete the first picture."""

    def _append(self, from_s: Floats, codes: Picture) -> None:
        self.shown.append(Shown(from_s, codes))

    def light(self, from_s: Floats, until_s: Floats, taps: Taps) -> Floats:
        """Integral of the light at camera pixels over the exposures of their rows, s."""
        total = np.zeros(taps.shape)
        end = np.full(len(from_s), np.inf)
        for one in reversed(self.shown):
            start = one.from_s[taps.row_at]
            first = np.maximum(from_s, start)
            last = np.minimum(until_s, end)
            if (last > first).any():
                total += self._dose(one, first, np.maximum(last, first), taps)
            if (start <= from_s).all():
                break
            end = start
        middle = 0.5 * (from_s + until_s)
        factor = 1.0 + self.warms_up * (1.0 - np.exp(-middle / 100.0))
        depth, hertz = self.hunts
        if depth:
            turn = 2.0 * np.pi * hertz
            swing = (np.cos(turn * from_s) - np.cos(turn * until_s)) / turn
            factor = factor * (1.0 + depth * swing / (until_s - from_s))
        return total * factor[:, None]

    def _dose(self, one: Shown, first: Floats, last: Floats, taps: Taps) -> Floats:
        if self.interlaced == "dark":
            return self._fields(one, first, last, taps)
        period = 1.0 / self.refresh_hz
        emits = self.emits
        if one.seen is None:
            weights = emits.weights.take(taps.of(one.codes), axis=0)
            kinds = [taps.kind % emits.classes == k for k in range(emits.classes)]
            one.seen = np.stack(
                [
                    taps.blend(weights[..., p] * kind)
                    for kind in kinds
                    for p in range(len(emits.parts))
                ]
            )
        doses = []
        for k in range(emits.classes):
            ahead = k / emits.classes * emits.refreshes * period
            doses.append(emits.doses(last + ahead, period) - emits.doses(first + ahead, period))
        return np.einsum("rp,prc->rc", np.concatenate(doses, 1), one.seen)

    def _fields(self, one: Shown, first: Floats, last: Floats, taps: Taps) -> Floats:
        """Light of rows that are lit in every second refresh only."""
        period = 1.0 / self.refresh_hz
        level = SHARES.take(taps.of(one.codes))
        lit = []
        for parity in (0, 1):

            def until(time: Floats, parity: int = parity) -> Floats:
                turns = time / (2.0 * period) - 0.5 * parity
                part = np.minimum(turns - np.floor(turns), 0.5)
                return 2.0 * period * 2.0 * (0.5 * np.floor(turns) + part)

            lit.append(until(last) - until(first))
        table = np.stack(lit, 1)
        return taps.blend(level * table.ravel().take(taps.rows * 2 + taps.kind // 2))

    def close(self) -> None:
        pass

    def __enter__(self) -> ModelProjector:
        return self

    def __exit__(self, *error: object) -> None:
        pass


@dataclass
class Crystal(ModelProjector):
    """A liquid crystal: light rises and falls at speeds of its own between any two greys.

    light = target + (start − target) (1 + t/τ) exp(−t/τ): two relaxations in a row, of the director
    and of the light that it passes. Falling is slower than rising; small steps are the slowest.
    """

    rise_s: float = 0.0015
    fall_s: float = 0.0025
    overdrive: float = 0.0
    """Share of a step that is added for one refresh."""
    gamma: float = 1.0

    def _begin(self, first: Shown) -> None:
        first.start = np.zeros((ROWS, COLUMNS))
        first.target = np.zeros((ROWS, COLUMNS))
        first.tau_s = np.full((ROWS, COLUMNS), 1e-3)

    def _append(self, from_s: Floats, codes: Picture) -> None:
        goal = SHARES[codes] ** self.gamma
        last = self.shown[-1]
        assert last.target is not None
        if self.overdrive:
            driven = np.clip(goal + self.overdrive * (goal - last.target), 0.0, 1.0)
            self._step(from_s, codes, driven)
            from_s = from_s + 1.0 / self.refresh_hz
        self._step(from_s, codes, goal)

    def _step(self, from_s: Floats, codes: Picture, goal: Floats) -> None:
        last = self.shown[-1]
        assert last.start is not None
        assert last.target is not None
        assert last.tau_s is not None
        past = np.maximum(from_s - last.from_s, 0.0)[:, None] / last.tau_s
        now = last.target + (last.start - last.target) * (1.0 + past) * np.exp(-past)
        tau = np.where(goal > now, self.rise_s, self.fall_s) * (1.6 - 0.6 * np.abs(goal - now))
        self.shown.append(Shown(from_s, codes, now, goal, tau))

    def _dose(self, one: Shown, first: Floats, last: Floats, taps: Taps) -> Floats:
        assert one.start is not None
        assert one.target is not None
        assert one.tau_s is not None
        since = one.from_s[taps.row_at]
        if one.seen is None:
            one.seen = taps.blend(taps.gather(one.target))
        if (first - since).min() > SETTLED * float(one.tau_s.max()):
            return one.seen * (last - first)[:, None]
        start, goal = taps.gather(one.start), taps.gather(one.target)
        tau = taps.gather(one.tau_s)

        def rest(time: Floats) -> Floats:
            """∫ (1 + t/τ) exp(−t/τ) from then on."""
            past = (np.maximum(time - since, 0.0)[:, None]) / tau
            return np.asarray(tau * (2.0 + past) * np.exp(-past))

        steady = goal * (last - first)[:, None]
        return taps.blend(steady + (start - goal) * (rest(first) - rest(last)))


@dataclass(frozen=True)
class Taps:
    """Projector pixels that light every camera pixel, with their weights."""

    index: NDArray[np.intp]
    """(taps, h, w), flat."""
    weight: Floats
    """(taps, h, w)."""
    row_at: NDArray[np.intp]
    """(h,), projector row in the middle of every camera row."""
    kind: NDArray[np.intp]
    """(taps, h, w), place in the 2 × 2 pattern of pixels."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the camera."""
        return self.index.shape[1], self.index.shape[2]

    @property
    def rows(self) -> NDArray[np.intp]:
        """Camera row of every pixel, (h, 1)."""
        return np.arange(self.index.shape[1])[:, None]

    def of(self, picture: Picture) -> NDArray[np.intp]:
        """Codes of the pixels."""
        return picture.ravel().take(self.index).astype(np.intp)

    def gather(self, values: Floats) -> Floats:
        """Values of the pixels."""
        return np.asarray(values.ravel().take(self.index))

    def blend(self, values: Floats) -> Floats:
        """Light at the camera's pixels."""
        return np.einsum("khw,khw->hw", values, self.weight)


def taps_of(x_px: Floats, y_px: Floats, *, blur_px: float, fill: float = 1.0) -> Taps:
    """The taps of camera pixels at projector coordinates, for a Gaussian blur of square pixels.

    ``fill`` is the share of a pixel's pitch that is lit, along each axis.
    """
    reach = 2 if blur_px < 0.8 else 3
    x0, y0 = np.floor(x_px).astype(int), np.floor(y_px).astype(int)
    index, weight, kind = [], [], []
    for dy in range(1 - reach, 1 + reach):
        for dx in range(1 - reach, 1 + reach):
            x, y = x0 + dx, y0 + dy
            weight.append(_seen(x_px - x, blur_px, fill) * _seen(y_px - y, blur_px, fill))
            x, y = np.clip(x, 0, COLUMNS - 1), np.clip(y, 0, ROWS - 1)
            index.append(y * COLUMNS + x)
            kind.append(2 * (y % 2) + x % 2)
    weights = np.stack(weight)
    row_at = np.clip(np.rint(y_px[:, y_px.shape[1] // 2]), 0, ROWS - 1).astype(int)
    return Taps(np.stack(index), weights / weights.sum(0).mean(), row_at, np.stack(kind))


def _seen(distance: Floats, blur: float, fill: float) -> Floats:
    """Light of a pixel that is lit over ``fill`` px, seen at a distance through a Gaussian."""
    from scipy.special import erf

    scale = blur * 2.0**0.5
    edge = 0.5 * fill
    return np.asarray(0.5 * (erf((distance + edge) / scale) - erf((distance - edge) / scale)))
