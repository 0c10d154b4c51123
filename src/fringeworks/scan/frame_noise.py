"""The noise of frames: how large, how even, and how much of a frame stays in the next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.scan.differences import ROUNDING_VARIANCE, block_differences, compared
from fringeworks.types import CameraNoise

BRIGHTNESS_BINS = 8
"""Groups of equal size, by brightness, in which the noise is measured."""
COUNTED = 0.99
"""Share of the squared differences that a group's variance is taken from; the largest may be
changes in the scene."""
COUNTED_VARIANCE = 0.923
"""Mean of the smallest 99 % of the squares of normal values, over the mean of all."""
MAX_CLIPPED = 0.03
"""Largest share of samples at the darkest or brightest count in a group whose noise is used. Where
black is count 0, or a highlight saturates, clipping hides noise: at this share, 3 % of σ."""
MAX_HIDDEN = 0.9
"""Largest share of dark samples at the darkest count from which noise is still computed: clipping
then hides all but a 27th of the variance."""
UNEVEN = 1.5
"""Mean squared difference of a block, over that of the measured noise, up to which the noise is
even. Chance does not exceed it. Compression and noise reduction in the camera do: their noise is
larger beside edges."""
MAX_KEPT = 0.25
"""Share of the frame before, in every frame, up to which two frames that agree show no trace of the
picture before: it is then below half a standard deviation."""
TRACE_SHARE = 0.01
"""Smallest part of a change of brightness from which the share that is kept is computed. Noise
moves the mean of a frame by a hundredth of it."""
MOST_KEPT = 0.9
"""Largest share of the frame before that is waited for."""
TRACE_SIGMAS = 0.3
"""Trace of the picture before that is left in a frame after waiting, standard deviations."""


@dataclass(frozen=True)
class FrameNoise:
    """How frames of one picture differ."""

    usual: CameraNoise
    """The camera's noise, as the mean over the frame."""
    largest: CameraNoise
    """Where it is largest; more than ``usual`` only with cameras whose noise is uneven."""
    kept: float
    """Share of the frame before in every frame, 0…1: cameras that reduce noise over time keep one.
    """
    exact: bool
    """Whether frames of one picture are equal."""

    @property
    def uneven(self) -> float:
        """Variance where it is largest, over the usual one; 1 where the noise is even."""
        return (self.largest.read_counts / self.usual.read_counts) ** 2

    @property
    def waited_frames(self) -> int:
        """Number of frames after which the trace of the picture before is gone.

        Two frames that agree still show a trace of up to √2 a/(1 − a) standard deviations for the
        share a that is kept; every further frame leaves the share a of it.
        """
        a = min(self.kept, MOST_KEPT)
        if a <= MAX_KEPT:
            return 0
        trace = np.sqrt(2.0) * a / (1.0 - a)
        return int(np.ceil(np.log(TRACE_SIGMAS / trace) / np.log(a)))


def frame_noise(series: Sequence[Sequence[NDArray[Any]]], kept: float = 0.0) -> FrameNoise:
    """Measure a camera's noise from series of frames.

    Parameters
    ----------
    series : sequences of (h, w) arrays, counts
        In a series are frames of one picture in the order of their taking. The last series shows
        edges, and brightnesses from black to white.
    kept : float
        From ``kept_of_change``; the larger one of this and that in the noise counts. Filters that
        follow motion keep nothing of a large change, but of a small one.

    Returns
    -------
    FrameNoise
    """
    # Frames of a real camera differ by noise; equal ones are one frame delivered twice.
    different = [_different(frames) for frames in series]
    exact = all(len(frames) == 1 for frames in different)
    noise = noise_between([two_of(frames) for frames in different if exact or len(frames) > 1])
    grids = [compared(frame) for frame in different[-1]]
    edges = list(pairwise(grids))
    even = all(block_differences(*pair, noise).max() <= UNEVEN for pair in edges)
    largest = noise if even else with_largest_block(edges, noise)
    return FrameNoise(noise, largest, max(kept, _kept_of_noise(grids)), exact)


def two_of(frames: Sequence[NDArray[Any]]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the last two frames that are not one frame delivered twice; equal ones if all are."""
    one, other = [frames[-1], *_different(frames)][-2:]
    return one, other


def _different(frames: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
    """The frames without those that are equal to the one before."""
    return [
        frame
        for n, frame in enumerate(frames)
        if n == 0 or not np.array_equal(frame, frames[n - 1])
    ]


def kept_of_change(means: Sequence[float]) -> float:
    """Return the share of the frame before in every frame, from a change of brightness.

    Parameters
    ----------
    means : sequence of float
        Mean brightness of frames in a row until it is steady. The rise from the darkest one counts;
        what was on the screen before black does not.

    Returns
    -------
    0…1. The change in the first two frames is left out: pictures change while they are exposed.
    """
    changes = np.diff(means[int(np.argmin(means)) :])
    changes = changes[changes != 0]
    if changes.size < 4:
        return 0.0
    late = changes[int(np.argmax(changes)) + 2 :] / np.sum(changes)
    now, then = late[1:], late[:-1]
    seen = then > TRACE_SHARE
    if not seen.any():
        return 0.0
    return float(np.clip(np.sum(now[seen] * then[seen]) / np.sum(then[seen] ** 2), 0.0, 1.0))


def _kept_of_noise(frames: Sequence[NDArray[np.float32]]) -> float:
    """Share of the frame before in every frame, from frames of one picture.

    With the share a, the differences of frames that follow each other have the variance
    2 σ² (1 − a), those of every second frame 2 σ² (1 − a²): 1 + a times as much.
    """
    if len(frames) < 3:
        return 0.0
    near = np.mean([np.var(b - a) for a, b in pairwise(frames)])
    far = np.mean([np.var(b - a) for a, b in zip(frames, frames[2:], strict=False)])
    return float(np.clip(far / near - 1.0, 0.0, 1.0))


def noise_between(pairs: Sequence[tuple[NDArray[Any], NDArray[Any]]]) -> CameraNoise:
    """Measure a camera's noise from pairs of frames that show the same.

    Parameters
    ----------
    pairs : pairs of (h, w) arrays, counts
        Darker and brighter ones, so that shot noise is seen.

    Returns
    -------
    CameraNoise: the variance of half the difference, fitted over brightness (theory §9). Where
    black is clipped everywhere, the read noise is that of a normal distribution of which as many
    samples would be clipped.
    """
    grids = [(compared(one).ravel(), compared(other).ravel()) for one, other in pairs]
    lowest, highest = (float(f([f(g) for g in grids])) for f in (np.min, np.max))
    groups = [group for a, b in grids for group in _groups(a, b, lowest, highest)]
    usable = [g for g in groups if max(g.black, g.saturated) <= MAX_CLIPPED]
    dark = [g for g in groups if g.black > MAX_CLIPPED]
    read, gain = _fitted(usable) if usable or dark else _fitted(groups)
    if dark:
        brightness, variance, _, _, hidden = np.mean(dark, axis=0).tolist()
        if not usable:
            variance /= _shown_of_clipped(min(max(hidden, 0.0), MAX_HIDDEN))
        # Clipping hides noise and never adds any.
        read = max(read, variance - gain * brightness)
    return CameraNoise(float(np.sqrt(max(read, ROUNDING_VARIANCE))), gain)


def with_largest_block(
    pairs: Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]], noise: CameraNoise
) -> CameraNoise:
    """Scale a noise so that it explains every block of frames that show the same.

    Parameters
    ----------
    pairs : pairs of arrays from ``compared``, counts
    noise : CameraNoise

    Returns
    -------
    CameraNoise with which the largest ``block_differences`` is at most 1.
    """
    scale = 1.0
    while True:
        scaled = CameraNoise(noise.read_counts * float(np.sqrt(scale)), noise.gain * scale)
        largest = max(float(block_differences(*pair, scaled).max()) for pair in pairs)
        if largest <= 1.0:
            return scaled
        # Single pixels are limited, so that one step may not suffice; the share of 1 % ends it.
        scale *= 1.01 * largest


class _Group(NamedTuple):
    """Samples of similar brightness in two frames that show the same."""

    brightness: float
    """Mean, counts."""
    variance: float
    """Of noise, counts²."""
    black: float
    """Share of the samples at the darkest count."""
    saturated: float
    """Share of the samples at the brightest count."""
    hidden: float
    """Share of the samples that would be below the darkest count without clipping."""


def _groups(
    a: NDArray[np.float32], b: NDArray[np.float32], lowest: float, highest: float
) -> Iterator[_Group]:
    """The samples of two frames, grouped by brightness."""
    order = np.argsort(a + b, kind="stable")
    for part in np.array_split(order, BRIGHTNESS_BINS):
        squares = np.sort(0.5 * (a[part] - b[part]) ** 2)
        kept = squares[: max(1, int(COUNTED * squares.size))]
        both = np.concatenate((a[part], b[part]))
        yield _Group(
            float(np.mean(both)),
            float(np.mean(kept)) / COUNTED_VARIANCE,
            black := float(np.mean(both <= lowest)),
            float(np.mean(both >= highest)),
            # Rounding adds the samples up to half a count: half as many as are rounded to one.
            black - 0.5 * float(np.mean(both == lowest + 1)),
        )


def _fitted(groups: Sequence[_Group]) -> tuple[float, float]:
    """The variance at zero brightness, counts², and its gain, counts."""
    if not groups:
        return 0.0, 0.0
    I = np.array([group.brightness for group in groups])  # noqa: E741
    v = np.maximum([group.variance for group in groups], ROUNDING_VARIANCE)
    # A variance scatters in proportion to itself, so relative errors are made small.
    design = np.column_stack((np.ones_like(I), I)) / v[:, None]
    (read, gain), _ = scipy.optimize.nnls(design, np.ones_like(v))
    return float(read), float(gain)


def _shown_of_clipped(share: float) -> float:
    """Return the variance that is left of a unit normal when a share of it is clipped at one end.

    With the limit c = Φ⁻¹(share), Y = max(X, c) has E Y = c Φ(c) + φ(c) and
    E Y² = c² Φ(c) + 1 − Φ(c) + c φ(c).
    """
    if share <= 0:
        return 1.0
    c = float(scipy.special.ndtri(share))
    density = np.exp(-0.5 * c**2) / np.sqrt(2 * np.pi)
    mean = c * share + density
    return float(c**2 * share + (1.0 - share) + c * density - mean**2)
