"""Matching of cameras: where another camera decodes the same projector coordinate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
import scipy

from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.types import Axis, BoolMap, CoordinateMap, Decoded, FloatMap

SPLINE_ORDER = 5
"""Order of the splines by which coordinates are read between pixels. A ripple of four pixels, as
three steps with γ = 2.2 make it on the virtual rig, is read with an error of 3 % by quintic
splines; cubic ones leave 10 %."""
SLOPE_HALF_PX = 2
"""Half side of the window from which the slope of the coordinates is taken, px: noise matters
little, and a smooth surface is straight over five pixels."""
EDGE_PX = 4.0
"""Second difference of neighbouring coordinates from which on there is an edge, projector px. Noise
and ripple stay below 2 px where anything can be measured."""
STEP_SIGMAS = 4.0
"""Second differences of both signs within three pixels from which on there is a step, in their
standard deviations. Noise reaches it at one of 10⁵ pixels; a crease has one sign."""
STEP_LAGS = (1, 2)
"""Distances of the two signs, px: a step between pixels, and one with a mixed pixel on it."""
MARGIN_PX = 3
"""Pixels around an edge or a gap in which nothing is matched: no local interpolation has all its
pixels on one surface there."""
RINGING_PX = 12
"""Pixels around an edge in which a local interpolation takes the place of the splines. Splines of
order 5 ring with a factor of 0.43 from pixel to pixel: 0.2 px of a jump of 30 px are left after
four pixels, and less than 1e-3 px after twelve."""
LOCAL_PX = np.arange(-2.0, 4.0)
"""Pixels of the local interpolation along each axis, from the one before a place; no more, so that
``MARGIN_PX`` is enough."""
RIPPLE_PX = 4.0
"""Period of the ripple that the local interpolation reads exactly, px; it reads cubics exactly as
well. Waves of 5 px are read to 1 %."""
PAIRS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Row and column offsets of one of two opposite neighbours."""
AGREEING_SIGMAS = 4.0
"""Largest deviation of the means of opposite neighbours from each other, in standard deviations,
where a missing pixel between them is filled: noise exceeds it once in 10⁴ pixels."""
MATCH_STEPS = 12
"""Largest number of steps to a match. They use the slope of the surface without its ripple, so a
ripple slows them down: with γ = 2.2 and three steps each step leaves up to 60 % of the error."""
LONGEST_STEP_PX = 2.0
"""Largest step, camera px, so that a wrong slope does not lead away from the surface."""
MATCHED_PX = 2e-3
"""Largest difference of the coordinates of a match, projector px: a tenth of the noise of good
fringes."""
ENERGY_PLACES = 64
"""Places between two pixels at which the noise of a spline is tabulated."""


@dataclass(frozen=True, eq=False)
class CoordinateField:
    """Projector coordinates of one camera, to be read between its pixels."""

    axes: tuple[Axis, ...]
    splines: tuple[FloatMap, ...]
    """Spline coefficients of each axis, (h, w)."""
    slopes: tuple[FloatMap, ...]
    """Derivative of each axis by column and row, (2, h, w), projector px per camera px."""
    variance: tuple[FloatMap, ...]
    """σ² of each axis, (h, w), px²."""
    usable: BoolMap
    """Pixels around which all coordinates are decoded and continuous, (h, w)."""
    values: tuple[FloatMap, ...] = ()
    """Coordinates of each axis, (h, w), px, with the nearest one where there is none."""
    ringing: BoolMap | None = None
    """Pixels at which the splines ring by a jump nearby, (h, w)."""

    @classmethod
    def of(cls, decoded: Decoded, axes: Sequence[Axis]) -> Self:
        """Prepare the coordinates of a camera along one axis or both."""
        maps = [_without_holes(decoded.maps[axis]) for axis in axes]
        known = np.logical_and.reduce([np.isfinite(q) for q, _ in maps])
        splines, slopes, variance, values = [], [], [], []
        edges = np.zeros(known.shape, bool)
        for coordinate, sigma in maps:
            filled = _filled(coordinate, known)
            edges |= _edges(filled) | _steps(filled, np.where(known, sigma, np.inf))
            values.append(filled)
            splines.append(scipy.ndimage.spline_filter(filled, SPLINE_ORDER, mode="nearest"))
            slopes.append(_slopes(filled))
            variance.append(np.where(known, sigma, np.inf) ** 2)
        square = np.ones((2 * MARGIN_PX + 1,) * 2, bool)
        usable = scipy.ndimage.binary_erosion(known & ~edges, square)
        ringing = scipy.ndimage.maximum_filter(edges, 2 * RINGING_PX + 1) & usable
        parts = (tuple(splines), tuple(slopes), tuple(variance))
        return cls(tuple(axes), *parts, usable, tuple(values), ringing)

    def at(self, pixels: FloatMap) -> FloatMap:
        """Coordinates at places (n, 2) in the frame, (n, axes), projector px."""
        inside = _inside(pixels, self.usable.shape)
        place = inside[:, ::-1].T
        found = np.stack(
            [
                scipy.ndimage.map_coordinates(
                    s, place, order=SPLINE_ORDER, mode="nearest", prefilter=False
                )
                for s in self.splines
            ],
            axis=-1,
        )
        if self.ringing is not None:
            column, row = np.rint(inside).astype(int).T
            near = self.ringing[row, column]
            found[near] = _local(self.values, inside[near])
        return found

    def slope_at(self, pixels: FloatMap) -> FloatMap:
        """Derivative of the coordinates by the pixel at places (n, 2), (n, axes, 2)."""
        place = _inside(pixels, self.usable.shape)[:, ::-1].T
        read = [
            [scipy.ndimage.map_coordinates(part, place, order=1, mode="nearest") for part in slope]
            for slope in self.slopes
        ]
        return np.asarray(np.moveaxis(np.array(read), -1, 0))

    def variance_at(self, pixels: FloatMap) -> FloatMap:
        """Variance of ``at`` by the noise of the pixels, (n, axes), px²."""
        place = _inside(pixels, self.usable.shape)
        column, row = np.rint(place).astype(int).T
        table = spline_energy()
        gain = np.ones(len(place))
        for part in (place % 1.0).T:
            gain *= table[np.rint(part * ENERGY_PLACES).astype(int)]
        return np.stack([v[row, column] * gain for v in self.variance], axis=-1)

    def usable_at(self, pixels: FloatMap) -> BoolMap:
        """Whether places (n, 2) lie in the frame, away from edges and gaps, (n,)."""
        h, w = self.usable.shape
        with np.errstate(invalid="ignore"):
            inside = ((pixels >= 0) & (pixels <= [w - 1, h - 1])).all(axis=1)
        column, row = np.rint(_inside(pixels, self.usable.shape)).astype(int).T
        return np.asarray(inside & self.usable[row, column])


def _local(values: Sequence[FloatMap], place: FloatMap) -> FloatMap:
    """Values at places (n, 2) from six pixels along each axis, (n, axes)."""
    h, w = values[0].shape
    first = np.clip(np.floor(place), 2, [w - 4, h - 4]).astype(int)
    (along_x, along_y), (x, y) = _local_weights(place - first).transpose(1, 0, 2), first.T
    found = np.zeros((len(place), len(values)))
    for i, dy in enumerate(LOCAL_PX.astype(int)):
        for j, dx in enumerate(LOCAL_PX.astype(int)):
            weight = along_y[:, i] * along_x[:, j]
            for k, one in enumerate(values):
                found[:, k] += weight * one[y + dy, x + dx]
    return found


def _local_weights(t: FloatMap) -> FloatMap:
    """Weights of ``LOCAL_PX`` at places t (...) after the first pixel, (..., 6)."""
    rate = 2.0 * np.pi / RIPPLE_PX

    def exact(x: FloatMap) -> FloatMap:
        return np.stack((x**0, x, x**2, x**3, np.cos(rate * x), np.sin(rate * x)), axis=-1)

    return np.asarray(np.linalg.solve(exact(LOCAL_PX).T, exact(t)[..., None])[..., 0])


def match(
    field: CoordinateField, goal_px: FloatMap, start_px: FloatMap, along: FloatMap | None = None
) -> tuple[FloatMap, BoolMap]:
    """Find the places in a camera's frame where it decodes given coordinates.

    Parameters
    ----------
    field : CoordinateField
        Of the other camera.
    goal_px : (n, axes) array
        Coordinates that are looked for, projector px.
    start_px : (n, 2) array
        Places near which they are, camera px.
    along : (n, 2) array, optional
        Direction in which to look, for a single axis.

    Returns
    -------
    Places (n, 2), px, and whether they are matches, (n,).
    """
    place = np.array(start_px)
    error = np.full(len(place), np.inf)
    active = np.flatnonzero(np.isfinite(place).all(axis=1))
    for _ in range(MATCH_STEPS):
        here = place[active]
        missing = goal_px[active] - field.at(here)
        error[active] = np.abs(missing).max(axis=1)
        with np.errstate(invalid="ignore"):
            moving = field.usable_at(here) & (error[active] > MATCHED_PX / 4.0)
        active, missing, here = active[moving], missing[moving], here[moving]
        if not len(active):
            break
        slope = field.slope_at(here)
        if along is None:
            step = _solved(slope, missing)
        else:
            rate = np.einsum("nk,nk->n", slope[:, 0], along[active])
            with np.errstate(all="ignore"):
                step = (missing[:, 0] / rate)[:, None] * along[active]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        with np.errstate(all="ignore"):
            step = step * np.minimum(1.0, LONGEST_STEP_PX / length)
        place[active] += np.nan_to_num(step)
    found = np.isfinite(place).all(axis=1) & field.usable_at(place)
    return place, np.asarray(found & (error < MATCHED_PX))


def _solved(slope: FloatMap, missing: FloatMap) -> FloatMap:
    """Solve slope · step = missing for two axes."""
    (a, b), (c, d) = np.moveaxis(slope, 0, -1)
    x, y = missing.T
    with np.errstate(all="ignore"):
        step = np.stack((d * x - b * y, a * y - c * x), axis=-1) / (a * d - b * c)[:, None]
    return np.asarray(step)


@lru_cache
def spline_energy() -> FloatMap:
    """Variance of a value read by a spline between two pixels, over that of a pixel.

    Returns
    -------
    (65,) array, at places from one pixel to the next.
    """
    unit = np.zeros(64)
    unit[32] = 1.0
    coefficients = scipy.ndimage.spline_filter1d(unit, SPLINE_ORDER)
    t = np.arange(ENERGY_PLACES + 1) / ENERGY_PLACES
    shifts = np.arange(-16, 17)
    place = 32.0 + shifts[:, None] + t
    weight = scipy.ndimage.map_coordinates(
        coefficients, [place.ravel()], order=SPLINE_ORDER, prefilter=False
    )
    return np.asarray(np.sum(weight.reshape(place.shape) ** 2, axis=0))


def _inside(pixels: FloatMap, shape: tuple[int, ...]) -> FloatMap:
    """Places moved into the frame; NaN to its first pixel."""
    h, w = shape
    return np.asarray(np.clip(np.nan_to_num(pixels), 0.0, [w - 1.0, h - 1.0]))


def _filled(values: FloatMap, known: BoolMap) -> FloatMap:
    """The values, with the nearest known one where there is none."""
    if not known.any():
        return np.zeros(values.shape)
    nearest = scipy.ndimage.distance_transform_edt(
        ~known, return_distances=False, return_indices=True
    )
    return np.asarray(values[tuple(nearest)], np.float64)


def _without_holes(found: CoordinateMap) -> tuple[FloatMap, FloatMap]:
    """Coordinates and their σ, with single missing pixels filled from pairs of opposite neighbours.

    A pixel is filled where the means of two pairs or more agree within their σ. At a step they
    differ.
    """
    q, sigma = found.coordinate_px.astype(np.float64), found.sigma_px.astype(np.float64)
    row, column = np.nonzero(~np.isfinite(q))
    padded, squares = np.pad(q, 1, constant_values=np.nan), np.pad(sigma**2, 1)
    mean, variance = np.empty((2, len(PAIRS), len(row)))
    for k, (dy, dx) in enumerate(PAIRS):
        one = row + 1 + dy, column + 1 + dx
        other = row + 1 - dy, column + 1 - dx
        mean[k] = 0.5 * (padded[one] + padded[other])
        variance[k] = 0.25 * (squares[one] + squares[other])
    known = np.isfinite(mean)
    count = known.sum(axis=0)
    middle = np.where(known, mean, 0.0).sum(axis=0) / np.maximum(count, 1)
    variance = np.where(known, variance, 0.0)
    limit = AGREEING_SIGMAS * np.sqrt(variance.sum(axis=0) / np.maximum(count, 1))
    agree = (np.where(known, np.abs(mean - middle), 0.0) <= limit).all(axis=0)
    good = (count > 1) & agree
    place = row[good], column[good]
    # Twice the variance of a pair's mean is that of a pixel.
    sigma[place] = np.sqrt(2.0 * variance.sum(axis=0)[good] / count[good])
    q[place] = middle[good]
    return q, sigma


def _edges(values: FloatMap) -> BoolMap:
    """Pixels with a step to one of their neighbours."""
    found = np.zeros(values.shape, bool)
    for axis in (0, 1):
        second = np.abs(scipy.ndimage.correlate1d(values, [1.0, -2.0, 1.0], axis, mode="nearest"))
        found |= second > EDGE_PX
    return found


def _steps(values: FloatMap, sigma: FloatMap) -> BoolMap:
    """Pixels beside a step of the values that noise does not explain.

    The second differences are compared with their own scatter where that is larger than noise, so
    that a ripple of the projector is no step.
    """
    found = np.zeros(values.shape, bool)
    for axis in (0, 1):
        second = scipy.ndimage.correlate1d(values, [1.0, -2.0, 1.0], axis, mode="nearest")
        variance = scipy.ndimage.correlate1d(
            np.minimum(sigma.astype(np.float64), EDGE_PX) ** 2, [1.0, 4.0, 1.0], axis
        )
        with np.errstate(all="ignore"):
            ratio = np.where(np.isfinite(sigma) & (variance > 0), second / np.sqrt(variance), 0.0)
        some = ratio[ratio != 0]
        if not some.size:
            continue
        limit = STEP_SIGMAS * max(robust_sigma(some), 1.0)
        ratio = np.moveaxis(ratio, axis, 0)
        steps = np.moveaxis(found, axis, 0)
        for lag in STEP_LAGS:
            one, other = ratio[:-lag], ratio[lag:]
            both = (one * other < 0) & (np.minimum(np.abs(one), np.abs(other)) > limit)
            steps[:-lag] |= both
            steps[lag:] |= both
    return found


def _slopes(values: FloatMap) -> FloatMap:
    """Derivative by column and row, of planes fitted in square windows, (2, h, w)."""
    n = 2 * SLOPE_HALF_PX + 1
    lever = np.arange(-SLOPE_HALF_PX, SLOPE_HALF_PX + 1.0)
    mean = np.full(n, 1.0 / n)
    tilt = lever / np.sum(lever**2)

    def filtered(along: int) -> FloatMap:
        kept = scipy.ndimage.correlate1d(values, mean, 1 - along, mode="nearest")
        return np.asarray(scipy.ndimage.correlate1d(kept, tilt, along, mode="nearest"))

    return np.stack((filtered(1), filtered(0)))
