"""Corners of squares to hundredths of a pixel: a blurred crossing of edges is fitted to each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import BoolMap, FloatMap

CORNER_WINDOW = 0.38
"""Half side of the fitted square over the distance of neighbouring corners: as large as possible
without the blurred edges of the next corner."""
MIN_CORNER_HALF_PX = 3
"""Smallest half side of the fitted square, px: 49 pixels for eleven unknowns."""
MAX_CORNER_HALF_PX = 11
"""Largest half side of the fitted square, px: further out, bent edges and uneven light cause larger
errors than noise does. Empirical."""
CORNER_STEPS = 12
"""Number of Levenberg–Marquardt steps, the same for all corners because they are fitted together.
From a start a fifth of a square away, the result no longer changes after ten."""
MIN_BLUR_PX = 0.3
"""Smallest standard deviation of a blurred edge, px: pixels do not show sharper edges."""
MAX_BLUR_PX = 4.0
"""Largest standard deviation of a blurred edge, px: such an edge fills the window."""
FIRST_BLUR_PX = 0.9
"""Blur to start from, px: a sharp camera."""
CORNER_FIRST_DAMPING = 1e-3
"""Damping of the first step, relative to the diagonal of the normal matrix: nearly a plain
Gauss–Newton step, because the start is good."""
CORNER_LESS_DAMPING = 0.2
"""Factor of the damping after a step that lowered the residual. Empirical."""
CORNER_MORE_DAMPING = 8.0
"""Factor of the damping after a step that raised the residual. Empirical."""
RIDGE = 1e-9
"""Added to the diagonals of the normal matrices, so that windows without contrast are not
singular; far below the entries of others."""
MAX_CORNER_SHIFT = 0.3
"""Largest distance of a fitted corner from its start, over the distance of neighbours: farther away
it may be another corner."""
MIN_CONTRAST = 0.5
"""Smallest contrast of a corner, relative to the usual contrast on the board. Hidden corners and
other patterns have less; shading within a board varies less. Empirical."""
LINEAR = 6
"""Number of linear unknowns of a corner: a, a_x, a_y, b, b_x, b_y."""
NONLINEAR = 5
"""Number of non-linear unknowns of a corner: x, y, the angles of both normals, blur."""


@dataclass(frozen=True, eq=False)
class Saddles:
    """Corners of squares, fitted: the brightness has a saddle at each."""

    pixels: FloatMap
    """Positions, (n, 2), px."""
    contrast: FloatMap
    """Signed amplitude b of the crossing, (n,), counts. Positive where the square between the
    normals of both edges, and the one opposite, are the bright ones."""
    residual: FloatMap
    """Root mean square residual of the fit, (n,), counts; NaN where it failed."""
    blur_px: FloatMap
    """Standard deviation of the blurred edges, (n,), px."""
    step: FloatMap
    """Larger change of brightness across one of the edges alone over the amplitude of the crossing,
    (n,). 0 where four squares meet; 1 where two squares meet something even, and where one dark
    square does: at a corner of the sheet of squares."""
    good: BoolMap
    """Whether the fit succeeded inside the image and near its start, (n,)."""


def fit_saddles(
    image: FloatMap,
    start: FloatMap,
    edges: FloatMap,
    *,
    window: float = CORNER_WINDOW,
    bends: FloatMap | None = None,
) -> Saddles:
    """Fit a crossing of two blurred edges around every start.

    Parameters
    ----------
    image : (h, w) float array, counts
    start : (n, 2) array
        Positions to start from, px; exact to a quarter of the distance of corners.
    edges : (n, 2, 2) array
        The two vectors from a corner to its neighbours, px.
    window : float
        Half side of the fitted square, over the distance of neighbours.
    bends : (n, 2) array, optional
        Half the curvature of each edge, 1/px, positive towards the edge turned by 90° from x to y.
        None for straight edges.

    Returns
    -------
    Saddles

    Notes
    -----
    I = a + a_x x + a_y y + (b + b_x x + b_y y) E(n₁·x) E(n₂·x), E(u) = erf(u / √2 s), by
    Levenberg–Marquardt for all corners together (theory §8). The slopes of a and b follow uneven
    light. The normals n₁, n₂ are the edges turned by 90° from x to y; bent edges have
    n·x − κ (t·x)² in place of n·x.
    """
    n = len(start)
    length = np.linalg.norm(edges, axis=2).min(axis=1, initial=np.inf)
    half = (
        int(np.clip(window * np.median(length), MIN_CORNER_HALF_PX, MAX_CORNER_HALF_PX))
        if n
        else MIN_CORNER_HALF_PX
    )
    offsets = np.arange(-half, half + 1)
    dx, dy = (a.ravel().astype(np.float64) for a in np.meshgrid(offsets, offsets))
    centre = np.rint(start).astype(int)
    values, inside = _windows(image, centre, dx, dy)
    angle = np.arctan2(edges[..., 1], edges[..., 0])
    first = np.column_stack((start - centre, angle + 0.5 * np.pi, np.full(n, FIRST_BLUR_PX)))
    curvature = np.zeros((n, 2)) if bends is None else bends
    fitted, linear, residual = _minimise(values, first, dx, dy, curvature)
    shift = fitted[:, :2] + centre - start
    good = inside & np.isfinite(values).all(axis=1)
    good &= (np.abs(fitted[:, :2]) <= half).all(axis=1)
    good &= np.hypot(*shift.T) <= MAX_CORNER_SHIFT * np.maximum(length, 1.0)
    step = _step_share(values, fitted, dx, dy, curvature)
    return Saddles(fitted[:, :2] + centre, linear[:, 3], residual, fitted[:, 4], step, good)


def _step_share(
    values: FloatMap, fitted: FloatMap, dx: FloatMap, dy: FloatMap, bends: FloatMap
) -> FloatMap:
    """How much each edge alone changes the brightness, relative to the crossing; see ``Saddles``.

    I = a + a_x x + a_y y + b E(n₁·x) E(n₂·x) + c₁ E(n₁·x) + c₂ E(n₂·x), linear in all unknowns.
    """
    crossing, _, (first, second) = _crossing(fitted, dx, dy, bends)
    ramp = np.stack((np.ones_like(dx), dx, dy))
    design = np.concatenate(
        (
            np.broadcast_to(ramp, (len(fitted), 3, dx.size)),
            np.stack((crossing, first, second), axis=1),
        ),
        axis=1,
    )
    normal = design @ design.transpose(0, 2, 1) + RIDGE * np.eye(LINEAR)
    solved = np.linalg.solve(normal, design @ values[..., None])[..., 0]
    steps = np.abs(solved[:, 4:]).max(axis=1)
    crossed = np.abs(solved[:, 3])
    return np.asarray(
        np.divide(steps, crossed, out=np.full(len(fitted), np.inf), where=crossed > 0)
    )


def _windows(
    image: FloatMap, centre: NDArray[np.int_], dx: FloatMap, dy: FloatMap
) -> tuple[FloatMap, BoolMap]:
    """Brightness in the windows, (n, m), and which windows lie inside the image, (n,)."""
    rows, columns = centre[:, 1, None] + dy.astype(int), centre[:, 0, None] + dx.astype(int)
    h, w = image.shape
    inside = ((rows >= 0) & (rows < h) & (columns >= 0) & (columns < w)).all(axis=1)
    values = image[np.clip(rows, 0, h - 1), np.clip(columns, 0, w - 1)].astype(np.float64)
    return values, inside


def _minimise(
    values: FloatMap, start: FloatMap, dx: FloatMap, dy: FloatMap, bends: FloatMap
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Fit all windows by Levenberg–Marquardt with the linear unknowns eliminated.

    Parameters
    ----------
    values : (n, m) array, counts
    start : (n, 5) array
        Position (px from the window's centre), angles of both normals (rad), blur (px).
    dx, dy : (m,) arrays, pixels of a window from its centre
    bends : (n, 2) array, 1/px

    Returns
    -------
    The best non-linear (n, 5) and linear (n, 6) unknowns, and the root mean square residual (n,).
    """
    n = len(start)
    trial, best = start, start.copy()
    residual, linear = np.full(n, np.nan), np.zeros((n, LINEAR))
    lowest = np.full(n, np.inf)
    damping = np.full(n, CORNER_FIRST_DAMPING)
    ramp = np.stack((np.ones_like(dx), dx, dy))
    for _ in range(CORNER_STEPS):
        crossing, by_unknown, _ = _crossing(trial, dx, dy, bends)
        design = np.concatenate(
            (np.broadcast_to(ramp, (n, 3, dx.size)), crossing[:, None] * ramp), axis=1
        )
        normal = design @ design.transpose(0, 2, 1) + RIDGE * np.eye(LINEAR)
        solved = np.linalg.solve(normal, design @ values[..., None])[..., 0]
        error = values - np.einsum("nkm,nk->nm", design, solved)
        rms = np.sqrt(np.mean(error**2, axis=1))
        better = rms <= lowest
        best[better], residual[better], lowest[better] = trial[better], rms[better], rms[better]
        linear[better] = solved[better]
        damping = np.where(better, damping * CORNER_LESS_DAMPING, damping * CORNER_MORE_DAMPING)
        amplitude = solved[:, 3, None] + solved[:, 4, None] * dx + solved[:, 5, None] * dy
        step = _step(by_unknown * amplitude[:, None], design, normal, error, damping)
        trial = np.where(better[:, None], trial, best) + np.where(better[:, None], step, 0.0)
        trial[:, 4] = np.clip(trial[:, 4], MIN_BLUR_PX, MAX_BLUR_PX)
    return best, linear, residual


def _step(
    slopes: FloatMap, design: FloatMap, normal: FloatMap, error: FloatMap, damping: FloatMap
) -> FloatMap:
    """Damped Gauss–Newton step of the non-linear unknowns, (n, 5)."""
    # The linear unknowns follow every step, so only the slopes that they cannot explain count.
    overlap = design @ slopes.transpose(0, 2, 1)
    slopes = slopes - np.einsum("nkm,nkj->njm", design, np.linalg.solve(normal, overlap))
    curvature = slopes @ slopes.transpose(0, 2, 1)
    ridge = damping[:, None] * np.einsum("nkk->nk", curvature) + RIDGE
    curvature = curvature + ridge[:, :, None] * np.eye(NONLINEAR)
    return np.asarray(np.linalg.solve(curvature, slopes @ error[..., None])[..., 0])


def _crossing(
    unknowns: FloatMap, dx: FloatMap, dy: FloatMap, bends: FloatMap
) -> tuple[FloatMap, FloatMap, tuple[FloatMap, FloatMap]]:
    """E(n₁·x) E(n₂·x) at the pixels, (n, m), its derivatives, (n, 5, m), and both factors."""
    x, y = dx - unknowns[:, 0, None], dy - unknowns[:, 1, None]
    width = np.sqrt(2.0) * unknowns[:, 4, None]
    factors, slopes, normals, along = [], [], [], []
    for k, angle in enumerate((unknowns[:, 2, None], unknowns[:, 3, None])):
        c, s = np.cos(angle), np.sin(angle)
        u = (c * x + s * y - bends[:, k, None] * (c * y - s * x) ** 2) / width
        factors.append(scipy.special.erf(u))
        slopes.append(2.0 / np.sqrt(np.pi) * np.exp(-u * u) / width)
        normals.append((c, s))
        along.append(c * y - s * x)
    (e1, e2), (g1, g2) = factors, slopes
    by_first, by_second = g1 * e2, e1 * g2
    by_blur = -(by_first * (normals[0][0] * x + normals[0][1] * y))
    by_blur -= by_second * (normals[1][0] * x + normals[1][1] * y)
    derivatives = np.stack(
        (
            -(by_first * normals[0][0] + by_second * normals[1][0]),
            -(by_first * normals[0][1] + by_second * normals[1][1]),
            by_first * along[0],
            by_second * along[1],
            by_blur / unknowns[:, 4, None],
        ),
        axis=1,
    )
    return e1 * e2, derivatives, (e1, e2)
