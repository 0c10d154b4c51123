"""The measured points of an area, and how errors of their values add up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial
from threading import RLock
from typing import Any, NamedTuple, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.evaluate.shares import Share, Shares, scaled
from fringeworks.evaluate.tolerances.neighbours import Neighbours, neighbours
from fringeworks.rig.point_errors import point_errors
from fringeworks.surface.section import organised_points, places
from fringeworks.types import (
    Area,
    BoolMap,
    FloatMap,
    HeightMap,
    InputError,
    PointCloud,
    Reason,
    Rig,
)

PATCHES = 3
"""Patches along each side of an area. Common errors within a patch are fully correlated, and those
of different patches independent. Fits of bodies use the same model: calibration errors change over
a third of a body's size or more."""
CELLS = 8
"""Cells along each side of an area, for errors of the calibration: within an eighth of it they
change by little."""
MIN_POINTS = 10
"""Points that an area needs: as a fit does."""

Known = TypeVar("Known")


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
    blur: FloatMap
    """What the camera's blur leaves, with its sign: one error that all points of all areas have in
    common, times this, (n,), mm."""
    patch: NDArray[np.int64]
    """Number of each point's patch, (n,)."""
    pieces: Callable[[], FloatMap]
    """Computes ``size_mm2``, which few quantities need."""
    wanted: int
    """Number of pixels of the area."""
    up: FloatMap
    """Direction towards the camera, (3,)."""
    cell: NDArray[np.int64]
    """Number of each point's cell, (n,): calibration errors are alike within one."""
    inner: BoolMap
    """False beside pixels without a value, which may share their light, (n,)."""
    by_rig: FloatMap | None
    """Errors of each cell's points that the rig's covariance stands for, (cells, 3, k), mm: k
    independent parts, which all areas have in common. None where no covariance is known: the
    common errors of patches then count."""
    scales: Shares = field(default=(), kw_only=True)
    """Stated errors of the scale of all points, such as by temperature: the source of each, its
    standard deviation, relative, and the degrees of freedom of that."""
    still: FloatMap | float = field(default=0.0, kw_only=True)
    """Point that such an error does not move, (3,), mm; quantities of points alone do not depend
    on it."""
    pixel: NDArray[np.intp] | None = field(default=None, kw_only=True)
    """Row and column of each point, (n, 2): neighbours may share noise. None where unknown."""
    known: dict[str, Any] = field(default_factory=dict, init=False, repr=False)
    """What was computed of these points, by its name; see ``once``."""
    computing: AbstractContextManager[Any] = field(
        default_factory=RLock, init=False, repr=False, compare=False
    )
    """Held while that is computed: quantities that need the same wait for it."""

    @property
    def size_mm2(self) -> FloatMap:
        """Size of each pixel's piece of surface, as a vector along its normal, (n, 3), mm²; NaN
        beside pixels without a value."""
        return self.pieces()

    @property
    def share(self) -> float:
        """Share of the area's pixels that have a value, 0…1."""
        return len(self.points) / self.wanted

    @property
    def shared(self) -> Neighbours | None:
        """Noise that neighbouring points share, as their heights towards the camera tell it."""
        if self.pixel is None or not self.noise[self.inner].all():
            return None
        found: Neighbours | None = self.once("shared noise", _shared)
        return found

    def like_noise_at(
        self, some: NDArray[np.intp]
    ) -> Callable[[np.random.Generator], FloatMap] | None:
        """Return a function that draws numbers of variance 1 for some points (m,), as alike in
        neighbours as noise is; None where noise is independent."""
        shared, pixel = self.shared, self.pixel
        if shared is None or pixel is None:
            return None
        return lambda random: shared.draw(pixel[some], random)

    @property
    def sigma(self) -> FloatMap:
        """Whole standard deviation, (n,), mm."""
        return np.sqrt(self.noise**2 + self.common**2 + self.blur**2)

    @property
    def weights(self) -> FloatMap:
        """Factors of the points' distances in a fit, (n,): where blur was removed, pixels beside
        the end of a surface count less. All points count alike otherwise, as VDI/VDE 2634 asks."""
        if not self.blur.any() or not self.noise.all():
            return np.ones(len(self.noise))
        sigma = np.hypot(self.noise, self.blur)
        return np.asarray(np.median(sigma) / sigma)

    def once(self, name: str, compute: Callable[[Self], Known]) -> Known:
        """Compute what several quantities need, such as a body through the points, only once.

        Raises
        ------
        InputError as ``compute`` does, each time.
        """
        with self.computing:
            if name not in self.known:
                try:
                    self.known[name] = compute(self)
                except InputError as problem:
                    self.known[name] = problem
            found = self.known[name]
        if isinstance(found, InputError):
            raise found
        return cast(Known, found)

    def without_noise(self) -> Self:
        """The same points, if they had no noise of their own."""
        return replace(self, noise=np.zeros_like(self.noise))

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


def shares_of(terms: Sequence[Term]) -> Shares:
    """Return the parts of the standard deviation of a quantity that is linear in its points.

    Notes
    -----
    Noise adds up as independent numbers, or as the correlation of neighbours tells. Errors of the
    calibration move all points of all areas together, as the rig's covariance tells; where none is
    known, those of a patch add up as one number, and patches are independent. What is left of the
    camera's blur is one number for all, and so is each stated error of the scale.
    """
    noise, neighbours, blur, scale = 0.0, 0.0, 0.0, 0.0
    by_rig: FloatMap | float = 0.0
    for area, weights, direction in terms:
        group, groups = area.patch, PATCHES**2
        if area.by_rig is not None:
            group, groups = area.cell, len(area.by_rig)
        errors = (area.by_value, area.noise, area.common, area.blur, group)
        held = [np.ascontiguousarray(a, np.float64) for a in (weights, direction)]
        own, along, sums = _core.error_sums(errors, held[0], held[1].reshape(-1, 3), groups)
        noise += own if area.shared is None else _alike(area, weights, direction)
        blur += along
        if area.scales:
            scale += float(weights @ _along(area.points - area.still, direction))
        if area.by_rig is None:
            neighbours += float(np.sum(sums[:, 0] ** 2))
        else:
            by_rig = by_rig + np.einsum("ck,ckj->j", sums[:, 1:], area.by_rig)
    stated = terms[0].area.scales if terms else ()
    return (
        Share("noise", float(np.sqrt(noise))),
        Share("neighbours", float(np.sqrt(neighbours))),
        Share("blur", abs(blur)),
        Share("calibration", float(np.sqrt(np.sum(np.square(by_rig))))),
        *scaled(stated, abs(scale)),
    )


def _alike(area: AreaPoints, weights: FloatMap, direction: FloatMap) -> float:
    """Variance of a quantity by noise that neighbours share."""
    assert area.shared is not None
    assert area.pixel is not None
    own = weights * _along(area.by_value, direction) * area.noise
    return area.shared.variance(area.pixel, own) * area.shared.factor


def _shared(area: AreaPoints) -> Neighbours | None:
    """The noise that neighbouring points of an area share."""
    assert area.pixel is not None
    heights, inner = area.points @ area.up, area.inner
    noise = np.abs(area.by_value @ area.up) * area.noise
    if not noise[inner].all():
        return None
    return neighbours(area.pixel[inner], heights[inner], noise[inner])


def _along(vectors: FloatMap, direction: FloatMap) -> FloatMap:
    """Parts of vectors (n, 3) along one direction (3,) or one of each, (n,)."""
    if direction.ndim == 1:
        return np.asarray(vectors @ direction)
    return np.asarray(np.einsum("nc,nc->n", vectors, direction))


def area_points(
    surface: HeightMap | PointCloud,
    area: Area,
    rig: Rig | None = None,
    *,
    scales: Shares = (),
) -> AreaPoints:
    """Return the measured points of an area.

    Parameters
    ----------
    surface : HeightMap in mm with a pitch, or PointCloud
    area : Area
    rig : Rig, optional
        Rig that measured the cloud; ignored for height maps.
    scales : tuple of Share
        Stated errors of the scale, relative.

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
    noise, blur = np.zeros((2, len(sigma)))
    if isinstance(surface, PointCloud):
        noise = surface.noise_mm[rows, columns].astype(np.float64)
        if surface.blur_mm is not None:
            blur = surface.blur_mm[rows, columns].astype(np.float64)
    common = np.sqrt(np.maximum(sigma**2 - noise**2 - blur**2, 0.0))
    patch = PATCHES * _part(rows, PATCHES) + _part(columns, PATCHES)
    cell, by_rig = patch, None
    if rig is not None and isinstance(surface, PointCloud):
        cell = CELLS * _part(rows, CELLS) + _part(columns, CELLS)
        # Cells without points have no number.
        cell = (np.cumsum(np.bincount(cell) > 0) - 1)[cell]
        count = np.bincount(cell)
        middles = [np.bincount(cell, spatial.points[:, k]) / count for k in range(3)]
        by_rig = point_errors(rig, np.stack(middles, axis=-1), surface)
    return AreaPoints(
        spatial.points,
        spatial.by_value,
        noise,
        common,
        blur,
        patch,
        partial(_pieces, surface, rows, columns),
        int(wanted.sum()),
        spatial.up,
        cell,
        _inner(surface, rows, columns),
        by_rig,
        scales=scales,
        pixel=np.stack((rows, columns), axis=-1),
    )


def _inner(
    surface: HeightMap | PointCloud, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> BoolMap:
    """Mark pixels of which all neighbours have a value; all, where too few of them do."""
    around, rows, columns = _around(rows, columns)
    missing = surface.reason[around] != Reason.OK
    for axis in range(2):
        beside, others = np.swapaxes(missing.copy(), 0, axis), np.swapaxes(missing, 0, axis)
        beside[1:] |= others[:-1]
        beside[:-1] |= others[1:]
        missing = np.swapaxes(beside, 0, axis)
    inner = ~missing[rows, columns]
    return np.asarray(inner if np.count_nonzero(inner) >= MIN_POINTS else inner | True)


def _around(
    rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> tuple[tuple[slice, slice], NDArray[np.int64], NDArray[np.int64]]:
    """The part of a frame that holds pixels and their neighbours, and where they are in it."""
    top, left = (max(int(place.min()) - 1, 0) for place in (rows, columns))
    bottom, right = (int(place.max()) + 2 for place in (rows, columns))
    return (slice(top, bottom), slice(left, right)), rows - top, columns - left


def noise_along(part: AreaPoints, direction: FloatMap) -> FloatMap:
    """Return the standard deviation of each point along a direction, (n,), mm, that is not common
    to its neighbours; all of it, where the rig does not say which part is."""
    sigma = part.sigma if part.by_rig is None else part.noise
    return np.asarray(np.abs(_along(part.by_value, direction)) * sigma)


def _part(place: NDArray[np.int64], parts: int) -> NDArray[np.int64]:
    """Which of so many parts of the range each number lies in, from 0 on."""
    low, count = int(place.min()), int(np.ptp(place)) + 1
    return np.asarray((np.arange(count) * parts // count)[place - low], np.int64)


def _pieces(
    surface: HeightMap | PointCloud, rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> FloatMap:
    """Piece of surface that each pixel stands for, (n, 3), mm² along its normal."""
    around, rows, columns = _around(rows, columns)
    part = surface.reason[around]
    if isinstance(surface, PointCloud):
        points: FloatMap = surface.xyz_mm[around].astype(np.float64)
    else:
        points = np.asarray(organised_points(surface)[around], np.float64)
    points[part != Reason.OK] = np.nan
    along_x, along_y = (_slope(points, axis) for axis in (1, 0))
    return np.asarray(np.cross(along_x, along_y)[rows, columns])


def _slope(points: FloatMap, axis: int) -> FloatMap:
    """Difference to the next pixel along an axis: central, or one-sided at gaps and borders."""
    found = np.full_like(points, np.nan)
    slope, step = (np.moveaxis(one, axis, 0) for one in (found, np.diff(points, axis=axis)))
    if len(step):
        slope[0], slope[-1] = step[0], step[-1]
        slope[1:-1] = 0.5 * (step[1:] + step[:-1])
        at = np.nonzero(~np.isfinite(slope[1:-1]))
        after, before = step[1:][at], step[:-1][at]
        slope[1:-1][at] = np.where(np.isfinite(after), after, before)
    return found
