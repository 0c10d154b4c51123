"""Whether two frames show the same, judged by the camera's noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from fringeworks.types import CameraNoise, FloatMap

COMPARED_PIXELS = 200_000
"""Pixels of a frame that are compared; larger frames are compared on a grid. A comparison then
takes 3 ms, well below the time between two frames."""
BLOCK_PX = 16
"""Side of the blocks in which differences are averaged, compared pixels. A mean over 256 pixels
scatters by 9 %, and a shift of the fringes fills whole blocks."""
MOST = 25.0
"""Limit on a squared difference over its variance, so that single hot pixels do not fill a
block."""
AGREES = 2.0
"""Mean squared difference of a block, over that of noise, up to which frames agree. Chance exceeds
1.5 in one block of 10⁸; the rest is for noise that JPEG or interpolation makes uneven."""
CHANGES = 4.0
"""Mean squared difference of a block, over that of noise, from which on it has changed. Twice
``AGREES``, so that a frame cannot be both."""
CHANGED_BLOCKS = 3
"""Blocks that must change for a frame to count as changed."""
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
ROUNDING_VARIANCE = 1.0 / 12.0
"""Variance of rounding to whole counts: no frame has less noise."""


def compared(frame: NDArray[Any]) -> NDArray[np.float32]:
    """Return the pixels of a frame that comparisons use, on a grid."""
    stride = max(1, int(np.ceil(np.sqrt(frame.size / COMPARED_PIXELS))))
    return np.asarray(frame[::stride, ::stride], np.float32)


def block_differences(
    one: NDArray[np.float32], other: NDArray[np.float32], noise: CameraNoise
) -> FloatMap:
    """Mean squared difference of two frames in blocks, over the expectation from noise.

    Parameters
    ----------
    one, other : (h, w) arrays
        From ``compared``, counts.
    noise : CameraNoise

    Returns
    -------
    (rows, columns) array of blocks; 1 where the frames differ by noise only.
    """
    variance = noise.read_counts**2 * 2.0 + noise.gain * np.maximum(one + other, 0.0)
    variance = np.maximum(variance, 2.0 * ROUNDING_VARIANCE)
    squares = np.minimum((one - other) ** 2 / variance, MOST)
    edges = [np.arange(0, max(n - BLOCK_PX // 2, 1), BLOCK_PX) for n in squares.shape]
    sums = np.add.reduceat(np.add.reduceat(squares, edges[0], axis=0), edges[1], axis=1)
    sizes = [np.diff(np.append(e, n)) for e, n in zip(edges, squares.shape, strict=True)]
    return np.asarray(sums / np.outer(*sizes), np.float64)


def agree(differences: FloatMap) -> bool:
    """Whether frames with these ``block_differences`` show the same."""
    return bool(differences.max() <= AGREES)


def changed(differences: FloatMap) -> bool:
    """Whether frames with these ``block_differences`` show different things."""
    needed = min(CHANGED_BLOCKS, differences.size)
    return int(np.sum(differences >= CHANGES)) >= needed


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
    (read, gain), _ = optimize.nnls(design, np.ones_like(v))
    return float(read), float(gain)


def _shown_of_clipped(share: float) -> float:
    """Return the variance that is left of a unit normal when a share of it is clipped at one end.

    With the limit c = Φ⁻¹(share), Y = max(X, c) has E Y = c Φ(c) + φ(c) and
    E Y² = c² Φ(c) + 1 − Φ(c) + c φ(c).
    """
    if share <= 0:
        return 1.0
    c = float(special.ndtri(share))
    density = np.exp(-0.5 * c**2) / np.sqrt(2 * np.pi)
    mean = c * share + density
    return float(c**2 * share + (1.0 - share) + c * density - mean**2)
