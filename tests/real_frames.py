"""Frames of the real captures, and what their patterns have in common."""

from __future__ import annotations

import numpy as np
from PIL import Image

from fringeworks.patterns import Uniform

BACK = tuple(np.radians((120.0, 0.0, -120.0)))
"""Three steps that run backwards, as some of them say, rad."""
LIGHT = (Uniform("white"), Uniform("black"))


def half(path):
    """A frame at half of its size, counts: every pixel is the mean of four."""
    image = np.asarray(Image.open(path).convert("L"), float)
    h, w = (n // 2 for n in image.shape)
    return image[: 2 * h, : 2 * w].reshape(h, 2, w, 2).mean(axis=(1, 3))


def counts(frames):
    """Frames as a camera of 8 bits gives them."""
    return [np.clip(np.rint(frame), 0, 255).astype(np.uint8) for frame in frames]
