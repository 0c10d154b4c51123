"""White balance: gains that make a grey card grey, in linear light."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.stack.frames import Stack
from fringeworks.types import FloatMap, InputError, finite, unmasked, whole

CHANNELS = ("red", "green", "blue")
"""Names of the channels, in their order."""
Gains = tuple[float, float, float]
"""Factors of red, green and blue; 1 for green where they were measured."""


def white_balance(
    capture: Stack | FloatMap, *, box: tuple[int, int, int, int] | None = None
) -> Gains:
    """Measure the gains that make a grey card grey.

    Parameters
    ----------
    capture : Stack, or (h, w, 3) array
        Frames of a colour camera that show something grey or white, such as a grey card or the
        white of a board, under the light of the scene; or what the camera saw of it, counts in
        proportion to the light.
    box : (left, top, right, bottom), optional
        Columns and rows of the grey part, the last ones left out; the whole frame by default.

    Returns
    -------
    Gains of red, green and blue, for ``Stack.white_balance``: 1 for green.

    Raises
    ------
    InputError for frames without colour, a box outside the frame, samples at the saturation, and a
    channel without light.

    Examples
    --------
    >>> import numpy as np
    >>> white_balance(np.full((20, 30, 3), (50.0, 100.0, 80.0)), box=(5, 5, 15, 15))
    (2.0, 1.0, 1.25)
    """
    seen = capture.colour if isinstance(capture, Stack) else unmasked(capture, "colour")
    if seen is None or np.ndim(seen) != 3 or np.shape(seen)[2] != len(CHANNELS):
        got = "grey frames" if seen is None else f"shape {np.shape(seen)}"
        raise InputError(f"white balance: expected colour (h, w, 3), got {got}")
    height, width = np.shape(seen)[:2]
    edges = (0, 0, width, height) if box is None else box
    whole_px = isinstance(edges, Sequence) and len(edges) == 4
    whole_px = whole_px and all(whole(v, 0, max(height, width)) for v in edges)
    left, top, right, bottom = edges if whole_px else (0, 0, 0, 0)
    if not (left < right <= width and top < bottom <= height):
        raise InputError(
            f"white balance: expected a box within {width} × {height} px, got {edges!r:.80}"
        )
    part = (slice(top, bottom), slice(left, right))
    if isinstance(capture, Stack) and capture.saturation is not None:
        bright = max(float(np.max(frame[part])) for frame in capture.frames)
        if bright >= capture.saturation:
            raise InputError(
                f"white balance: expected counts below the saturation {capture.saturation:g}, got "
                f"{bright:g}; expose for a shorter time, or choose another box"
            )
    mean = np.asarray(seen, np.float64)[part].reshape(-1, len(CHANNELS)).mean(axis=0)
    for name, value in zip(CHANNELS, mean, strict=True):
        if not (finite(value) and value > 0):
            raise InputError(f"white balance: expected light in every channel, got none in {name}")
    red, green, blue = (float(v) for v in mean)
    return green / red, 1.0, green / blue


def check_gains(gains: Sequence[float]) -> Gains:
    """Three gains as they were given.

    Raises
    ------
    InputError for another number of gains, and for those that are not positive.
    """
    values = tuple(gains)
    if len(values) != len(CHANNELS) or not finite(*values) or min(values) <= 0:
        raise InputError(f"white balance: expected three gains > 0, got {values}")
    red, green, blue = (float(v) for v in values)
    return red, green, blue
