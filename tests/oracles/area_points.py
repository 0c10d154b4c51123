"""Errors of the points of areas and their pieces of surface, array by array."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.evaluate.area_points import Term
from fringeworks.types import FloatMap


def sigma_of(terms: Sequence[Term]) -> float:
    """The whole standard deviation, as ``area_points.shares_of`` has it in parts."""
    variance, blur = 0.0, 0.0
    by_rig: FloatMap | float = 0.0
    for area, weights, direction in terms:
        change = weights * _along(area.by_value, direction)
        if area.noise.any():
            noise = change * area.noise
            variance += float(noise @ noise)
        blur += float(change @ area.blur)
        if area.by_rig is None:
            variance += float(np.sum(np.bincount(area.patch, change * area.common) ** 2))
            continue
        if direction.ndim == 1:
            moved = np.outer(direction, np.bincount(area.cell, weights, len(area.by_rig)))
        else:
            parts = (weights * direction[:, k] for k in range(3))
            moved = np.stack([np.bincount(area.cell, one, len(area.by_rig)) for one in parts])
        by_rig = by_rig + np.einsum("kc,ckj->j", moved, area.by_rig)
    return float(np.sqrt(variance + blur**2 + np.sum(np.square(by_rig))))


def _along(vectors: FloatMap, direction: FloatMap) -> FloatMap:
    """Parts of vectors (n, 3) along one direction (3,) or one of each, (n,)."""
    if direction.ndim == 1:
        return np.asarray(vectors @ direction)
    return np.asarray(np.einsum("nc,nc->n", vectors, direction))


def slope(points: FloatMap, axis: int) -> FloatMap:
    """Difference to the next pixel along an axis: central, or one-sided at gaps and borders."""
    step = np.diff(points, axis=axis)
    pad = [(0, 0)] * 3
    pad[axis] = (0, 1)
    after = np.pad(step, pad, constant_values=np.nan)
    pad[axis] = (1, 0)
    before = np.pad(step, pad, constant_values=np.nan)
    both = 0.5 * (after + before)
    return np.where(np.isfinite(both), both, np.where(np.isfinite(after), after, before))
