"""Pictures of one bit: grey levels by error diffusion, and planes of images of 24 bit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import FloatMap

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
"""Part of a count by which each line starts after the one before: its multiples are the most evenly
spread ones, so that lit pixels of lines beside each other are far apart."""
DECIMALS = 9
"""Decimals to which sums of shares are rounded, so that they are the same on every machine."""
PLANES = 24
"""Planes of one bit in an image of three colours with 8 bit each."""


def diffused(shares: FloatMap, length: int) -> NDArray[np.uint8]:
    """Draw lines of zeros and ones whose means are grey levels.

    Parameters
    ----------
    shares : (n,) array
        Grey level of each line, 0…1.
    length : int
        Pixels of a line.

    Returns
    -------
    (length, n) array: column k is line k. The sum of its first m pixels differs from m times its
    grey level by less than one.

    Notes
    -----
    Error diffusion along the lines: the error of a pixel goes to the next one of its line. What is
    left lies at high spatial frequencies, which a defocused projector does not transmit. No error
    crosses the lines. Diffusion in two dimensions by Floyd and Steinberg moves a fringe by 0.16 px,
    which no residual shows: every step is moved alike.

    Examples
    --------
    >>> diffused(np.array([0.0, 0.25, 0.5, 1.0]), 8).sum(axis=0).tolist()
    [0, 2, 4, 8]
    """
    steps = np.arange(length + 1)[:, None] * shares + GOLDEN * np.arange(len(shares)) % 1.0
    return np.diff(np.floor(np.round(steps, DECIMALS)), axis=0).astype(np.uint8)


def packed(pictures: Sequence[NDArray[Any]], bits: int) -> NDArray[np.uint32]:
    """Pack pictures into one image.

    Parameters
    ----------
    pictures : sequence of (rows, columns) arrays
        At most 24 / ``bits`` of them, with counts below 2^bits.
    bits : int

    Returns
    -------
    (rows, columns) array: picture k has the bits from k · ``bits`` on.
    """
    words = np.zeros(pictures[0].shape, np.uint32)
    for k, picture in enumerate(pictures):
        words |= picture.astype(np.uint32) << np.uint32(k * bits)
    return words
