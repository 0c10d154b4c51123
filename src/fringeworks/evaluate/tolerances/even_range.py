"""Ranges of VDI/VDE 2634 on smooth surfaces: flatness and parallelism about least squares."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fringeworks.evaluate.area_points import AreaPoints
from fringeworks.evaluate.quantified import narrowest
from fringeworks.evaluate.tolerances.skins import Skin, skin
from fringeworks.evaluate.tolerances.uncertain import Value
from fringeworks.types import FloatMap, PartTolerance

EVEN = frozenset({"flatness", "parallelism"})
"""Quantities that are ranges of distances from a plane of least squares."""


def even_range(
    tolerance: PartTolerance, of_area: Callable[[str], AreaPoints]
) -> tuple[Value, list[Skin]] | None:
    """Return a range from a plane as a function of changes of its surfaces, and the surfaces.

    Parameters
    ----------
    tolerance : PartTolerance
        Of ``flatness`` or ``parallelism``.
    of_area : function
        Gives the points of an area by its name.

    Returns
    -------
    The function and its surfaces; None where the noise of points is not known, or where no spline
    describes a surface. The points then stand for themselves.

    Notes
    -----
    The range leaves out the farthest 0.3 % of the surface, as it does of points. What noise adds to
    a range of points can be subtracted with a relative σ of a quarter only, which for a face of
    30,000 points is as much as its noise. A surface that is estimated from all of them has little
    noise left.
    """
    areas = [of_area(name) for name in tolerance.areas]
    if not all(one.noise.any() for one in areas):
        return None
    skins = [skin(one, "plane", evenly=True) for one in areas]
    if not all(one.resolved for one in skins):
        return None
    part, base = skins[0], skins[-1]

    def value(changes: Sequence[FloatMap]) -> float:
        return narrowest(part.points(changes[0]) @ _normal(base, changes[-1]))

    return value, skins


def _normal(base: Skin, change: FloatMap) -> FloatMap:
    """Normal of the plane of least squares, (3,).

    Distances along the normal of the plane of the points as they were measured are least, not those
    across the new plane: the two differ by the square of its tilt.
    """
    n = base.body.direction
    across = np.linalg.svd(n[None])[2][1:]
    slopes = np.column_stack((base.foot @ across.T, np.ones(len(base.foot))))
    slopes[:, :2] -= slopes[:, :2].mean(axis=0)
    x, y, _ = np.linalg.lstsq(slopes, base.distance + change, rcond=None)[0]
    tilted = n - x * across[0] - y * across[1]
    return np.asarray(tilted / np.linalg.norm(tilted))
