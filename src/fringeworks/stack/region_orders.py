"""Fringe orders of whole regions of a surface.

Light between surfaces, a response or defocus shift the phases of wide fringes by smooth amounts
that no average over a few neighbours takes out. The finest fringes are hardly shifted. Unwrapped
over a region without steps, they leave one whole number of their periods unknown, on which the
phases of all its pixels decide together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks._lazy import scipy
from fringeworks.patterns.order_chain import TURN, order_chain
from fringeworks.stack.frames import Planes, in_bands
from fringeworks.stack.kernel_settings import Decoding, Limits, empty_maps
from fringeworks.stack.neighbours import ERROR_RATE
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import BoolMap, CameraNoise, FloatMap, Reason
from fringeworks.types.computed import cached_property

STEEPEST = 0.25
"""Largest difference of neighbouring coordinates on one surface, in periods of the finest fringes:
half of that at which unwrapping goes wrong. Pixels beside larger ones are in no region."""

MIN_REGION = 200
"""Smallest number of pixels of a region: those of a few windows that errors are averaged in."""

BLOCK = 16
"""Side of the blocks, px, by whose means the errors of a region are compared: larger than what
noise or edges correlate over."""

SHARED_RAD = 0.05
"""Error of wide fringes that all parts of a region usually share at least, rad."""

SHARED = 0.3
"""Error that all parts of a region share, over the standard deviation of what they do not share:
half of that in a corner of white walls. The error of the nearest order is added to it."""

WINDOW = 5
"""Side of the window, px, whose mean must fit the order of its region as a pixel does: parts of
another depth stand out in it, by less noise."""


@dataclass(frozen=True)
class _Unwrapped:
    """The finest fringes, unwrapped over regions without steps."""

    place: FloatMap
    """(h, w): coordinates, up to whole periods that all pixels of a region share, px."""
    region: NDArray[np.uint32]
    """(h, w): number of the region, from the largest, 1, on; 0 beside steps."""
    sigma: FloatMap
    """(h, w): standard deviation of the coordinates, px."""


@dataclass(frozen=True)
class _Region:
    """What the other sets show at the pixels of a region, beside the unwrapped fringes."""

    pixels: NDArray[np.intp]
    """(n,): indices of the pixels."""
    middle: FloatMap
    """(M,): phases of the sets less those of the coordinates, mean, turns."""
    off: FloatMap
    """(M, n): the same of every pixel, about the mean, turns."""
    noise: FloatMap
    """(M,): variances of the phases by noise, turns²: by what neighbouring pixels do not share."""

    @property
    def smooth(self) -> FloatMap:
        """(M,): variances of the errors beside noise, turns²."""
        return np.asarray(np.maximum(self.off.var(axis=1) - self.noise, 0.0))

    @property
    def typical(self) -> FloatMap:
        """(M,): the same by the middle of the errors, whatever parts at another depth have."""
        off = np.abs(self.off - np.median(self.off, axis=1, keepdims=True))
        variance = (np.median(off, axis=1) / NORMAL_MEDIAN) ** 2
        return np.asarray(np.clip(variance - self.noise, 0.0, self.smooth))

    def of_mean(self, width: int, usual: FloatMap) -> FloatMap:
        """(M,): variances of the mean errors before they are known, turns²; ``usual``: those of the
        errors of all regions."""
        parts = [_parts(row - row.mean(), self.pixels, width) for row in self.off]
        beside = np.maximum(usual - self.typical, 0.0)  # that a small region does not show
        shared = SHARED**2 * np.maximum(usual, self.typical)
        shared = np.maximum(shared, (SHARED_RAD / TURN) ** 2)
        return np.asarray(self.smooth / parts + beside + shared + self.noise / self.pixels.size)


@dataclass(frozen=True)
class Regions:
    """The regions of an image, and what their phases show."""

    decoding: Decoding
    finest: int
    """Number of the set of the finest fringes."""
    unwrapped: _Unwrapped
    found: list[_Region]
    """The regions, from the largest on; not none."""

    @cached_property
    def usual(self) -> FloatMap:
        """(M,): variances of the errors beside noise in all regions, turns²."""
        pixels = [found.pixels.size for found in self.found]
        return np.average([found.typical for found in self.found], axis=0, weights=pixels)

    @property
    def spread(self) -> FloatMap:
        """(R,): standard deviations of the errors of the roundings beside noise, turns: by the
        means of blocks, most of which lie on one surface.

        Surfaces in one region differ by whole turns where the finest fringes do not show the step
        between them: that is no error of a rounding, so that deviations count modulo one turn.
        Smooth errors of more than that are spread evenly over it, which is 0.37.
        """
        chain = self.decoding.chain
        assert chain is not None
        rows = np.delete(chain.amplification, self.finest, axis=1)
        width, off = self.unwrapped.place.shape[1], []
        for found in self.found:
            of_sets = [_blocks(row, found.pixels, width) for row in found.off]
            turns = rows @ np.stack([means[full] for means, full in of_sets])
            if not turns.size:
                continue  # a region of less than a block
            mean = np.exp(1j * TURN * turns).mean(axis=1, keepdims=True)
            beside = turns - np.angle(mean) / TURN
            off.append(np.abs(beside - np.rint(beside)))
        if not off:
            return np.zeros(len(rows))
        return np.asarray(np.median(np.concatenate(off, axis=1), axis=1) / NORMAL_MEDIAN)


def regions_of(
    decoding: Decoding,
    planes: Planes,
    results: dict[str, Any],
    known: tuple[CameraNoise, Limits],
) -> Regions | None:
    """Regions of smooth surfaces, and what their phases show; None where there is none.

    Parameters
    ----------
    decoding : Decoding
        Of several sets without a Gray code.
    planes : (h, w) arrays in the order of ``decoding``, counts
    results : the kernel's maps, with those of ``maps_of_votes``
    known : noise of the camera and limits
    """
    if not decoding.absolute:
        return None
    finest = min(range(len(decoding.sets)), key=lambda k: decoding.sets[k].period_px)
    unwrapped = _unwrapped(decoding, finest, planes, known)
    if unwrapped is None:
        return None
    order = np.argsort(unwrapped.region, axis=None, kind="stable")
    starts = np.flatnonzero(np.diff(unwrapped.region.flat[order], prepend=0))
    parts = [p for p in np.split(order, starts)[1:] if p.size >= MIN_REGION]
    of_parts = [_region(decoding, finest, unwrapped, pixels, results) for pixels in parts]
    found = [region for region in of_parts if region.pixels.size >= MIN_REGION]
    return Regions(decoding, finest, unwrapped, found) if found else None


def decide_by_regions(regions: Regions, results: dict[str, Any]) -> None:
    """Decide ambiguous orders of whole regions, in place.

    Notes
    -----
    With an order, the phases of set m are off by d_m turns in the mean of a region. The errors are
    smooth: the variance v_m of d_m is theirs over the number of parts of the region in which they
    are independent, by the correlation of the means of blocks. Added is what all parts may share:
    ``SHARED`` of what they do not share, what the errors of all regions exceed those of this one
    by, and d_m² of the most likely order. Another order is less likely by the exponential of half
    the difference of Σ d_m² / v_m. An order counts where all others together are less likely than
    ``ERROR_RATE``, at pixels whose own phases, and the mean of whose window, are nearer to it than
    to any other.
    """
    for found in regions.found:
        _decide(regions, found, results)


def _unwrapped(
    decoding: Decoding, finest: int, planes: Planes, known: tuple[CameraNoise, Limits]
) -> _Unwrapped | None:
    phases = decoding.sets[finest]
    period = phases.period_px
    alone = replace(
        decoding,
        sets=(phases,),
        chain=order_chain([period], (-0.5, period - 0.5), circular=True),
        length_px=period,
        absolute=False,
        order_errors=(),
        largest_remainders=(),
    )
    maps = empty_maps(planes[0].shape)
    own, kernel = [planes[decoding.frames.index(k)] for k in alone.frames], alone.kernel(*known)
    in_bands(own, maps, lambda part, into: _core.decode_frames(part, kernel, into))
    turns = maps["coordinate"] / np.float32(period)
    smooth = (maps["reason"] == Reason.OK) & ~_beside_steps(turns)
    if not smooth.any():
        return None
    phase = np.where(smooth, TURN * turns, 0.0).astype(np.float32)
    found, region = _core.unwrap_reliability(phase, smooth.view(np.uint8), None)
    place: FloatMap = found.astype(np.float64) * (period / TURN)
    return _Unwrapped(place, region, maps["sigma"])


def _beside_steps(turns: FloatMap) -> BoolMap:
    """Pixels whose coordinate differs from that of a neighbour by more than surfaces do."""
    beside = np.zeros(turns.shape, bool)
    for axis in (0, 1):
        with np.errstate(invalid="ignore"):
            steep = np.abs(_wrapped(np.diff(turns, axis=axis))) > STEEPEST
        for pair in ((0, 1), (1, 0)):
            beside |= np.pad(steep, [pair, (0, 0)] if axis == 0 else [(0, 0), pair])
    return beside


def _region(
    decoding: Decoding,
    finest: int,
    unwrapped: _Unwrapped,
    pixels: NDArray[np.intp],
    results: dict[str, Any],
) -> _Region:
    others = [k for k in range(len(decoding.sets)) if k != finest]
    periods = np.array([decoding.sets[k].period_px for k in others])
    turns = np.stack([results["phases"][k].flat[pixels] for k in others]) / TURN
    # Other sets may be saturated where the finest is not.
    known = np.isfinite(turns).all(axis=0)
    pixels, turns = pixels[known], turns[:, known]
    if pixels.size < MIN_REGION:
        return _Region(pixels, np.zeros(len(others)), turns, np.zeros(len(others)))
    off = turns - unwrapped.place.flat[pixels] / periods[:, None]
    middle = np.angle(np.mean(np.exp(1j * TURN * off), axis=1)) / TURN
    off = _wrapped(off - middle[:, None])
    # What neighbours do not share: errors that all sets have together count as noise elsewhere.
    apart = np.median(np.abs(np.diff(off, axis=1)), axis=1) / NORMAL_MEDIAN
    return _Region(pixels, middle, off, 0.5 * apart**2)


def _decide(regions: Regions, found: _Region, results: dict[str, Any]) -> None:
    """Decide the order of a region, and write it."""
    decoding, unwrapped = regions.decoding, regions.unwrapped
    place = unwrapped.place.flat[found.pixels]
    period = decoding.sets[regions.finest].period_px
    periods = np.array([s.period_px for k, s in enumerate(decoding.sets) if k != regions.finest])
    # Orders that leave half of the region in the range, and what each explains.
    lowest, highest = -0.5 - np.median(place), decoding.length_px - 0.5 - np.median(place)
    orders = np.arange(np.ceil(lowest / period), np.floor(highest / period) + 1.0)
    variance = found.of_mean(unwrapped.place.shape[1], regions.usual)
    best = _best(found, np.outer(orders, period / periods), variance)
    if best is None:
        return
    coordinate = place + orders[best] * period
    error = _wrapped(found.middle[:, None] + found.off - orders[best] * period / periods[:, None])
    steps = np.arange(1.0, np.ceil(decoding.length_px / period))
    apart = _wrapped(np.outer(steps, period / periods))
    fits = _nearest(found, error, apart, unwrapped.region.shape)
    fits &= (coordinate > -0.5) & (coordinate < decoding.length_px - 0.5)
    _write(found, fits, coordinate, unwrapped.sigma, results)


def _best(found: _Region, explained: FloatMap, variance: FloatMap) -> int | None:
    """Number of the only likely order; None where there are several.

    ``explained``: what every order makes of the phases, (K, M) turns; ``variance``: of the mean
    errors, (M,) turns².
    """
    mean = _wrapped(found.middle + found.off.mean(axis=1) - explained)
    # The nearest order says how large errors are that all parts share.
    nearest = int(np.argmin(np.sum(mean**2 / (found.smooth + found.noise), axis=1)))
    square = np.sum(mean**2 / (variance + mean[nearest] ** 2), axis=1)
    likely = np.exp(-0.5 * (square - square.min()))
    best = int(np.argmin(square))
    return best if likely.sum() - 1.0 < ERROR_RATE else None


def _nearest(
    found: _Region,
    error: FloatMap,
    apart: FloatMap,
    shape: tuple[int, int],
) -> BoolMap:
    """Pixels whose phases, and the mean of whose window, are nearer to their order than to others.

    ``error``: of the sets with that order, (M, n) turns; ``apart``: those of all other orders in
    place of it, (K, M) turns.
    """
    # Windows in the part of the frame that the region lies in, and what they reach beyond it.
    at = np.divmod(found.pixels, shape[1])
    reach = WINDOW // 2
    first = [max(0, int(v.min()) - reach) for v in at]
    end = [min(most, int(v.max()) + reach + 1) for v, most in zip(at, shape, strict=True)]
    place = at[0] - first[0], at[1] - first[1]

    def around(values: FloatMap | float) -> FloatMap:
        inside = np.zeros(np.subtract(end, first), np.float32)
        inside[place] = values
        return np.asarray(scipy.ndimage.uniform_filter(inside, WINDOW)[place])

    share, fits = around(1.0), np.ones(found.pixels.size, bool)
    means = [around(row) / share for row in error]
    for off, count in ((error, 1.0), (np.stack(means), float(WINDOW**2))):
        fits &= _near(off, apart, found.smooth + found.noise / count, 0.5)
    return fits


def _near(off: FloatMap, apart: FloatMap, variance: FloatMap, share: float) -> BoolMap:
    """Whether errors of the sets are within a share of the distance to the nearest other order."""
    nearest = np.min(np.sum(apart**2 / variance, axis=1), initial=np.inf)
    return np.asarray(np.sum(off**2 / variance[:, None], axis=0) < share**2 * nearest)


def _write(
    found: _Region,
    fits: BoolMap,
    coordinate: FloatMap,
    sigma: FloatMap,
    results: dict[str, Any],
) -> None:
    """Write the coordinates of a region that fit its order, where orders were ambiguous."""
    fits = fits & (results["reason"].flat[found.pixels] == Reason.ORDER_AMBIGUOUS)
    at = found.pixels[fits]
    results["coordinate"].flat[at] = coordinate[fits]
    results["sigma"].flat[at] = sigma.flat[at]
    results["reason"].flat[at] = Reason.OK


def _blocks(error: FloatMap, pixels: NDArray[np.intp], width: int) -> tuple[FloatMap, BoolMap]:
    """Means of the errors in blocks of the image, and the blocks that a region fills by half."""
    rows, columns = np.divmod(pixels, width)
    rows, columns = (rows - rows.min()) // BLOCK, (columns - columns.min()) // BLOCK
    shape = int(rows.max()) + 1, int(columns.max()) + 1
    at = rows * shape[1] + columns
    count = np.bincount(at, minlength=shape[0] * shape[1]).reshape(shape)
    sums = np.bincount(at, error, shape[0] * shape[1]).reshape(shape)
    full = count > BLOCK**2 // 2
    means = np.where(full, sums / np.maximum(count, 1), 0.0)
    return means, full


def _parts(error: FloatMap, pixels: NDArray[np.intp], width: int) -> float:
    """Number of parts of a region in which errors of mean zero are independent, at least one."""
    means, full = _blocks(error, pixels, width)
    blocks, power = int(np.count_nonzero(full)), float(np.sum(means**2))
    if blocks < 2 or power == 0.0:
        return 1.0
    parts = float(blocks)
    for axis in (0, 1):
        parts /= 1.0 + 2.0 * _correlation(means, full, axis, power / blocks)
    return max(parts, 1.0)


def _correlation(means: FloatMap, full: BoolMap, axis: int, variance: float) -> float:
    """Sum of the correlations of blocks over their distance along an axis, up to the first one that
    is not positive."""
    total = 0.0
    means, full = np.moveaxis(means, axis, 0), np.moveaxis(full, axis, 0)
    for lag in range(1, len(means)):
        pairs = int(np.count_nonzero(full[lag:] & full[:-lag]))
        correlation = float(np.sum(means[lag:] * means[:-lag])) / max(pairs, 1) / variance
        if correlation <= 0.0:
            break
        total += correlation
    return total


def _wrapped(turns: FloatMap) -> FloatMap:
    return np.asarray(turns - np.rint(turns))
