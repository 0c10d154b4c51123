"""Errors of single pixels beside edges, where the camera's blur mixes the light of two places.

Beside a depth step, a crease or the rim of a shadow, a pixel sees some light of its neighbours. How
much shows in the pixel itself: it differs from what the pixels behind it extrapolate to. Pixels
that a mixture may reach are those next to a step or to unmeasured ones, and those that one more
blur of the light shifts.
"""

from __future__ import annotations

from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks._lazy import scipy
from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.edges import FEWEST, RINGS, Fringes, beside_steps, step_px
from fringeworks.statistics.shrinkage import mean_square_errors
from fringeworks.types import BoolMap, FloatMap

Indices = NDArray[np.intp]

REACH = 8
"""Distance from a pixel that anything is compared at, and a margin, px."""

BEHIND = (range(1, 3), range(2, 5), range(2, 8))
"""Distances of the pixels behind that a pixel is extrapolated from, px, the better ones later. The
first one of six is mixed itself by blur of more than a pixel; thin bodies have two only."""

CURVED = 6
"""Number of pixels behind from which on a parabola is extrapolated; a straight line from fewer."""

BLUR_PX = 1.0
"""Standard deviation of the blur that shows which pixels a mixture may reach, px. Errors are taken
from residuals, and not from it: 0.6 px finds fewer of them before a lens of 1.2 px, 1.0 px finds
those of all lenses from 0.3 to 1.3 px. Simulated."""

SHIFTED = 4.0
"""Smallest shift by one more blur, or excess of the slope, in standard deviations of its noise, at
which errors may be. At 2, one pixel in ten is chosen by its own noise, which makes its residual
large as well: 75 % of the pixels of a plane were within 1 σ. At 4, two in 10,000 are."""

BESIDE_PX = 2
"""Distance from such a pixel, along rows and columns, at which others may have smaller errors, px:
blur of 1 px reaches as far."""

STEEP_NOISE = (2.0 + 2.0 / 9.0) ** 0.5
"""Noise of the slope over 2 px less that over 6 px, in that of a pixel."""

TINY = 1e-9
"""Divides instead of a noise of zero, projector px."""


class _Map(NamedTuple):
    """Flat maps with a margin of NaN, and how far apart their rows are."""

    coordinate: NDArray[np.float64]
    sigma: NDArray[np.float64]
    inside: NDArray[np.bool_]
    stride: int
    repeats: float

    @classmethod
    def of(cls, coordinate: FloatMap, sigma: FloatMap, repeats: float) -> _Map:
        inside = np.pad(np.ones(coordinate.shape, bool), REACH)
        maps = _padded(coordinate), _padded(sigma)
        return cls(maps[0], maps[1], inside.ravel(), inside.shape[1], repeats)

    def places(self, chosen: BoolMap) -> Indices:
        """Places of the chosen pixels in the flat maps."""
        y, x = np.nonzero(chosen)
        return np.asarray((y + REACH) * self.stride + x + REACH)

    def rise(self, there: Indices, here: Indices) -> NDArray[np.float64]:
        """Differences of coordinates, the nearest ones where these repeat."""
        rise = self.coordinate[there] - self.coordinate[here]
        if np.isfinite(self.repeats):
            rise -= self.repeats * np.round(rise / self.repeats)
        return np.asarray(rise)


def _padded(values: FloatMap) -> NDArray[np.float64]:
    padded = np.pad(values.astype(np.float64), REACH, constant_values=np.nan)
    return np.asarray(padded.ravel())


def edge_variance(
    coordinate: FloatMap,
    sigma: FloatMap,
    modulation: FloatMap | None,
    removed: FloatMap | None,
    *,
    lines: bool = False,
    **fringes: Unpack[Fringes],
) -> FloatMap | None:
    """Variance that errors beside edges add to that of every pixel, px²; None where there are none.

    Parameters
    ----------
    coordinate, sigma : (h, w) float arrays, projector px
        NaN where a coordinate is unknown.
    modulation : (h, w) float array, counts
        None where the shift by blur is left in: only depth steps then count as edges.
    removed : (h, w) float array, projector px
        Shift by blur that was taken out of the coordinates; None where none was.
    lines : bool
        Whether rows are single lines, which are compared along themselves only.

    Notes
    -----
    The error of a pixel is estimated from its distance to what the pixels on one side extrapolate
    to, together with those of the other pixels of as large a shift (``statistics.shrinkage``).
    """
    map_ = _Map.of(coordinate, sigma, fringes["repeats_px"])
    known = np.isfinite(coordinate)
    beside = known & _candidates(coordinate, sigma, fringes, modulation, lines)
    level = np.where(known, _steepness(map_, coordinate.shape, lines), 0.0)
    if modulation is not None:
        shift, by_noise = _shift_by_blur(coordinate, sigma, modulation, fringes, lines)
        shift -= 0.0 if removed is None else removed
        np.fmax(level, np.abs(shift) / np.maximum(by_noise, TINY), out=level)
    strong = level > SHIFTED
    beside |= known & _widened(strong, lines)
    here = map_.places(beside | strong)
    if here.size < FEWEST:
        return None
    y, x = np.divmod(here, map_.stride)
    octave = np.log2(np.clip(level[y - REACH, x - REACH], SHIFTED, 2.0**REACH)).astype(np.intp)
    octave += 2 * REACH * ~strong[y - REACH, x - REACH]
    variance = np.zeros(map_.inside.size)
    for way in (1,) if lines else (1, map_.stride):
        residual, noise = _cleaner(map_, here, way, step_px(fringes), _padded(level))
        second = _shrunk(residual, noise, octave)
        variance[here] = np.maximum(variance[here], second)
    added = variance.reshape(-1, map_.stride)[REACH:-REACH, REACH:-REACH]
    return added.astype(np.float32) if np.any(added > 0.0) else None


def _steepness(map_: _Map, shape: tuple[int, int], lines: bool) -> FloatMap:
    """Slope over 2 px less that over 6 px, in standard deviations: the middle of a blurred step."""
    h, w = shape
    most: FloatMap = np.zeros(shape)

    def at(values: NDArray[np.float64], distance: int) -> FloatMap:
        start = REACH * map_.stride + REACH + distance
        return np.asarray(
            np.lib.stride_tricks.as_strided(
                values[start:], (h, w), (map_.stride * values.itemsize, values.itemsize)
            )
        )

    with np.errstate(invalid="ignore"):
        noise = STEEP_NOISE * np.maximum(at(map_.sigma, 0), TINY)
        for way in (1,) if lines else (1, map_.stride):
            rises = [at(map_.coordinate, k * way) - at(map_.coordinate, -k * way) for k in (1, 3)]
            if np.isfinite(map_.repeats):
                rises = [rise - map_.repeats * np.round(rise / map_.repeats) for rise in rises]
            excess = np.abs(rises[0] - rises[1] / 3.0)
            np.fmax(most, excess / noise, out=most)
    return most


def _candidates(
    coordinate: FloatMap,
    sigma: FloatMap,
    fringes: Fringes,
    modulation: FloatMap | None,
    lines: bool,
) -> BoolMap:
    """Pixels within reach of a depth step, and of unmeasured pixels where light is known."""
    if lines:
        return beside_steps(coordinate, **fringes)
    rings: NDArray[np.uint8] = np.empty(coordinate.shape, np.uint8)
    steps: _core._EdgeSteps = {"most": step_px(fringes), "repeats": fringes["repeats_px"]}
    _core.edge_rings(coordinate, sigma, steps, rings)
    found: BoolMap = rings > 0
    if modulation is not None:
        found |= _widened(np.isnan(coordinate), lines, RINGS)
    return found


def _widened(chosen: BoolMap, lines: bool, reach_px: int = BESIDE_PX) -> BoolMap:
    """The pixels within reach of the chosen ones along rows, and columns where these are known."""
    found = chosen.copy()
    for k in range(1, reach_px + 1):
        found[:, k:] |= chosen[:, :-k]
        found[:, :-k] |= chosen[:, k:]
        if not lines:
            found[k:] |= chosen[:-k]
            found[:-k] |= chosen[k:]
    return found


class _Behind(NamedTuple):
    """What is behind pixels on one side, by the distance in px."""

    rise: dict[int, NDArray[np.float64]]
    sigma: dict[int, NDArray[np.float64]]
    level: dict[int, NDArray[np.float64]]

    @classmethod
    def of(cls, map_: _Map, here: Indices, way: int, level: NDArray[np.float64]) -> _Behind:
        there = {k: here - k * way for k in range(1, max(map(max, BEHIND)) + 1)}
        return cls(
            {k: map_.rise(one, here) for k, one in there.items()},
            {k: map_.sigma[one] for k, one in there.items()},
            {k: level[one] for k, one in there.items()},
        )

    def residuals(
        self, own: NDArray[np.float64], behind: range
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distances of pixels of variance ``own`` from what some pixels behind them extrapolate to,
        and their variances."""
        order = 3 if len(behind) >= CURVED else 2
        weights = np.linalg.pinv(np.vander(behind, order, increasing=True))[0]
        residual, noise = np.zeros(own.size), own.copy()
        for distance, weight in zip(behind, weights, strict=True):
            residual -= weight * self.rise[distance]
            noise += (weight * self.sigma[distance]) ** 2
        return residual, noise

    def worst(self, behind: range) -> NDArray[np.float64]:
        """The largest level of some pixels behind; NaN where one is unknown."""
        worst = self.level[behind[0]]
        for k in behind[1:]:
            worst = np.maximum(worst, self.level[k])
        return worst


def _cleaner(
    map_: _Map, here: Indices, way: int, most: float, level: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distances of pixels from what one of both sides along an axis extrapolates to, the less mixed
    one, and their variances; NaN where neither side tells."""
    chosen, variance = np.full((2, here.size), np.nan)
    least, own = np.full(here.size, np.inf), map_.sigma[here] ** 2
    for side in (way, -way):
        there = _Behind.of(map_, here, side, level)
        residual, noise, mixed = np.full((3, here.size), np.nan)
        for behind in BEHIND:
            seen, by_noise = there.residuals(own, behind)
            with np.errstate(invalid="ignore"):
                good = np.abs(seen) < most
            np.copyto(residual, seen, where=good)
            np.copyto(noise, by_noise, where=good)
            np.copyto(mixed, there.worst(behind), where=good)
        with np.errstate(invalid="ignore"):
            better = mixed < least
        np.copyto(chosen, residual, where=better)
        np.copyto(variance, noise, where=better)
        np.copyto(least, mixed, where=better)
    return chosen, variance


def _shrunk(
    residual: NDArray[np.float64], noise: NDArray[np.float64], group: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Mean square errors, group by group; those without a residual have the mean of their group.
    Groups of too few join the one before."""
    mean, second = 0.0, np.zeros(residual.size)
    for number in np.unique(group):
        mine = group == number
        told = mine & np.isfinite(residual)
        if np.count_nonzero(told) >= FEWEST:
            second[told], mean = mean_square_errors(residual[told], noise[told])
            mine &= ~told
        second[mine] = mean
    return second


def _shift_by_blur(
    coordinate: FloatMap, sigma: FloatMap, modulation: FloatMap, fringes: Fringes, lines: bool
) -> tuple[FloatMap, FloatMap]:
    """Shift of every pixel by one more blur of the fringes, and its standard deviation by noise."""
    per_px = TURN / fringes["period_px"]
    width = (0.0, BLUR_PX) if lines else (BLUR_PX, BLUR_PX)
    known = np.isfinite(coordinate) & np.isfinite(modulation)
    turn = np.where(known, np.float32(per_px) * (coordinate % fringes["period_px"]), 0.0)
    light = np.where(known, modulation, 0.0).astype(np.float32)
    c, s = np.cos(turn), np.sin(turn)
    real, imaginary = (scipy.ndimage.gaussian_filter(light * part, width) for part in (c, s))
    shift = np.arctan2(imaginary * c - real * s, real * c + imaginary * s) / np.float32(per_px)
    weights = scipy.ndimage.gaussian_filter(_impulse(), width)
    weights[weights.shape[0] // 2, weights.shape[1] // 2] -= 1.0
    noise = sigma * np.float32(np.sum(weights**2) ** 0.5)
    return np.where(known, shift, np.float32(0.0)), noise


def _impulse() -> FloatMap:
    """One lit pixel in the middle of a dark map."""
    side = 1 + 2 * int(np.ceil(4.0 * BLUR_PX))
    impulse = np.zeros((side, side))
    impulse[side // 2, side // 2] = 1.0
    return impulse
