"""The corners of a board in one photograph, and the photograph made ready for detectors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import LARGEST, NUMBERS, FloatMap, Frozen, InputError
from fringeworks.types.packages import cv2

MIN_CORNERS = 8
"""Smallest number of corners of a usable view. A pose has six parameters and a corner gives two
coordinates, so eight corners leave ten coordinates to check the pose with."""
MIN_PAPER_WINDOW_PX = 31
"""Smallest side of the window in which white paper is looked for, px: larger than a square of the
smallest boards that can be found."""
PAPER_WINDOWS_ACROSS = 12
"""How many such windows fit along the longer side of the frame. A board that fills a third of the
frame with 8 squares then has white paper in every window, and the light is even within one.
Empirical."""
LEAST_IMAGE_PX = 16
"""Smallest side of an image in which a board is looked for, px: three squares of five pixels."""
SHRINKING = 4
"""Factor by which the image is made smaller before white paper is looked for: the light is smooth,
and a large window is slow."""
MIN_PAPER_SHARE = 0.02
"""Lower bound on the brightness of paper, relative to the brightest place: noise in dark corners
of the frame must not be raised to full contrast."""
PAPER_COUNTS = 230.0
"""Brightness of paper in the flattened image, counts of 8 bit, with some headroom to 255."""


@dataclass(frozen=True, eq=False, repr=False)
class BoardView(Frozen):
    """The corners of a board that one photograph shows, in camera pixels.

    An ``Observation`` adds the projector coordinates at these corners.
    """

    index: NDArray[np.intp]
    """Which of the board's points they are, (m,), rows of ``Board.points_mm``."""
    pixels: FloatMap
    """Where they are, (m, 2), camera px."""
    ink_px: FloatMap | None = None
    """Areas of the circles, (m,), px²; None for other boards."""
    blur_px: FloatMap | None = None
    """Standard deviation of the blurred edges at each corner, (m,), px; None for circles."""


def flattened(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Remove uneven light: divide by the brightness of white paper around every pixel.

    Parameters
    ----------
    image : (h, w) array, counts

    Returns
    -------
    (h, w) uint8 array, for OpenCV's detectors. Corners are fitted in the image itself.
    """
    values = counts_of(image)
    values -= values.min()
    window = max(MIN_PAPER_WINDOW_PX, (max(image.shape) // PAPER_WINDOWS_ACROSS) | 1)
    scale = 1.0 / SHRINKING
    small = cv2.resize(values, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    side = window // SHRINKING
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    paper = cv2.GaussianBlur(cv2.dilate(small, kernel), (0, 0), window / SHRINKING)
    paper = cv2.resize(paper, values.shape[::-1], interpolation=cv2.INTER_LINEAR)
    least = MIN_PAPER_SHARE * float(paper.max()) + 1e-6
    return np.minimum(values / np.maximum(paper, least) * PAPER_COUNTS, 255.0).astype(np.uint8)


def counts_of(image: NDArray[Any]) -> NDArray[np.float32]:
    """The counts of an image that is large enough for a board, single precision.

    Raises
    ------
    InputError for other shapes and types, and counts that are far too large.
    """
    if image.ndim != 2 or min(image.shape) < LEAST_IMAGE_PX:
        raise InputError(
            f"image: expected {LEAST_IMAGE_PX} × {LEAST_IMAGE_PX} px or more, got {image.shape}"
        )
    if image.dtype.kind not in f"{NUMBERS}b":
        raise InputError(f"image: expected real counts, got {image.dtype}")
    values = np.where(np.isfinite(image), image, 0)
    if np.abs(values).max() > LARGEST:
        raise InputError(f"image: expected counts up to {LARGEST:g}, got more")
    return values.astype(np.float32)


def eight_bit(image: NDArray[Any]) -> NDArray[np.uint8]:
    """The photograph in 8 bit as it is; brighter ones are scaled to 255 counts."""
    values = np.nan_to_num(image.astype(np.float64))
    scaled = values * min(1.0, 255.0 / max(float(values.max()), 1.0))
    return np.asarray(np.clip(scaled, 0.0, 255.0), np.uint8)
