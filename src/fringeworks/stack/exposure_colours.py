"""The colour of a scene from several exposures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.stack.frames import Stack, saturation_of
from fringeworks.types import BoolMap, FloatMap

LIT_SHARE = 0.05
"""Share of the brightest light, the 99th percentile of the pixels that both exposures hold, from
which on a pixel counts for the ratio of two exposures: darker ones are mostly noise. Empirical."""
FEWEST = 50
"""Smallest number of pixels that tell the ratio of two exposures, to 1 % with noise of 7 %."""


def colour_of_exposures(stacks: Sequence[Stack]) -> FloatMap | None:
    """Return the colour of a scene from several exposures of one camera, (h, w, 3).

    Parameters
    ----------
    stacks : sequence of Stack
        Of the same scene, with colours.

    Returns
    -------
    (h, w, 3) float32 array in counts of the first exposure; None where a stack has no colour. Every
    pixel is taken from the longest exposure that holds it without saturation, or from the shortest.
    """
    seen = [stack.colour for stack in stacks]
    colours = [np.asarray(colour, np.float32) for colour in seen if colour is not None]
    if not colours or len(colours) < len(stacks):
        return None
    held = [~_saturated(stack) for stack in stacks]
    gains = [1.0]
    for colour, here in zip(colours[1:], held[1:], strict=True):
        gains.append(_ratio(colours[0], colour, held[0] & here))
    # A large gain belongs to a short exposure; unknown ones are not used.
    order = sorted(
        (k for k in range(len(stacks)) if np.isfinite(gains[k])), key=lambda k: -gains[k]
    )
    found = gains[order[0]] * colours[order[0]]
    for k in order[1:]:
        found[held[k]] = np.float32(gains[k]) * colours[k][held[k]]
    return np.asarray(found, np.float32)


def _saturated(stack: Stack) -> BoolMap:
    """Where a frame of a stack is at its limit."""
    limit = saturation_of(stack.frames[0].dtype, stack.saturation)
    full = np.zeros(stack.frames[0].shape, bool)
    for frame in stack.frames:
        full |= frame >= limit
    return full


def _ratio(first: FloatMap, other: FloatMap, both: BoolMap) -> float:
    """Light of the first exposure over that of another; NaN where too few pixels tell it."""
    a, b = first[both].sum(axis=-1), other[both].sum(axis=-1)
    if not a.size:
        return float("nan")
    lit = (a > LIT_SHARE * np.quantile(a, 0.99)) & (b > LIT_SHARE * np.quantile(b, 0.99))
    return float(np.median(a[lit] / b[lit])) if np.count_nonzero(lit) >= FEWEST else float("nan")
