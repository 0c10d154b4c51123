"""The measured points of an area, and how errors of their values add up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.surface.section import places
from fringeworks.types import Area, FloatMap, HeightMap, InputError, PointCloud, Reason

PATCHES = 3
"""Patches along each side of an area. Common errors within a patch are fully correlated, and those
of different patches independent. Fits of bodies use the same model: calibration errors change over
a third of a body's size or more."""
MIN_POINTS = 10
"""Points that an area needs: as a fit does."""


@dataclass(frozen=True)
class AreaPoints:
    """The points of an area; those that were not measured are left out."""

    points: FloatMap
    """(n, 3), mm."""
    by_value: FloatMap
    """Derivative of a point by its measured value, (n, 3)."""
    noise: FloatMap
    """Standard deviation of the value that is independent from pixel to pixel, (n,), mm."""
    common: FloatMap
    """Standard deviation that neighbours have in common, (n,), mm."""
    patch: NDArray[np.int64]
    """Number of each point's patch, (n,)."""
    size_mm2: FloatMap
    """Size of each pixel's piece of surface, as a vector along its normal, (n, 3), mm²; NaN beside
    pixels without a value."""
    wanted: int
    """Number of pixels of the area."""
    up: FloatMap
    """Direction towards the camera, (3,)."""

    @property
    def share(self) -> float:
        """Share of the area's pixels that have a value, 0…1."""
        return len(self.points) / self.wanted

    @property
    def sigma(self) -> FloatMap:
        """Whole standard deviation, (n,), mm."""
        return np.hypot(self.noise, self.common)

    @property
    def middle(self) -> FloatMap:
        """Mean of the points, (3,), mm."""
        return np.asarray(self.points.mean(axis=0))


class Term(NamedTuple):
    """How the points of an area enter a quantity."""

    area: AreaPoints
    weights: FloatMap
    """Derivative of the quantity by the displacement of each point along ``direction``, (n,)."""
    direction: FloatMap
    """(3,), or (n, 3) for a direction of each point; of length 1."""


def sigma_of(terms: Sequence[Term]) -> float:
    """Return the standard deviation of a quantity that changes linearly with its points.

    Notes
    -----
    Noise adds up as independent numbers. The common errors of a patch add up as one number.
    """
    variance = 0.0
    for area, weights, direction in terms:
        change = weights * np.sum(area.by_value * direction, axis=1)
        variance += float(np.sum((change * area.noise) ** 2))
        patches = np.bincount(area.patch, change * area.common)
        variance += float(np.sum(patches**2))
    return float(np.sqrt(variance))


def area_points(surface: HeightMap | PointCloud, area: Area) -> AreaPoints:
    """Return the measured points of an area.

    Parameters
    ----------
    surface : HeightMap in mm with a pitch, or PointCloud
    area : Area

    Raises
    ------
    InputError for a surface in px, and an area with fewer than ten measured pixels.

    Notes
    -----
    Height maps do not say which part of their σ neighbours have in common: all of it counts so.
    """
    wanted = area.pixels(surface.shape)
    rows, columns = np.nonzero(wanted & (surface.reason == Reason.OK))
    if len(rows) < MIN_POINTS:
        raise InputError(
            f"area: expected {MIN_POINTS} measured pixels or more, got {len(rows)} of "
            f"{int(wanted.sum())}"
        )
    spatial = places(surface, rows, columns)
    sigma = spatial.sigma
    noise = np.zeros(len(sigma))
    if isinstance(surface, PointCloud):
        noise = surface.noise_mm[rows, columns].astype(np.float64)
    common = np.sqrt(np.maximum(sigma**2 - noise**2, 0.0))
    patch = PATCHES * _third(rows) + _third(columns)
    return AreaPoints(
        spatial.points,
        spatial.by_value,
        noise,
        common,
        patch,
        _pieces(surface)[rows, columns],
        int(wanted.sum()),
        spatial.up,
    )


def _third(place: NDArray[np.int64]) -> NDArray[np.int64]:
    """Which third of the range each number lies in: 0, 1 or 2."""
    low, high = int(place.min()), int(place.max())
    return (place - low) * PATCHES // (high - low + 1)


def _pieces(surface: HeightMap | PointCloud) -> FloatMap:
    """Piece of surface that each pixel stands for, (h, w, 3), mm² along its normal."""
    rows, columns = np.mgrid[: surface.shape[0], : surface.shape[1]]
    points = places(surface, rows.ravel(), columns.ravel()).points.reshape(*surface.shape, 3)
    points = np.where((surface.reason == Reason.OK)[..., None], points, np.nan)
    along_x, along_y = (_slope(points, axis) for axis in (1, 0))
    return np.cross(along_x, along_y)


def _slope(points: FloatMap, axis: int) -> FloatMap:
    """Difference to the next pixel along an axis: central, or one-sided at gaps and borders."""
    step = np.diff(points, axis=axis)
    pad = [(0, 0)] * 3
    pad[axis] = (0, 1)
    after = np.pad(step, pad, constant_values=np.nan)
    pad[axis] = (1, 0)
    before = np.pad(step, pad, constant_values=np.nan)
    both = 0.5 * (after + before)
    return np.where(np.isfinite(both), both, np.where(np.isfinite(after), after, before))
