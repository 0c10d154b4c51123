"""Fringe orders along time: what a pixel has shown before tells what it shows now."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.kernel_settings import LOST_SHARE, Decoding
from fringeworks.stack.motion import Motion, warped
from fringeworks.stack.set_residuals import phase_variance
from fringeworks.statistics.chi_square import chi_square_quantile
from fringeworks.types import Axis, BoolMap, CameraNoise, FloatMap, Reason
from fringeworks.types.packages import cv2

SAME_PERIODS = 0.25
"""Distance from the expected coordinate, in periods of the finest fringes, up to which it is the
same order: half of the distance at which two orders are equally near."""
SUPPORT_WINDOW = 7
"""Side of the window in which a coordinate needs neighbours on its surface, px."""
SUPPORT_SHARE = 0.35
"""Share of the sure pixels of the window that must be on the surface of a pixel. At a straight
edge between two surfaces half of them are; in a streak of wrong orders 2 px
wide, which paint in motion causes, 0.29."""
MIN_SURE = 12
"""Smallest number of sure pixels that the share refers to: a quarter of the window. Fewer
give no support."""
SURFACE_PERIODS = 0.5
"""Difference of the coordinates in the window, in periods of the finest fringes, up to which they
belong to one surface."""
STEP_SHARE = 0.15
"""Share of the sure pixels of the window beyond which another surface is beside a pixel."""
RAISED = 3.0
"""Factor on the variance of a region, over the usual one, from which on its pixels need
neighbours on their surface even where nothing else speaks against them. In simulations wrong orders
have 3.5 and more, nearly all of them 7, and 5 % of the right ones have more than 3."""


def expected_later(coordinate_px: FloatMap, motion: Motion, axis: Axis, frames: float) -> FloatMap:
    """Return the coordinates that are expected some frames later, (h, w), projector px.

    NaN where none was measured, and where such a pixel is next to what moves to here.
    """
    later = warped(coordinate_px, motion.flow_px, -frames)
    return np.asarray(later + np.float32(frames) * motion.velocity_px[axis])


def track_orders(
    results: dict[str, Any],
    decoding: Decoding,
    noise: CameraNoise,
    expected: FloatMap | None,
    flow_px: FloatMap | None = None,
) -> None:
    """Check fringe orders against those expected, and decide orders that were ambiguous.

    Parameters
    ----------
    results : the kernel's maps with wrapped phases and inflation, which are changed
    decoding : Decoding
    noise : CameraNoise
    expected : (h, w) array, optional
        Coordinates that are expected, projector px; NaN where none is. None for the first ones.
    flow_px : (h, w, 2) array, optional
        Motion across the image, camera px per frame; None where nothing moves across it.

    Notes
    -----
    A coordinate of the expected order is kept. One of another order is kept where enough neighbours
    of right orders lie on its surface: it belongs to a part of the scene that has come into view.
    An order that the plan alone leaves ambiguous is that of the expected coordinate, where all sets
    agree with it. Where a depth step moves across the image, the bits of a Gray code and the
    fringes of a pixel may be those of two surfaces: pixels beside it have no order.
    """
    coordinate, sigma, reason = (results[name] for name in ("coordinate", "sigma", "reason"))
    finest = min(phases.period_px for phases in decoding.sets)
    lit = reason == Reason.OK
    usual = np.median(results["inflation"][lit]) if lit.any() else 1.0
    raised = results["inflation"] > RAISED * usual
    torn = raised | _near_motion(flow_px, lit)
    clear = ~raised
    doubtful = raised
    if expected is not None:
        known = ~np.isnan(expected)
        with np.errstate(invalid="ignore"):
            same = np.abs(coordinate - expected) < SAME_PERIODS * finest
        ambiguous = (reason == Reason.ORDER_AMBIGUOUS) & known
        _decide(results, ambiguous, expected, decoding, noise)
        same |= ambiguous
        raised, doubtful = raised & ~same, (raised | known) & ~same
    measured = reason == Reason.OK
    reach = SURFACE_PERIODS * finest
    alone = _alone(coordinate, measured & doubtful, measured & ~raised, reach)
    if decoding.gray is not None:
        torn = _beside_steps(coordinate, measured & torn & ~alone, measured & clear, reach)
        coordinate[torn] = sigma[torn] = np.nan
        reason[torn] = Reason.ORDER_AMBIGUOUS
    coordinate[alone] = sigma[alone] = np.nan
    reason[alone] = Reason.ISOLATED


def _near_motion(flow_px: FloatMap | None, like: BoolMap) -> BoolMap:
    """Mark pixels with motion across the image in the window around them."""
    if flow_px is None:
        return np.zeros_like(like)
    moving = np.asarray(flow_px.any(axis=-1), np.uint8)
    return cv2.dilate(moving, np.ones((SUPPORT_WINDOW, SUPPORT_WINDOW), np.uint8)) > 0


def _decide(
    results: dict[str, Any],
    ambiguous: BoolMap,
    expected: FloatMap,
    decoding: Decoding,
    noise: CameraNoise,
) -> None:
    """Write the coordinates nearest to the expected ones where all sets agree on them."""
    near = expected[ambiguous].astype(np.float64)
    background = results["background"][ambiguous]
    away, weights = [], []
    for phases, phase, modulation in zip(
        decoding.sets, results["phases"], results["modulations"], strict=True
    ):
        turns = phase[ambiguous] / TURN - near / phases.period_px
        away.append((turns - np.rint(turns)) * phases.period_px)
        variance = phase_variance(phases, modulation[ambiguous], background, noise)
        variance = variance * decoding.noise_factor + phases.floor_rad**2
        weights.append((TURN / phases.period_px) ** 2 / variance)
    off, weight = np.stack(away), np.stack(weights) / results["inflation"][ambiguous]
    total = np.sum(weight, axis=0)
    mean = np.sum(off * weight, axis=0) / total
    square = np.sum((off - mean) ** 2 * weight, axis=0)
    most = chi_square_quantile(1.0 - LOST_SHARE, max(1, len(decoding.sets) - 1))
    finest = min(phases.period_px for phases in decoding.sets)
    with np.errstate(invalid="ignore"):
        kept = (square < most) & (np.abs(mean) < SAME_PERIODS * finest)
    chosen = np.zeros_like(ambiguous)
    chosen[ambiguous] = kept
    results["coordinate"][chosen] = (near + mean)[kept]
    results["sigma"][chosen] = total[kept] ** -0.5
    results["reason"][chosen] = Reason.OK


def _alone(coordinate: FloatMap, doubtful: BoolMap, sure: BoolMap, reach_px: float) -> BoolMap:
    """Mark doubtful pixels that are on the surface of too few sure pixels around them."""
    near, count = _around(coordinate, doubtful, sure, reach_px)
    marked = np.zeros_like(doubtful)
    marked[doubtful] = near < SUPPORT_SHARE * np.maximum(count, MIN_SURE)
    return marked


def _beside_steps(coordinate: FloatMap, doubtful: BoolMap, sure: BoolMap, far_px: float) -> BoolMap:
    """Mark doubtful pixels with sure ones around them that are farther than a distance."""
    near, count = _around(coordinate, doubtful, sure, far_px)
    marked = np.zeros_like(doubtful)
    marked[doubtful] = count - near > STEP_SHARE * np.maximum(count, MIN_SURE)
    return marked


def _around(
    coordinate: FloatMap, doubtful: BoolMap, sure: BoolMap, reach_px: float
) -> tuple[FloatMap, FloatMap]:
    """Number of sure pixels in the window of each doubtful one that are nearer than a distance, and
    of all sure ones there."""
    rows, columns = np.nonzero(doubtful)
    half = SUPPORT_WINDOW // 2
    own = coordinate[rows, columns]
    padded = np.pad(np.where(sure, coordinate, np.nan), half, constant_values=np.nan)
    near, count = np.zeros(rows.size), np.zeros(rows.size)
    for down in range(SUPPORT_WINDOW):
        for right in range(SUPPORT_WINDOW):
            off = np.abs(padded[rows + down, columns + right] - own)
            count += ~np.isnan(off)
            with np.errstate(invalid="ignore"):
                near += off < reach_px
    return near, count
