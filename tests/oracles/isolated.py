"""Readable twin of the kernel that marks pixels whose coordinate no neighbour shares."""

from __future__ import annotations

import numpy as np

TYPICAL_STEPS = 2.0
MAX_STEEPENING = 3.0
CONFIDENCE = 5.0
NEAR_SUPPORT, WIDE_SUPPORT, MIN_NEAR = 3, 5, 4


def difference(a, b, repeats):
    """Difference of coordinates; where they repeat, the smallest one."""
    plain = a - b
    return plain if np.isinf(repeats) else plain - repeats * np.round(plain / repeats)


def typical_step(coordinate, repeats):
    """The larger of the median differences of neighbours along rows and along columns."""
    medians = []
    for axis in (0, 1):
        ends = np.moveaxis(coordinate, axis, 0)
        steps = np.abs(difference(ends[1:], ends[:-1], repeats))
        steps = np.sort(steps[np.isfinite(steps)])
        medians.append(steps[steps.size // 2] if steps.size else 0.0)
    return max(medians)


def moved(values, down, right):
    """The value some pixels down and to the right of each pixel; NaN outside the frame."""
    found = np.full_like(values, np.nan)
    height, width = values.shape
    rows, columns = np.mgrid[:height, :width]
    inside = (rows + down >= 0) & (rows + down < height)
    inside &= (columns + right >= 0) & (columns + right < width)
    found[inside] = values[rows[inside] + down, columns[inside] + right]
    return found


def isolated(coordinate, sigma, repeats=np.inf):
    """True for the pixels that fewer neighbours share than a surface has, (h, w).

    A line through a pixel has two of its eight neighbours, and four of the next 24. A pixel needs one
    more. The next 24 count where fewer than four of the eight are measured.
    """
    if min(coordinate.shape) < 3:
        return np.zeros(coordinate.shape, bool)
    smooth = TYPICAL_STEPS * typical_step(coordinate, repeats)
    near, wide, measured = (np.zeros(coordinate.shape, int) for _ in range(3))
    for down in range(-2, 3):
        for right in range(-2, 3):
            distance = max(abs(down), abs(right))
            if distance == 0:
                continue
            there = moved(coordinate, down, right)
            step = difference(coordinate, there, repeats)
            noise = CONFIDENCE * np.sqrt(sigma**2 + moved(sigma, down, right) ** 2)
            allowed = np.full_like(coordinate, distance * smooth)
            if distance == 1:
                beyond = moved(coordinate, 2 * down, 2 * right)
                onward = difference(there, beyond, repeats)
                steep = np.where(step * onward > 0, MAX_STEEPENING * np.abs(onward), 0.0)
                allowed = np.maximum(allowed, steep)
                near += np.abs(step) <= allowed + noise
                measured += np.isfinite(there)
            wide += np.abs(step) <= allowed + noise
    sparse = measured < MIN_NEAR
    shared = (near >= NEAR_SUPPORT) | (sparse & (wide >= WIDE_SUPPORT))
    return np.isfinite(coordinate) & ~shared
