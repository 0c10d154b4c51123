"""Brightness of views made alike: what light, incidence and exposure add to a surface's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

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
ROUNDS = 25
"""Largest number of damped Gauss–Newton steps; the lamp's place settles in six to twelve."""
SETTLED = 1e-4
"""Change of the cost of a value from which on the light counts as settled: a hundredth of σ."""
MOST_TRIED = 3000
"""Approximate number of places from which the start is chosen: ten times those that are needed."""
STARTS_MM = np.array([(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)], np.float64)
"""Starts of the lamp's place, in ``LAMP_MM``: at the camera, and beside, above and below it."""
DAMPING = (1e-3, 1e3)
"""First damping, relative to the diagonal of the normal equations, and the one at which no step is
tried any more."""
HUBER_SIGMAS = 1.5
"""Residuals from which on a place counts less, in robust standard deviations: gloss and shadows are
seen by one view and not by another (Huber 1964)."""
LEAST_COSINE = 0.1
"""Lower bound on the cosine of incidence in the model: surfaces that the light grazes have no
brightness to compare."""
FALL = -2.0
"""Power of the distance in the light of a lamp. It is not estimated: views of a turntable hardly
tell it from light that falls over the frame, and small errors then tilt colours by 30 % over a part
of 130 mm."""
EXPECTED = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Expected factors of the light by the laws of Lambert and of distance, of the frame's x, y, x²,
x y and y², and of the room's light over the lamp's."""
UNSURE = (0.5, 2.0, 2.0, 5.0, 5.0, 5.0, 0.1)
"""Their standard deviations before the views are seen: bent responses change the first, and with it
both laws alike; light over a frame of ±0.2 falls by a third or less; rooms have a tenth of the
lamp's light at ``ROOM_MM``."""
ROOM_MM = 500.0
"""Distance of the lamp at which the room's light is stated; a matter of scale."""
FIRST_UNSURE = (0.1, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02)
"""The same while the lamp's place is searched: few unknowns lead to it from far away."""
COMPARED_COSINE = 0.25
"""Cosine of incidence from which on brightness is compared: below it, light of the room and errors
of normals count as much as the lamp."""
UNLIT_SCATTER = 0.3
"""Standard deviation of what other values differ by, as a logarithm: paint and light of the room.
It makes a light that leaves much of a view in the dark less likely."""
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
    log E is linear in a constant for each view, in log cos − 2 log distance, in a quadratic
    polynomial over the frame, and to the first order in the room's light over the lamp's, distance²
    / cos. The lamp's place is estimated with them. All views share these, as they share the device.
    The differences of views at one place are free of a and determine them.
    """
    seen = _Compared.of(views, index)
    if seen is None:
        return None
    # A few places tell which start leads to the most likely light; all of them refine it.
    few = seen.thinned(MOST_TRIED)
    nears = [_Light.near(lamp, len(views)) for lamp in STARTS_MM * LAMP_MM]
    starts = [_settled(few, _settled(few, near, FIRST_UNSURE), UNSURE) for near in nears]
    light = _settled(seen, min(starts, key=lambda tried: tried.cost), UNSURE)
    lit = _rows(seen, light)[2]
    before = robust_sigma(np.abs(_within(seen.level, lit.astype(float), seen.place)[lit]))
    if not light.scatter < before:
        return None
    levels = np.concatenate(
        [
            _features(v.xyz_mm, v.normals, light.lamp)[0] @ light.factors + constant
            for v, constant in zip(views, light.constants, strict=True)
        ]
    )
    return np.asarray(np.exp(levels.mean() - levels))


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

    def thinned(self, most: int) -> Self:
        """Some of the places, evenly spread."""
        kept = self.place % max(1, int(self.place.max()) // most) == 0
        _, place = np.unique(self.place[kept], return_inverse=True)
        parts: tuple[NDArray[Any], ...] = self.xyz_mm, self.normals, self.level, self.view
        xyz, normals, level, view = (part[kept] for part in parts)
        return type(self)(xyz, normals, level, view, place.ravel())


@dataclass(frozen=True, eq=False)
class _Light:
    """The light of all views, and how well it explains what they see of the same places."""

    found: FloatMap
    """Factors of the features, a constant for each view, and the lamp's place, (7 + n + 3,)."""
    scatter: float
    """Robust standard deviation of the residuals."""
    cost: float

    @classmethod
    def near(cls, lamp: FloatMap, views: int) -> Self:
        """The expected light, with a lamp at a place."""
        return cls(np.array([*EXPECTED, *np.zeros(views), *lamp]), FIRST_SCATTER, np.inf)

    @property
    def factors(self) -> FloatMap:
        """Factors of the features, (7,)."""
        return self.found[: len(EXPECTED)]

    @property
    def constants(self) -> FloatMap:
        """Of each view, (n,)."""
        return self.found[len(EXPECTED) : -LAMP]

    @property
    def lamp(self) -> FloatMap:
        """Place of the lamp in camera coordinates, mm."""
        return self.found[-LAMP:]

    def left(self, seen: _Compared, rows: FloatMap) -> FloatMap:
        """What the light leaves of the levels: those of the places, and errors."""
        return np.asarray(seen.level - rows @ self.found[:-LAMP])

    def residuals(self, seen: _Compared, rows: FloatMap, lit: NDArray[np.bool_]) -> FloatMap:
        """Sizes of the errors at each place."""
        left = self.left(seen, rows)
        return np.abs(_within(left, self.weights(seen, left, lit), seen.place))

    def weights(self, seen: _Compared, left: FloatMap, lit: NDArray[np.bool_]) -> FloatMap:
        """Robust weights of what the views see; 0 for what the lamp hardly lights."""
        off = np.abs(_within(left, lit.astype(float), seen.place))
        fair = np.minimum(1.0, HUBER_SIGMAS * self.scatter / np.maximum(off, 1e-12))
        return np.asarray(np.where(lit, fair, 0.0))


def _rows(seen: _Compared, light: _Light) -> tuple[FloatMap, FloatMap, NDArray[np.bool_]]:
    """Features and constants of every value, how the level changes with the lamp's place, and which
    values are compared."""
    features, beam, cosine = _features(seen.xyz_mm, seen.normals, light.lamp)
    far = np.linalg.norm(beam, axis=1)
    along = beam / far[:, None] ** 2
    turning = seen.normals / (cosine * far)[:, None] - along
    turning[cosine <= LEAST_COSINE] = 0.0  # the model's cosine is constant there
    by_lamp = light.factors[0] * (turning + FALL * along)
    rows = np.column_stack((features, np.eye(len(light.constants))[seen.view]))
    return rows, by_lamp, np.asarray(cosine > COMPARED_COSINE)


def _settled(seen: _Compared, light: _Light, factors: Sequence[float]) -> _Light:
    """The most likely light from a start on, by damped Gauss–Newton steps with robust weights.

    ``factors`` are the standard deviations of the factors before the views are seen.
    """
    expected = np.array([*EXPECTED, *np.zeros(len(light.constants) + LAMP)])
    unsure = np.array([*factors, *[EXPOSURE] * len(light.constants), *[LAMP_MM] * LAMP])
    light, damping = _judged(seen, light, expected, unsure), DAMPING[0]
    for _ in range(ROUNDS):
        rows, by_lamp, lit = _rows(seen, light)
        left = light.left(seen, rows)
        weight = light.weights(seen, left, lit)
        hold = (light.scatter / unsure) ** 2
        design = np.column_stack(
            [_within(c, weight, seen.place) for c in np.column_stack((rows, by_lamp)).T]
        )
        normal = design.T @ (weight[:, None] * design) + np.diag(hold)
        right = design.T @ (weight * _within(left, weight, seen.place))
        right += hold * (expected - light.found)
        while damping < DAMPING[1]:
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), right)
            # Both at one scatter, so that their costs are alike.
            tried = _judged(seen, replace(light, found=light.found + step), expected, unsure)
            if tried.cost < light.cost:
                break
            damping *= 10.0
        else:
            break
        gain, damping = (light.cost - tried.cost) / len(left), damping / 10.0
        light = _judged(seen, replace(tried, scatter=_scatter(seen, tried)), expected, unsure)
        if gain < SETTLED:
            break
    return light


def _judged(seen: _Compared, light: _Light, expected: FloatMap, unsure: FloatMap) -> _Light:
    """The light with its cost: Huber's of the residuals, and that of what was expected."""
    rows, _, lit = _rows(seen, light)
    scatter = np.where(lit, light.scatter, UNLIT_SCATTER)
    off = light.residuals(seen, rows, lit) / scatter
    far = off > HUBER_SIGMAS
    cost = np.sum(np.where(far, HUBER_SIGMAS * (2.0 * off - HUBER_SIGMAS), off**2))
    cost += 2.0 * np.sum(np.log(scatter))
    cost += np.sum(((light.found - expected) / unsure) ** 2)
    return replace(light, cost=float(cost))


def _scatter(seen: _Compared, light: _Light) -> float:
    """Robust standard deviation of the residuals of what the lamp lights."""
    rows, _, lit = _rows(seen, light)
    return max(float(robust_sigma(light.residuals(seen, rows, lit)[lit])), LEAST_SCATTER)


def _brightness(view: SurfacePoints) -> FloatMap:
    """Logarithm of the brightness, (n,); NaN where there is none."""
    assert view.colour is not None
    seen = view.colour if view.colour.ndim == 1 else view.colour.mean(axis=1)
    return np.asarray(np.log(np.where(seen > 0, seen, np.nan)))


def _features(
    xyz: FloatMap, turned: FloatMap, lamp: FloatMap
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """What the light depends on beside the view, (n, 7), the way to the lamp, (n, 3), mm, and the
    cosine of incidence, (n,)."""
    beam = lamp - xyz
    far = np.linalg.norm(beam, axis=1)
    cosine = np.maximum(np.sum(turned * beam, axis=1) / far, LEAST_COSINE)
    x, y = (xyz[:, :2] / xyz[:, 2:]).T
    light = np.log(cosine) + FALL * np.log(far)
    room = (far / ROOM_MM) ** 2 / cosine
    features = np.column_stack((light, x, y, x * x, x * y, y * y, room))
    return features, beam, cosine


def _within(values: FloatMap, weight: FloatMap, index: NDArray[np.intp]) -> FloatMap:
    """Values less their weighted mean at each place."""
    total = np.maximum(np.bincount(index, weight), np.finfo(float).tiny)
    return np.asarray(values - (np.bincount(index, weight * values) / total)[index])
