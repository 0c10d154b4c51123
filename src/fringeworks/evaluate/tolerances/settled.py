"""Points that move freely on their model, until their largest distance from it is smallest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.evaluate.tolerances.association import DETERMINED
from fringeworks.evaluate.tolerances.bodies import twists
from fringeworks.evaluate.tolerances.minimax import smallest_largest
from fringeworks.rig.pinhole import rotation
from fringeworks.types import FloatMap

OnModel = Callable[[FloatMap], tuple[FloatMap, FloatMap]]
"""Signed distances of points (n, 3) from a model, (n,), mm, and directions out of it, (n, 3)."""

FIRST_STEP = 0.1
"""Largest motion of the first linear step, in root mean square distances of the points from their
middle."""
MOST_STEPS = 40
"""Largest number of linear steps. Three to ten are usual; slides of weak effect need more."""
SETTLED = 1e-3
"""Expected gain of a step, relative to the largest distance, that ends the steps."""
SMALLEST_STEP = 1e-7
"""Largest motion of a step, in the same unit as the first, below which no step gains."""
GOOD, BAD = 0.75, 0.25
"""Gain of a step over the expected one above which the next may be twice as large, and below which
it is a quarter as large (Nocedal & Wright, Numerical Optimization, 2006, algorithm 4.1)."""


@dataclass(frozen=True)
class Settled:
    """Points at a place on their model."""

    turn: FloatMap
    """Rotation from where the points were measured, (3, 3)."""
    points: FloatMap
    """(m, 3), mm."""
    distance: FloatMap
    """Signed distances from the model, (m,), mm."""
    outwards: FloatMap
    """Directions out of the model, (m, 3)."""

    @property
    def size(self) -> float:
        """The largest distance, mm."""
        return float(np.abs(self.distance).max())

    def changed(self, change: FloatMap, along: FloatMap) -> Settled:
        """Return the same points after small changes (m,) along directions (m, 3) before the
        rotation, mm."""
        moves = change[:, None] * (along @ self.turn.T)
        more = np.einsum("mc,mc->m", moves, self.outwards)
        return replace(self, points=self.points + moves, distance=self.distance + more)


def measured_at(points: FloatMap, model: OnModel) -> Settled:
    """Return points where they were measured."""
    return Settled(np.eye(3), points, *model(points))


def settled(at: Settled, free: FloatMap, model: OnModel) -> Settled:
    """Return the points after the motion that makes their largest distance smallest.

    Parameters
    ----------
    at : Settled
        Where the points begin.
    free : (6, f) array
        Motions that may be made, as in ``associate``.
    model : function

    Notes
    -----
    Sequential linear programming in a trust region: a linear step is exact to the square of the
    motion over the radius of the model, and a slide along a form may be long. Every step is checked
    by the distances from the model itself. Motions that a model does not notice, such as a turn of
    a pipe about its axis, gain nothing, whatever the normals of its facets say.
    """
    pivot = at.points.mean(axis=0)
    scale = float(np.sqrt(np.mean(np.sum((at.points - pivot) ** 2, axis=1)))) or 1.0
    reach = FIRST_STEP * scale
    for _ in range(MOST_STEPS):
        slopes = twists(at.points, at.outwards, pivot, scale) @ free
        step, expected = _step(at.distance, slopes, reach)
        gain = at.size - expected
        if gain <= SETTLED * at.size or reach < SMALLEST_STEP * scale:
            break
        tried = _moved(at, free @ step, pivot, scale, model)
        got = (at.size - tried.size) / gain
        if got > GOOD and np.abs(step).max() > 0.9 * reach:
            reach *= 2.0
        elif got < BAD:
            reach = 0.25 * min(reach, float(np.abs(step).max()))
        if got > 0.0:
            at = tried
    return at


def _step(distance: FloatMap, slopes: FloatMap, reach: float) -> tuple[FloatMap, float]:
    """The step within reach, (f,), and the largest distance that is expected after it."""
    squares, turn = np.linalg.eigh(slopes.T @ slopes)
    basis = turn[:, squares > DETERMINED**2 * squares[-1]]
    unit = slopes @ basis
    x = smallest_largest(np.append(distance, -distance), np.vstack((unit, -unit)), within=reach)
    return basis @ x, float(np.abs(distance + unit @ x).max())


def _moved(at: Settled, twist: FloatMap, pivot: FloatMap, scale: float, model: OnModel) -> Settled:
    R = rotation(twist[:3] / scale)
    points = pivot + (at.points - pivot) @ R.T + twist[3:]
    return Settled(R @ at.turn, points, *model(points))
