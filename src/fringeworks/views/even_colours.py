"""Brightness of views made alike: what light, incidence and exposure add to a surface's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.types import FloatMap
from fringeworks.views.surface_points import SurfacePoints

LEAST_SCATTER = 1e-3
"""Lower bound on the scatter: a thousandth of the brightness is below what frames show."""
MIN_COMPARED = 300
"""Smallest number of places that several views see, for a comparison: over ten times the
parameters."""
MOST_COMPARED = 30_000
"""Approximate largest number of places that are compared: the parameters are then known to far
better than a thousandth, and no more memory is taken than by a view."""
ROUNDS = 12
"""Rounds of Gauss–Newton steps with robust weights; the lamp's place settles in six to eight."""
HUBER_SIGMAS = 1.5
"""Residuals from which on a place counts less, in robust standard deviations: gloss and shadows are
seen by one view and not by another (Huber 1964)."""
LEAST_COSINE = 0.1
"""Lower bound on the cosine of incidence in the model: surfaces that the light grazes have no
brightness to compare."""
EXPECTED = (1.0, -2.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Expected factors of log cos and log distance, by the laws of Lambert and of distance, and of the
frame's x, y, x², x y and y²."""
UNSURE = (0.5, 1.0, 2.0, 2.0, 5.0, 5.0, 5.0)
"""Their standard deviations before the views are seen: bent responses change the first; light over
a frame of ±0.2 falls by a third or less."""
EXPOSURE = 1.0
"""The same of a view's constant."""
LAMP_MM = 300.0
"""The same of each coordinate of the lamp, from the camera, mm: baselines of desk rigs and more."""
FIRST_SCATTER = 0.1
"""Scatter of a place's brightness between views in the first round."""
LAMP = 3
"""Number of coordinates of the lamp's place."""


def even_colours(
    views: Sequence[SurfacePoints], index: NDArray[np.intp]
) -> NDArray[np.float64] | None:
    """Factors (n,) by which the colours of all points become those of one light.

    Parameters
    ----------
    views : sequence of SurfacePoints
        In camera coordinates, with colours, of one device.
    index : (n,) ints
        Place of every point of all views; points of one place show one part of the surface.

    Returns
    -------
    Factors, whose logarithms have the mean 0; None where too few places are seen by several views,
    and where the model does not make views more alike.

    Notes
    -----
    A matt surface of albedo a has the brightness b = a E. E depends on the exposure of the view, on
    incidence and distance of the lamp, and on the place in the frame, because the light is uneven.
    log E is linear in a constant for each view, in log cos, log distance, and in a quadratic
    polynomial over the frame; the lamp's place is estimated with them. All views share these, as
    they share the device. The differences of views at one place are free of a and determine them.
    """
    seen = _Compared.of(views, index)
    if seen is None:
        return None
    lamp: FloatMap = np.zeros(LAMP)
    weight: FloatMap = np.ones(len(seen.level))
    power, scatter = 1.0, FIRST_SCATTER
    found: FloatMap = np.zeros(0)
    unsure = np.array([*UNSURE, *[EXPOSURE] * len(views), *[LAMP_MM] * LAMP])
    constants = np.eye(len(views))[seen.view]
    for _ in range(ROUNDS):
        features, by_lamp = _features(seen.xyz_mm, seen.normals, lamp)
        rows = np.column_stack((features, constants, power * by_lamp))
        lit = features[:, 0] > np.log(LEAST_COSINE)
        expected = np.array([*EXPECTED, *np.zeros(len(views)), *-lamp])
        prior = expected, (scatter / unsure) ** 2
        found = _fitted(rows, seen.level, weight * lit, seen.place, prior)
        residual = _within(seen.level - rows @ found, weight * lit, seen.place)
        lamp, power = lamp + found[-LAMP:], float(found[0])
        scatter = max(float(robust_sigma(np.abs(residual[lit]))), LEAST_SCATTER)
        fair = HUBER_SIGMAS * scatter / np.maximum(np.abs(residual), np.finfo(float).tiny)
        weight = np.minimum(1.0, fair)
    before = robust_sigma(np.abs(_within(seen.level, weight * lit, seen.place)[lit]))
    if not scatter < before:
        return None
    light = np.concatenate(
        [
            _features(v.xyz_mm, v.normals, lamp)[0] @ found[: len(UNSURE)] + constant
            for v, constant in zip(views, found[len(UNSURE) : -LAMP], strict=True)
        ]
    )
    return np.asarray(np.exp(light.mean() - light))


@dataclass(frozen=True, eq=False)
class _Compared:
    """What single views see of places that several of them see, m values."""

    xyz_mm: FloatMap
    """Mean of the view's points, (m, 3), in camera coordinates."""
    normals: FloatMap
    """(m, 3)."""
    level: FloatMap
    """Logarithm of the brightness, (m,)."""
    view: NDArray[np.intp]
    place: NDArray[np.intp]

    @classmethod
    def of(cls, views: Sequence[SurfacePoints], index: NDArray[np.intp]) -> Self | None:
        """Means of every place by view; None where too few places are seen by several views."""
        ends = np.cumsum([len(v.xyz_mm) for v in views])[:-1]
        parts = []
        for k, (view, at) in enumerate(zip(views, np.split(index, ends), strict=True)):
            bright = _brightness(view)
            known = np.isfinite(bright)
            places, group = np.unique(at[known], return_inverse=True)
            number = np.bincount(group.ravel())
            values = np.column_stack((view.xyz_mm, view.normals, bright))[known]
            mean = [np.bincount(group.ravel(), column) / number for column in values.T]
            parts.append((np.column_stack(mean), np.full(len(places), k), places))
        means, view_of, place = (np.concatenate([part[i] for part in parts]) for i in range(3))
        several = np.bincount(place, minlength=int(index.max()) + 1)[place] > 1
        shared = np.unique(place[several])
        if len(shared) < MIN_COMPARED:
            return None
        some = shared[:: max(1, len(shared) // MOST_COMPARED)]
        kept = np.isin(place, some)
        number = np.searchsorted(some, place[kept])
        means = means[kept]
        return cls(means[:, :3], means[:, 3:6], means[:, 6], view_of[kept], number)


def _brightness(view: SurfacePoints) -> FloatMap:
    """Logarithm of the brightness, (n,); NaN where there is none."""
    assert view.colour is not None
    seen = view.colour if view.colour.ndim == 1 else view.colour.mean(axis=1)
    return np.asarray(np.log(np.where(seen > 0, seen, np.nan)))


def _features(xyz: FloatMap, turned: FloatMap, lamp: FloatMap) -> tuple[FloatMap, FloatMap]:
    """What the light depends on beside the view, (n, 7), and how incidence changes with the lamp's
    place, (n, 3), 1/mm."""
    beam = lamp - xyz
    far = np.linalg.norm(beam, axis=1)
    cosine = np.maximum(np.sum(turned * beam, axis=1) / far, LEAST_COSINE)
    x, y = (xyz[:, :2] / xyz[:, 2:]).T
    features = np.column_stack((np.log(cosine), np.log(far), x, y, x * x, x * y, y * y))
    return features, turned / (cosine * far)[:, None] - beam / far[:, None] ** 2


def _within(values: FloatMap, weight: FloatMap, index: NDArray[np.intp]) -> FloatMap:
    """Values less their weighted mean at each place."""
    total = np.maximum(np.bincount(index, weight), np.finfo(float).tiny)
    return np.asarray(values - (np.bincount(index, weight * values) / total)[index])


def _fitted(
    rows: FloatMap,
    level: FloatMap,
    weight: FloatMap,
    index: NDArray[np.intp],
    prior: tuple[FloatMap, FloatMap],
) -> FloatMap:
    """Parameters that make the levels of one place alike, by weighted least squares.

    ``prior`` has their expected values and the weights of these.
    """
    expected, hold = prior
    off = _within(level, weight, index)
    design = np.column_stack([_within(column, weight, index) for column in rows.T])
    normal = design.T @ (weight[:, None] * design)
    right = design.T @ (weight * off) + hold * expected
    return np.asarray(np.linalg.solve(normal + np.diag(hold), right))
