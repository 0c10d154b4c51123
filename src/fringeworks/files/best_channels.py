"""The combination of the channels of colour images whose phases have the least noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.bayer_image import BYTES_PER_PX
from fringeworks.files.scene_colour import Colours
from fringeworks.signal.bands import row_bands
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


@dataclass(frozen=True, eq=False)
class Sampled:
    """What the weights are computed from of one image."""

    pixels: FloatMap
    """(n, 3), counts, at the same places in every image."""
    patch: NDArray[np.float64]
    """A part of the middle, (h, w, 3), counts."""
    kind: np.dtype[Any]
    """Type of the counts."""
    shape: tuple[int, ...]
    """Of the image."""


def sampled(image: Colours) -> Sampled:
    """The sample of a colour image, in bands, so that one of raw files stays small."""
    rows, columns = image.shape[:2]
    step = max(1, int(np.sqrt(rows * columns / SAMPLED_PX)))
    top, left = max(0, (rows - PATCH_PX) // 2), max(0, (columns - PATCH_PX) // 2)
    pixels = []
    for band in row_bands((rows, columns), BYTES_PER_PX):
        first = -(-band.rows.start // step) * step - band.rows.start
        pixels.append(np.asarray(image[band.rows])[first::step, ::step, :3].reshape(-1, 3))
    patch = np.asarray(image[top : top + PATCH_PX])[:, left : left + PATCH_PX, :3]
    return Sampled(
        np.concatenate(pixels).astype(np.float64),
        patch.astype(np.float64),
        image.dtype,
        image.shape,
    )


def best_weights(images: Sequence[Sampled]) -> FloatMap:
    """Weights of red, green and blue, whose sum is 1.

    Parameters
    ----------
    images : sequence of Sampled
        Of one scene under changing light.

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
    sigma = np.array([_noise([image.patch[..., c] for image in images]) for c in range(3)])
    sample = np.stack([image.pixels for image in images])
    signal = np.sqrt(np.maximum(sample.var(axis=0) - sigma**2, 0.0))
    signal = signal[(signal > LIT_SIGMAS * sigma).any(axis=1)]
    weights = np.full(3, 1.0 / 3.0)
    if not len(signal):
        return weights
    for _ in range(PASSES):
        share = np.mean(signal / np.maximum(signal @ weights, 1e-12)[:, None], axis=0)
        weights = share / sigma**2
        weights /= weights.sum()
    return weights


def _noise(patches: Sequence[FloatMap]) -> float:
    """Standard deviation of a channel's noise, counts."""
    chosen = patches[:: max(1, len(patches) // PATCH_FRAMES)][:PATCH_FRAMES]
    found = [spatial_noise([patch]).read_counts for patch in chosen]
    # Rounding to whole counts is noise, too.
    return max(float(np.median(found)), float(np.sqrt(1.0 / 12.0)))


def combined(image: Colours, weights: FloatMap) -> NDArray[np.float32]:
    """A frame in grey: the weighted mean of its channels, or the limit of its type where a channel
    is at that limit."""
    grey = np.empty(image.shape[:2], np.float32)
    limit = np.iinfo(image.dtype).max if image.dtype.kind in "ui" else None
    for band in row_bands(grey.shape, BYTES_PER_PX):
        part = np.asarray(image[band.rows])[..., :3]
        found = (part @ weights).astype(np.float32)
        if limit is not None:
            found[(part == limit).any(axis=2)] = limit
        grey[band.rows] = found
    return grey
