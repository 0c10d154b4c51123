"""A projector that exists only in memory, with the faults of real ones."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.devices.clock import Clock, SystemClock
from fringeworks.devices.protocols import Closing, checked_picture
from fringeworks.types import DeviceProblem, FloatMap, InputError, check_fields

LEAST_SHARE = 1e-9
"""Share of an earlier picture from which on its light counts as still on the screen, 0…1: that of a
thousandth of a count of 16 bits."""
KEPT_PICTURES = 64
"""Pictures that are remembered, so that a camera with a long exposure finds all that it saw."""
LIMITED_BLACK = 16 / 255
"""Share of full scale that video of limited range takes for black (ITU-R BT.601)."""
LIMITED_WHITE = 235 / 255
"""Share of full scale that video of limited range takes for white (ITU-R BT.601)."""


@dataclass(frozen=True)
class ProjectorModel:
    """How a virtual projector shows pictures.

    Raises
    ------
    InputError for a value out of its range.
    """

    width_px: int = 320
    """Columns; ≥ 2."""
    height_px: int = 200
    """Rows; ≥ 2."""
    bits: int = 8
    """Depth of the pictures."""
    refresh_hz: float = 60.0
    """Pictures per second; > 0."""
    delay_s: float = 0.0
    """Time from handing over a picture until its light appears, s; ≥ 0."""
    jitter_refreshes: int = 0
    """Largest number of refresh periods by which light appears later at random; ≥ 0."""
    gamma: float = 1.0
    """Exponent of the response; > 0."""
    black: float = 0.0
    """Light of black, relative to that of white; 0…1."""
    settling_s: float = 0.0
    """Time constant with which the light follows a new picture, s: that of a liquid crystal."""
    duty: float = 1.0
    """Share of every refresh period in which light is sent, as by a colour wheel; 0…1."""
    range_limited: bool = False
    """Whether counts below 16 and above 235 of 255 are cut off, as by an HDMI link of limited range
    that was fed full range."""
    scale: float = 1.0
    """Factor by which pictures are resized about the middle, as by keystone correction or a video
    mode that is not the native one; > 0."""
    mirrored: bool = False
    """Whether left and right are exchanged, as for projection from behind."""

    def __post_init__(self) -> None:
        check_fields(
            self,
            refresh_hz=(self.refresh_hz > 0, "> 0"),
            delay_s=(self.delay_s >= 0, ">= 0"),
            jitter_refreshes=(self.jitter_refreshes >= 0, ">= 0"),
            gamma=(self.gamma > 0, "> 0"),
            black=(0 <= self.black < 1, "0 to 1"),
            settling_s=(self.settling_s >= 0, ">= 0"),
            duty=(0 < self.duty <= 1, "above 0, at most 1"),
            scale=(self.scale > 0, "> 0"),
        )
        if self.settling_s and self.duty < 1.0:
            raise InputError(
                "settling_s: expected a projector without a colour wheel (duty = 1), got duty = "
                f"{self.duty:g}"
            )


@dataclass(frozen=True, eq=False)
class Shown:
    """A picture, and when its light appears."""

    number: int
    """Number of the picture since the projector was opened; 0 is the black before the first."""
    light: FloatMap
    """Light of all projector pixels, (rows, columns) or (rows, columns, 3), 0…1."""
    from_s: float
    """Time at which its light appears, s."""


class VirtualProjector(Closing):
    """A projector that remembers what it shows, for a virtual camera to look at.

    Parameters
    ----------
    model : ProjectorModel, optional
    clock : Clock, optional
        The machine's clock by default.
    seed : int
        Seed of the jitter.
    """

    def __init__(
        self, model: ProjectorModel | None = None, *, clock: Clock | None = None, seed: int = 0
    ) -> None:
        self.model = model or ProjectorModel()
        self.clock = clock or SystemClock()
        self._rng = np.random.default_rng(seed)
        self._start_s = self.clock.now_s()
        self._open = True
        dark = np.full((self.model.height_px, self.model.width_px), self.model.black)
        self.shown: deque[Shown] = deque([Shown(0, dark, -np.inf)], maxlen=KEPT_PICTURES)

    @property
    def name(self) -> str:
        """``virtual``."""
        return "virtual"

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows."""
        return self.model.width_px, self.model.height_px

    @property
    def bits(self) -> int:
        """Depth of the pictures."""
        return self.model.bits

    @property
    def refresh_s(self) -> float:
        """Time from one picture to the next, s."""
        return 1.0 / self.model.refresh_hz

    @property
    def shows_colours(self) -> bool:
        """True."""
        return True

    def show(self, picture: NDArray[Any]) -> float:
        """Show a picture; see ``Projector.show``. Returns at the next refresh, as a window does."""
        if not self._open:
            raise DeviceProblem("virtual projector: expected an open projector, got a closed one")
        picture = checked_picture(picture, self.size_px, self.bits, colours=True)
        refreshes = np.floor((self.clock.now_s() - self._start_s) / self.refresh_s) + 1
        handed_s = float(self._start_s + refreshes * self.refresh_s)
        late = self._rng.integers(0, self.model.jitter_refreshes + 1) * self.refresh_s
        before = self.shown[-1]
        from_s = max(handed_s + self.model.delay_s + late, before.from_s)
        self.shown.append(Shown(before.number + 1, self.light_of(picture), from_s))
        self.clock.wait_until(handed_s)
        return handed_s

    def close(self) -> None:
        """Show nothing more."""
        self._open = False

    def light_of(self, picture: NDArray[Any]) -> FloatMap:
        """Light that a picture makes, relative to white, in the shape of the picture."""
        m = self.model
        sent = picture / float(2**m.bits - 1)
        if m.range_limited:
            sent = np.clip((sent - LIMITED_BLACK) / (LIMITED_WHITE - LIMITED_BLACK), 0.0, 1.0)
        if m.scale != 1.0:
            # A colour keeps its place along the last axis.
            factor = np.array([1 / m.scale, 1 / m.scale, 1.0][: sent.ndim])
            middle = (np.array(sent.shape) - 1) / 2
            sent = scipy.ndimage.affine_transform(sent, factor, middle - middle * factor, order=1)
        if m.mirrored:
            sent = sent[:, ::-1]
        return np.asarray(m.black + (1.0 - m.black) * sent**m.gamma)

    def emitted_s(self, until_s: FloatMap) -> FloatMap:
        """Time during which light was sent, from the start until then, over the duty, s."""
        if self.model.duty == 1.0:
            return until_s - self._start_s
        whole, part = np.divmod((until_s - self._start_s) / self.refresh_s, 1.0)
        return np.asarray((whole + np.minimum(part / self.model.duty, 1.0)) * self.refresh_s)

    def seen(self, from_s: FloatMap, until_s: FloatMap) -> list[tuple[Shown, FloatMap]]:
        """Return which pictures lit the time from one moment to another, and for how long.

        Parameters
        ----------
        from_s, until_s : (k,) arrays
            Start and end of k exposures, s.

        Returns
        -------
        Pictures with the time over which each lit each exposure, (k,), s.
        """
        first_s, last_s = float(np.min(from_s)), float(np.max(until_s))
        ends = [after.from_s for after in list(self.shown)[1:]] + [np.inf]
        lit: dict[int, tuple[Shown, FloatMap]] = {}
        # What is left on the screen of earlier pictures when an interval begins.
        left: list[tuple[Shown, float]] = []
        tau = self.model.settling_s
        for shown, end in zip(self.shown, ends, strict=True):
            if shown.from_s < last_s and end > first_s:
                self._add(lit, shown, end, left, from_s, until_s)
            if tau:
                lasts = np.isfinite(end) and np.isfinite(shown.from_s)
                gone = np.exp(-(end - shown.from_s) / tau) if lasts else 0.0
                left = [(earlier, share * gone) for earlier, share in left]
                left = [(earlier, share) for earlier, share in left if share > LEAST_SHARE]
                left.append((shown, 1.0 - sum(share for _, share in left)))
        return [(shown, t) for shown, t in lit.values() if np.any(t > 0)]

    def _add(
        self,
        lit: dict[int, tuple[Shown, FloatMap]],
        shown: Shown,
        end_s: float,
        left: list[tuple[Shown, float]],
        from_s: FloatMap,
        until_s: FloatMap,
    ) -> None:
        """Add the time over which a picture lights exposures, and what is left of earlier ones."""
        start = np.clip(shown.from_s, from_s, until_s)
        stop = np.clip(end_s, from_s, until_s)
        time_s = self.emitted_s(stop) - self.emitted_s(start)
        if left and np.isfinite(shown.from_s):
            tau = self.model.settling_s
            slow = tau * (
                np.exp(-(start - shown.from_s) / tau) - np.exp(-(stop - shown.from_s) / tau)
            )
            for earlier, share in left:
                _, before = lit.get(earlier.number, (earlier, np.zeros_like(slow)))
                lit[earlier.number] = earlier, before + share * slow
            time_s = time_s - sum(share for _, share in left) * slow
        lit[shown.number] = shown, time_s
