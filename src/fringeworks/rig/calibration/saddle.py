"""Corners of a chessboard to a few hundredths of a pixel: a blurred crossing fitted to each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from fringeworks.types import BoolMap, FloatMap

STEPS = 12
SMALLEST, LARGEST = 3, 11
"""Half sides of the window, px."""
WINDOW = 0.38
"""Half side of the window over the distance of neighbouring corners."""
BLUR = (0.3, 4.0)
"""Standard deviations of the edges that are believed, px."""
LINEAR = 6


@dataclass(frozen=True, eq=False)
class Saddles:
    """Fitted crossings."""

    pixels: FloatMap
    """Where they are, (n, 2), px."""
    contrast: FloatMap
    """Signed amplitude: positive where the fields in the direction of both edges' normals (and
    opposite) are bright, (n,), counts."""
    residual: FloatMap
    """Root mean square of what the model leaves, (n,), counts."""
    good: BoolMap
    """Whether the fit stayed within its window, (n,)."""


def fit_saddles(
    image: FloatMap,
    start: FloatMap,
    edges: FloatMap,
    *,
    window: float = WINDOW,
    bends: FloatMap | None = None,
) -> Saddles:
    """Fit a crossing of two blurred edges around every starting point.

    Parameters
    ----------
    image : (h, w) float array, counts.
    start : (n, 2) array, px, right to a quarter of the distance of corners.
    edges : (n, 2, 2) array
        The two vectors from a corner to its neighbours, px.
    window : float
        Half side of the square that is fitted, over the distance of neighbours.
    bends : (n, 2) array, optional
        By how much a lens bends each edge: half its curvature, 1/px, towards the edge turned by
        90° from x to y. None for straight ones.

    Notes
    -----
    I = a + a_x x + a_y y + (b + b_x x + b_y y) E(n₁·x) E(n₂·x), E(u) = erf(u / √2 s), by Gauss and
    Newton, for all corners at once; the slopes of a and b take up uneven light. The normals are
    the edges turned by 90° from x to y.
    """
    n = len(start)
    length = np.linalg.norm(edges, axis=2).min(axis=1, initial=np.inf)
    half = int(np.clip(window * np.median(length), SMALLEST, LARGEST)) if n else SMALLEST
    offsets = np.arange(-half, half + 1)
    dx, dy = (a.ravel().astype(np.float64) for a in np.meshgrid(offsets, offsets))
    centre = np.rint(start).astype(int)
    rows, columns = centre[:, 1, None] + dy.astype(int), centre[:, 0, None] + dx.astype(int)
    h, w = image.shape
    inside = ((rows >= 0) & (rows < h) & (columns >= 0) & (columns < w)).all(axis=1)
    values = image[np.clip(rows, 0, h - 1), np.clip(columns, 0, w - 1)].astype(np.float64)
    along = np.arctan2(edges[..., 1], edges[..., 0])
    # Position, angles of the two normals, blur; then the linear six.
    p = np.column_stack((start - centre, along + 0.5 * np.pi, np.full(n, 0.9)))
    good = inside & np.isfinite(values).all(axis=1)
    residual, linear = np.full(n, np.nan), np.zeros((n, LINEAR))
    damping = np.full(n, 1e-3)
    last = np.full(n, np.inf)
    best = p.copy()
    bent = np.zeros((n, 2)) if bends is None else bends
    for _ in range(STEPS):
        shape, by_shape = _crossing(p, dx, dy, bent)
        ramp = np.stack((np.ones_like(dx), dx, dy))
        design = np.concatenate(
            (np.broadcast_to(ramp, (n, 3, dx.size)), shape[:, None] * ramp), axis=1
        )
        normal = design @ design.transpose(0, 2, 1) + 1e-9 * np.eye(LINEAR)
        solved = np.linalg.solve(normal, design @ values[..., None])[..., 0]
        miss = values - np.einsum("nkm,nk->nm", design, solved)
        cost = np.sqrt(np.mean(miss**2, axis=1))
        better = cost <= last
        best[better], residual[better], last[better] = p[better], cost[better], cost[better]
        linear[better] = solved[better]
        damping = np.where(better, damping * 0.2, damping * 8.0)
        amplitude = solved[:, 3, None] + solved[:, 4, None] * dx + solved[:, 5, None] * dy
        slopes = by_shape * amplitude[:, None]
        # What the linear part can take up is not a reason to move.
        overlap = design @ slopes.transpose(0, 2, 1)
        slopes = slopes - np.einsum("nkm,nkj->njm", design, np.linalg.solve(normal, overlap))
        curvature = slopes @ slopes.transpose(0, 2, 1)
        diagonal = np.einsum("nkk->nk", curvature)
        ridge = damping[:, None] * diagonal + 1e-9
        curvature = curvature + ridge[:, :, None] * np.eye(5)
        step = np.linalg.solve(curvature, slopes @ miss[..., None])[..., 0]
        p = np.where(better[:, None], p, best) + np.where(better[:, None], step, 0.0)
        p[:, 4] = np.clip(p[:, 4], *BLUR)
    moved = best[:, :2] + centre - start
    good &= (np.abs(best[:, :2]) <= half).all(axis=1)
    good &= np.hypot(*moved.T) <= 0.3 * np.maximum(length, 1.0)
    return Saddles(best[:, :2] + centre, linear[:, 3], residual, good)


def _crossing(
    p: FloatMap, dx: FloatMap, dy: FloatMap, bends: FloatMap
) -> tuple[FloatMap, FloatMap]:
    """E(n₁·x) E(n₂·x) at the window's pixels, (n, m), and its derivatives, (n, 5, m)."""
    x, y = dx - p[:, 0, None], dy - p[:, 1, None]
    width = np.sqrt(2.0) * p[:, 4, None]
    factors, slopes, normals, turned = [], [], [], []
    for k, angle in enumerate((p[:, 2, None], p[:, 3, None])):
        c, s = np.cos(angle), np.sin(angle)
        u = (c * x + s * y - bends[:, k, None] * (c * y - s * x) ** 2) / width
        factors.append(special.erf(u))
        slopes.append(2.0 / np.sqrt(np.pi) * np.exp(-u * u) / width)
        normals.append((c, s))
        turned.append(c * y - s * x)
    (e1, e2), (g1, g2) = factors, slopes
    one, other = g1 * e2, e1 * g2
    blur = -(one * (normals[0][0] * x + normals[0][1] * y))
    blur -= other * (normals[1][0] * x + normals[1][1] * y)
    by = np.stack(
        (
            -(one * normals[0][0] + other * normals[1][0]),
            -(one * normals[0][1] + other * normals[1][1]),
            one * turned[0],
            other * turned[1],
            blur / p[:, 4, None],
        ),
        axis=1,
    )
    return e1 * e2, by
