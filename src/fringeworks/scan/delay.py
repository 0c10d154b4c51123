"""How long light and frames take: measured by filming a counter."""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.devices.clock import Clock, clock_of
from fringeworks.devices.protocols import (
    Camera,
    Grab,
    Projector,
    TriggeredCamera,
)
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.dating import moments_s
from fringeworks.scan.differences import compared
from fringeworks.scan.rhythm import USUAL_REFRESH_S, check_steady
from fringeworks.scan.uniform import block_pictures
from fringeworks.types import CameraNoise, CameraSettings, Delay, DeviceProblem, FloatMap

COUNTERS = 16
"""Different pictures of the counter. Shown for 42 ms each on average, they repeat after 0.6 s at
the earliest, longer than usual webcams are late."""
BLOCK_SHARE = 24
"""Blocks of the counter's pictures along the projector's longer side: blocks are large enough for a
camera that is out of focus, and small enough that every camera sees many."""
SHOWS = 150
"""Pictures that are filmed, in about six seconds. The shortest delay is only seen if an exposure
ends just after it; with less, one measurement in some hundred missed it where delays jitter."""
MAX_SHOWS = 6 * SHOWS
"""Pictures that are filmed at most, where a slow camera gives few frames."""
LONGEST_HOLD = 4
"""Pictures are held for one to this many refresh periods, at random, so that exposures begin at all
moments."""
BANDS = (8, 4, 2, 1)
"""Numbers of bands of rows in which a frame is read, the first by choice, because a rolling shutter
exposes rows at different times. Fewer are used where a band would show too few of the blocks to
tell the pictures apart, as with a small object before a dark background."""
READ_PIXELS = 40_000
"""Pixels of a frame that are read, on a grid: blocks are 16 px wide and more in usual frames, and
reading then takes 2 ms."""
SHARE_SIGMAS = 6.0
"""``VISIBLE_SHARE`` in standard deviations by which noise changes a picture's share in a band.
Noise alone exceeds it once in 10⁹ shares."""
VISIBLE_SHARE = 0.05
"""Share of an exposure from which on a picture counts as visible. Less changes a fringe by less
than 5 % of its modulation and is hidden in the noise of small contrasts."""
MAX_RESIDUAL = 0.2
"""Largest residual of a frame that is a mixture of the counter's last pictures, relative to their
contrast. A frame that shows another picture leaves 0.7."""
MIN_READ_SHARE = 0.8
"""Smallest share of the frames that must be mixtures of the counter's last pictures. The first
frames show what was there before."""
USUAL_GAP = 0.95
"""Share of the times between frames that a picture is held long enough for. Pictures that find no
frame are shown again, which is quicker than holding every picture for the longest time."""
MIN_READINGS = 120
"""Smallest number of frames that show a counter, for a delay to be known."""


def measure_delay(
    projector: Projector,
    camera: Camera,
    *,
    triggered: bool = False,
    seed: int = 0,
) -> Delay:
    """Film pictures that change fast, and read from every frame which of them it shows.

    Parameters
    ----------
    projector : Projector
    camera : Camera
        Configured as it will be for the scan.
    triggered : bool
        Whether frames are triggered.
    seed : int
        Of the pictures and of the times for which they are held.

    Returns
    -------
    Delay

    Raises
    ------
    DeviceProblem where the camera does not see the pictures, or sees another part of the
    projector's light in every frame.

    Notes
    -----
    Pictures of random blocks are taken one by one first (``Agreement``). A frame taken in fast
    sequence is a mixture of them; the shares are found by least squares with no negative share.
    This needs no knowledge of where the camera looks.
    """
    clock = clock_of(projector)
    refresh_s = projector.refresh_s or USUAL_REFRESH_S
    side_px = max(4, max(projector.size_px) // BLOCK_SHARE)
    pictures = block_pictures(projector, COUNTERS, side_px=side_px, seed=seed)
    check_steady(projector, camera)
    agreement = Agreement(projector, camera)
    single = [compared(agreement.take(picture, "a counter").pixels) for picture in pictures]
    if agreement.noise.waited_frames:
        raise DeviceProblem(
            f"{camera.name}: expected frames of the present alone, got {agreement.noise.kept:.0%} "
            "of every frame in the next: frames cannot be taken in fast sequence; switch off noise "
            "reduction over time, or take frames by agreement"
        )
    film = _Film(camera, clock, _Reader(np.stack(single), agreement.noise.usual), triggered)
    film.shown.append((COUNTERS - 1, -np.inf))
    camera.configure(CameraSettings(triggered=triggered))
    camera.discard()
    rng = np.random.default_rng(seed)
    for n in range(MAX_SHOWS):
        if n >= SHOWS and film.readings >= MIN_READINGS:
            break
        others = [n for n in range(COUNTERS) if n not in dict(film.shown)]
        which = int(rng.choice(others))
        film.shown.append((which, projector.show(pictures[which])))
        refreshes = rng.integers(1, LONGEST_HOLD + 1) - 0.5
        film.watch(film.shown[-1][1] + refreshes * refresh_s, 0.1 * refresh_s)
        film.trigger_after(rng.random() * refresh_s)
    return film.delay(refresh_s)


class _Film:
    """What was shown, and what the frames meanwhile showed."""

    def __init__(self, camera: Camera, clock: Clock, reader: _Reader, triggered: bool) -> None:
        self._camera = camera
        self._clock = clock
        self._reader = reader
        self._triggered_s: float | None = None
        self._next_s = clock.now_s()
        self._triggered = triggered
        self.shown: deque[tuple[int, float]] = deque(maxlen=COUNTERS - 1)
        """Numbers and times of the last pictures."""
        self._grabs: list[Grab] = []
        self._read_frames: list[_Read] = []
        self._triggers: list[tuple[int, float]] = []
        """Frames that were triggered, and the times of their triggers."""

    @property
    def readings(self) -> int:
        """Number of frames that bound the delay."""
        return sum(read.left_s is not None for read in self._read_frames)

    def watch(self, until_s: float, pause_s: float) -> None:
        """Read the frames that arrive until then."""
        while self._clock.now_s() < until_s:
            due = self._clock.now_s() >= self._next_s
            if self._triggered and self._triggered_s is None and due:
                assert isinstance(self._camera, TriggeredCamera)
                self._triggered_s = self._camera.trigger()
            if self._camera.waiting():
                self._read(self._camera.grab())
            else:
                self._clock.wait_until(min(until_s, self._clock.now_s() + pause_s))

    def trigger_after(self, pause_s: float) -> None:
        """Send no trigger for a while, so that triggers do not keep step with the projector."""
        self._next_s = self._clock.now_s() + pause_s

    def _read(self, grab: Grab) -> None:
        number = len(self._grabs)
        self._grabs.append(grab)
        if self._triggered_s is not None:
            self._triggers.append((number, self._triggered_s))
            self._triggered_s = None
        visible = self._reader.visible(compared(grab.pixels), [n for n, _ in self.shown])
        if not grab.complete or visible is None:
            return
        oldest, newest = visible
        shown_s = [time_s for _, time_s in self.shown]
        after = [*shown_s[1:], None]
        self._read_frames.append(
            _Read(number, shown_s[newest], after[newest], shown_s[oldest], after[oldest])
        )

    def delay(self, refresh_s: float) -> Delay:
        """The delays that the frames have shown."""
        frames = len(self._grabs)
        if self.readings < MIN_READINGS or len(self._read_frames) < MIN_READ_SHARE * frames:
            raise DeviceProblem(
                f"{self._camera.name}: expected frames that show one of the last {COUNTERS - 1} "
                f"pictures, got {self.readings} such frames of {frames}: the delay is longer than "
                "half a second or changes, so frames cannot be taken in fast sequence"
            )
        moments = moments_s(self._grabs, triggered=self._triggered)
        times = [float(moments[k]) - trigger_s for k, trigger_s in self._triggers]
        transit_s = (min(times), max(times)) if times else None
        frame_s = float(np.quantile(np.diff(moments), USUAL_GAP))
        # A picture is not visible before it is shown.
        lists: tuple[list[float], ...] = ([], [0.0], [], [])
        for number, *shown in self._read_frames:
            for times_s, shown_s in zip(lists, shown, strict=True):
                times_s += [] if shown_s is None else [float(moments[number]) - shown_s]
        known = [np.array([s for s in times_s if np.isfinite(s)]) for times_s in lists]
        return Delay(known[0], known[1], known[2], known[3], refresh_s, frame_s, transit_s)


class _Read(NamedTuple):
    """What a frame has shown: the times at which pictures were shown, s; None for no picture."""

    number: int
    """Of the frame."""
    appears_s: float
    """Of the newest picture that is visible."""
    absent_s: float | None
    """Of the first that is not yet visible."""
    alone_s: float
    """Of the oldest that is visible."""
    left_s: float | None
    """Of the one that replaces the oldest."""


class _Reader:
    """Reads which pictures a frame shows, by least squares against frames of single pictures."""

    def __init__(self, single: NDArray[np.float32], noise: CameraNoise) -> None:
        """``single`` is (pictures, h, w), counts.

        ``DeviceProblem`` where noise hides which picture is which.
        """
        self._stride = max(1, round(float(np.sqrt(single[0].size / READ_PIXELS))))
        single = single[:, :: self._stride, :: self._stride]
        # Bands hold equal parts of what tells the pictures apart.
        told = np.cumsum(np.sum(np.var(single, axis=0, dtype=np.float64), axis=1))
        for count in BANDS:
            inner = np.searchsorted(told, told[-1] * np.arange(1, count) / count)
            self._edges = np.unique(inner[(inner > 0) & (inner < single.shape[1])])
            parts = np.split(single, self._edges, axis=1)
            self._bands = [part.reshape(len(part), -1).astype(np.float64) for part in parts]
            if all(_told_apart(band, noise) for band in self._bands):
                return
        raise DeviceProblem(
            "camera: expected to see enough of the projected picture to tell pictures of blocks "
            "apart, got too few blocks, or too much noise: use a larger or brighter surface"
        )

    def visible(self, frame: NDArray[Any], candidates: list[int]) -> tuple[int, int] | None:
        """Places of the oldest and the newest visible picture among the candidates.

        ``candidates`` are numbers of pictures in the order of showing. None for a frame that shows
        something else.
        """
        places: list[int] = []
        residual = contrast = 0.0
        parts = np.split(frame[:: self._stride, :: self._stride], self._edges, axis=0)
        for part, single in zip(parts, self._bands, strict=True):
            chosen, values = single[candidates], part.ravel().astype(np.float64)
            # Least squares on the triangular factor: the same minimum, with fewer rows.
            L = np.linalg.cholesky(chosen @ chosen.T)
            shares, _ = scipy.optimize.nnls(
                L.T, scipy.linalg.solve_triangular(L, chosen @ values, lower=True)
            )
            places += np.flatnonzero(shares > VISIBLE_SHARE).tolist()
            residual += float(np.sum((values - shares @ chosen) ** 2))
            contrast += float(np.sum((chosen - chosen.mean(axis=0)) ** 2)) / len(chosen)
        if not places or residual > MAX_RESIDUAL**2 * contrast:
            return None
        return min(places), max(places)


def _told_apart(band: FloatMap, noise: CameraNoise) -> bool:
    """Whether noise changes the shares of the pictures in a band by less than what is visible.

    The covariance of the shares is σ² (A Aᵀ)⁻¹, where A (pictures, pixels) is without noise; noise
    adds σ² times the number of pixels to the eigenvalues of A Aᵀ.
    """
    variance = float(np.mean(noise.variance(band)))
    least = float(np.linalg.eigvalsh(band @ band.T)[0]) - variance * band.shape[1]
    return bool(least > variance * (SHARE_SIGMAS / VISIBLE_SHARE) ** 2)
