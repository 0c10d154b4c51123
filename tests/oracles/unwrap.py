"""Readable twin of unwrapping by sorting by reliability."""

from __future__ import annotations

import numpy as np

MAX_ROUGHNESS = 1e30
"""Roughness of pixels at the border or beside masked ones."""


def wrap(x):
    """Values modulo 2π, −π…π."""
    return x - 2 * np.pi * np.round(x / (2 * np.pi))


def unwrap_reliability(phase: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Unwrap by joining groups of pixels along the smoothest edges first; NaN where masked."""
    h, w = phase.shape
    rough = np.full((h, w), MAX_ROUGHNESS)
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            if mask[y - 1 : y + 2, x - 1 : x + 2].all():
                total = 0.0
                for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
                    a, b = phase[y - dy, x - dx], phase[y + dy, x + dx]
                    total += (wrap(a - phase[y, x]) - wrap(phase[y, x] - b)) ** 2
                rough[y, x] = total
    edges = []
    for y in range(h):
        for x in range(w):
            for dy, dx in ((0, 1), (1, 0)):
                y2, x2 = y + dy, x + dx
                if y2 < h and x2 < w and mask[y, x] and mask[y2, x2]:
                    edges.append(
                        (min(rough[y, x] + rough[y2, x2], MAX_ROUGHNESS), (y, x), (y2, x2))
                    )
    edges.sort(key=lambda edge: edge[0])
    group = {(y, x): [(y, x)] for y in range(h) for x in range(w) if mask[y, x]}
    order = dict.fromkeys(group, 0)
    for _, a, b in edges:
        if group[a] is group[b]:
            continue
        step = -int(np.round((phase[b] - phase[a]) / (2 * np.pi)))
        shift = order[a] + step - order[b]
        for pixel in group[b]:
            order[pixel] += shift
        joined = group[a] + group[b]
        for pixel in joined:
            group[pixel] = joined
    out = np.full((h, w), np.nan)
    for pixel, k in order.items():
        out[pixel] = phase[pixel] + 2 * np.pi * k
    return out
