"""Bodies associated with points: by Chebyshev, Gauss, or in contact with the material."""

from __future__ import annotations

import numpy as np

from fringeworks.evaluate.tolerances.bodies import Body, twists
from fringeworks.evaluate.tolerances.minimax import smallest_largest
from fringeworks.types import FloatMap, InputError
from fringeworks.types.recipe import Association

DETERMINED = 1e-5
"""Size of a direction's effect on the distances, relative to the largest, from which it counts as
one: less than it is an invariance of the body, by rounding."""
MOST_STEPS = 12
"""Largest number of linear steps. Two or three are usual: deviations are small beside bodies."""
SETTLED = 1e-7
"""Change of a distance in a step, relative to the spread of the distances, that ends them."""
HALF_TURN = np.pi
"""Gap between neighbouring points around a body, rad, from which on a circumscribed or inscribed
body has no bound."""


def associate(
    body: Body,
    points: FloatMap,
    free: FloatMap,
    by: Association = "minimum-zone",
    *,
    sized: bool = True,
    weights: FloatMap | None = None,
    pivot: FloatMap | None = None,
    scale: float | None = None,
) -> Body:
    """Return the body after the free motions, and the free size, that suit the points best.

    Parameters
    ----------
    body : Body
        Near the points.
    points : (n, 3) array, mm
    free : (6, f) array
        Motions that may be made, about ``pivot`` with rotations in rad times ``scale``.
    by : str
        ``minimum-zone``: smallest largest distance (Chebyshev, C of ISO 1101). ``least-squares``:
        smallest sum of squares (Gauss, G). ``outside``: the same as ``minimum-zone``, moved out of
        the material until it touches (ISO 5459). ``circumscribed``, ``inscribed``: smallest or
        largest body that holds all points, or none (N and X of ISO 1101).
    sized : bool
        Whether the radius, or the plane's place along its normal, is free.
    weights : (n,) array, optional
        Of least squares.

    Raises
    ------
    InputError for a circumscribed or inscribed body of which less than half a turn is known.
    """
    pivot = points.mean(axis=0) if pivot is None else pivot
    scale = scale or float(np.sqrt(np.mean(np.sum((points - pivot) ** 2, axis=1)))) or 1.0
    touching = {"circumscribed": 1.0, "inscribed": -1.0}.get(by, 0.0)
    if touching:
        _need_half_a_turn(body, points)
    sized = sized and not touching
    for _ in range(MOST_STEPS):
        values, normals, at = body.offsets(points)
        slopes = twists(at, normals, pivot, scale) @ free
        if sized:
            slopes = np.column_stack((slopes, -np.ones(len(values))))
        step, moved = _step(values, slopes, by, weights)
        if sized:
            body, step = body.larger(float(step[-1])), step[:-1]
        body = body.moved(-(free @ step), pivot, scale)
        if moved <= SETTLED * (float(np.ptp(values)) + np.finfo(float).tiny):
            break
    distances = body.distances(points)
    if by == "circumscribed" or (by == "outside" and not body.hollow):
        return body.larger(float(distances.max()))
    return body.larger(float(distances.min())) if by in ("inscribed", "outside") else body


def _step(
    values: FloatMap,
    slopes: FloatMap,
    by: Association,
    weights: FloatMap | None,
    least: float = DETERMINED,
) -> tuple[FloatMap, float]:
    """The step of the free motions, and the largest change of a distance."""
    if not slopes.shape[1]:
        return np.zeros(0), 0.0
    w = np.ones(len(values)) if weights is None else weights
    squares, turn = np.linalg.eigh(slopes.T @ (slopes * w[:, None]) / w.sum())
    kept = squares > least**2 * squares[-1]
    basis = turn[:, kept] / np.sqrt(squares[kept])
    unit = slopes @ basis
    if by == "least-squares":
        q = -(unit.T @ (w * values)) / w.sum()
    elif by in ("circumscribed", "inscribed"):
        sign = 1.0 if by == "circumscribed" else -1.0
        q = smallest_largest(sign * values, sign * unit)
    else:
        q = smallest_largest(np.concatenate((values, -values)), np.vstack((unit, -unit)))
    return basis @ q, float(np.abs(unit @ q).max())


def _need_half_a_turn(body: Body, points: FloatMap) -> None:
    """Refuse bodies that points on one side alone do not bound."""
    if body.kind != "cylinder":
        raise InputError(
            f"association: expected a cylinder for a circumscribed or inscribed body, got a "
            f"{body.kind}"
        )
    u, v = np.linalg.svd(body.direction[None, :])[2][1:]
    away = points - body.point
    turn = np.sort(np.arctan2(away @ v, away @ u))
    gaps = np.diff(turn, append=turn[0] + 2.0 * np.pi)
    if gaps.max() > HALF_TURN:
        raise InputError(
            "association: expected points around more than half of the cylinder for a "
            "circumscribed or inscribed one, got fewer: take minimum-zone, least-squares or outside"
        )


def zone_of(values: FloatMap, slopes: FloatMap) -> float:
    """Return the smallest largest size of values + slopes · x, in one linear step."""
    x, _ = _step(values, slopes, "minimum-zone", None, DETERMINED)
    return float(np.abs(values + slopes @ x).max())
