"""The combination of the channels of colour images whose phases have the least noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.stack.noise import spatial_noise
from fringeworks.types import FloatMap

BEST = "best"
"""Word that stands for this combination in place of channels."""
SAMPLED_PX = 20_000
"""Pixels from which weights are computed: they determine a mean to 1 %."""
PATCH_PX = 256
"""Side of the part of a frame in which noise is measured: 65 000 pixels determine a standard
deviation to 1 %."""
PATCH_FRAMES = 3
"""Frames in which noise is measured; their median keeps out a frame with edges of a Gray code."""
LIT_SIGMAS = 3.0
"""Signal over noise from which on a pixel counts; below it, the signal is that of the noise."""
PASSES = 60
"""Passes of the fixed point. It converges by a factor of two or more in each."""


def best_weights(frames: Sequence[NDArray[Any]]) -> FloatMap:
    """Weights of red, green and blue, whose sum is 1.

    Parameters
    ----------
    frames : sequence of (h, w, 3) arrays
        Of one scene under changing light, counts.

    Returns
    -------
    (3,) weights. Without a lit pixel, those of equal parts.

    Notes
    -----
    A phase's standard deviation is in proportion to √(Σ w² σ²) / Σ w s, with the noise σ of a
    channel and its signal s, the standard deviation of a pixel over the frames. The weights have
    the least geometric mean over the pixels: with Σ w² σ² = 1 they maximise the mean of log Σ w s,
    which has one maximum; there w is in proportion to the mean of s / Σ w s over σ². Noise that
    channels have in common, as after demosaicing, is not regarded.
    """
    sigma = np.array([_noise([frame[..., c] for frame in frames]) for c in range(3)])
    rows, columns = frames[0].shape[:2]
    step = max(1, int(np.sqrt(rows * columns / SAMPLED_PX)))
    sample = np.stack([f[::step, ::step].astype(np.float64) for f in frames])
    signal = np.sqrt(np.maximum(sample.var(axis=0) - sigma**2, 0.0)).reshape(-1, 3)
    signal = signal[(signal > LIT_SIGMAS * sigma).any(axis=1)]
    weights = np.full(3, 1.0 / 3.0)
    if not len(signal):
        return weights
    for _ in range(PASSES):
        share = np.mean(signal / np.maximum(signal @ weights, 1e-12)[:, None], axis=0)
        weights = share / sigma**2
        weights /= weights.sum()
    return weights


def _noise(frames: Sequence[NDArray[Any]]) -> float:
    """Standard deviation of a channel's noise, counts."""
    rows, columns = frames[0].shape
    top, left = max(0, (rows - PATCH_PX) // 2), max(0, (columns - PATCH_PX) // 2)
    part = (slice(top, top + PATCH_PX), slice(left, left + PATCH_PX))
    chosen = frames[:: max(1, len(frames) // PATCH_FRAMES)][:PATCH_FRAMES]
    found = [spatial_noise([frame[part].astype(np.float64)]).read_counts for frame in chosen]
    # Rounding to whole counts is noise, too.
    return max(float(np.median(found)), float(np.sqrt(1.0 / 12.0)))


def combined(frame: NDArray[Any], weights: FloatMap) -> NDArray[np.float32]:
    """A frame in grey: the weighted mean of its channels, or the limit of its type where a channel
    is at that limit."""
    grey = (frame @ weights).astype(np.float32)
    if frame.dtype.kind in "ui":
        limit = np.iinfo(frame.dtype).max
        grey[(frame == limit).any(axis=2)] = limit
    return np.asarray(grey, np.float32)
