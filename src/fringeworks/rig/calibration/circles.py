"""Circles of a board: found by OpenCV, then measured by their centres of gravity."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import MIN_CORNERS, BoardView, flattened
from fringeworks.types import BoardNotFound, BoolMap, FloatMap

MIN_CIRCLE_PX2 = 20.0
"""Smallest area of a circle that is looked for, px²: five pixels across. Smaller ones have no
reliable centre."""
CELL_SHARE = 4.0
"""Largest area of a circle that is looked for, as a divisor of the frame's area per circle. A
circle fills a quarter of its cell or so, and the board never more than the frame."""
DISC_REACH = 0.48
"""Radius of the disc in which a circle is measured, over the distance to the nearest circle: just
below half, so that no neighbour enters."""
MIN_DISC_PX = 3
"""Smallest radius of that disc, px."""
DARK_PERCENT = 5
"""Percentile of the brightness around a circle that is taken for ink; unlike the minimum, a few
noisy pixels do not change it."""
BRIGHT_PERCENT = 95
"""Percentile of the brightness around a circle that is taken for paper."""
INK_PERCENT = 97
"""Percentile of the darkness in a disc that is taken for full ink: darker than the blurred rim, and
not the noise of single pixels. Only the measured area of the circle depends on it."""
RANGE_PERCENT = (1.0, 99.0)
"""Percentiles of a photograph that become white and black in its negative: glare and dead pixels
must not take the contrast."""
MIN_PAPER_PIXELS = 20
"""Smallest number of paper pixels from which the light is fitted: a plane has three parameters."""
PAPER_NOISE = 0.5
"""Paper pixels that differ from the fitted light by less than this, relative to it, count as
exactly white, so that noise far from the circle does not move its centre. Larger differences are
not noise."""
MAX_CENTRE_SHIFT = 0.2
"""Largest distance of a centre of gravity from OpenCV's centre, over the disc's radius. A circle
that is partly hidden moves further."""


def circles_view(image: NDArray[Any], board: Board) -> BoardView:
    """Find the circles of a board.

    Raises
    ------
    InputError where no such grid of circles is found.
    """
    symmetric = board.kind == "circles"
    grid = cv2.CALIB_CB_SYMMETRIC_GRID if symmetric else cv2.CALIB_CB_ASYMMETRIC_GRID
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.maxArea = image.size / (CELL_SHARE * board.columns * board.rows)
    parameters.minArea = MIN_CIRCLE_PX2
    detector = cv2.SimpleBlobDetector.create(parameters)
    grey = flattened(image)
    # Black circles on white are usual; white ones on black are found in the negative.
    for white in (False, True):
        for method in (0, cv2.CALIB_CB_CLUSTERING):
            found, centres = cv2.findCirclesGrid(
                _negative(image) if white else grey,
                board.grid,
                flags=grid | method,
                blobDetector=detector,
            )
            if found:
                start = np.asarray(centres, np.float64).reshape(-1, 2)
                return _centroids(image.astype(np.float64), start, white)
    raise BoardNotFound(f"expected {board.columns} × {board.rows} circles, found no such grid")


def _negative(image: NDArray[Any]) -> NDArray[np.uint8]:
    """The negative of a photograph in 8 bit, from its darkest to its brightest counts."""
    low, high = (float(v) for v in np.nanpercentile(image, RANGE_PERCENT))
    level = np.clip((np.nan_to_num(image) - low) / max(high - low, 1e-6), 0.0, 1.0)
    return np.asarray(np.rint(255.0 * (1.0 - level)), np.uint8)


def _centroids(image: FloatMap, start: FloatMap, white: bool) -> BoardView:
    """Measure circles by the centres of gravity of their ink, which blur does not move."""
    distance = np.linalg.norm(start[:, None] - start[None], axis=2)
    distance[np.diag_indices(len(start))] = np.inf
    half = int(max(MIN_DISC_PX, DISC_REACH * np.median(distance.min(axis=1))))
    dy, dx = np.mgrid[-half : half + 1, -half : half + 1]
    disc = np.hypot(dx, dy) <= half
    pixels, ink = np.full(start.shape, np.nan), np.zeros(len(start))
    for k, centre in enumerate(np.rint(start).astype(int)):
        top, left = centre[1] - half, centre[0] - half
        part = image[max(top, 0) : top + 2 * half + 1, max(left, 0) : left + 2 * half + 1]
        # The brightness of white circles over the black around them is linear as well.
        measure = _brightness if white else _darkness
        darkness = measure(part, disc, dx, dy) if part.shape == disc.shape else None
        if darkness is None:
            continue
        full, dark = darkness
        pixels[k] = centre + np.array([np.sum(dark * dx), np.sum(dark * dy)]) / dark.sum()
        ink[k] = dark.sum() / max(full, 1e-6)
    shift = np.linalg.norm(pixels - start, axis=1)
    good = np.isfinite(pixels).all(axis=1) & (shift < MAX_CENTRE_SHIFT * half)
    if good.sum() < MIN_CORNERS:
        raise BoardNotFound(
            f"expected {MIN_CORNERS} circles or more inside the image, found {good.sum()}"
        )
    return BoardView(np.flatnonzero(good), pixels[good], ink_px=ink[good])


def _ground(
    part: FloatMap, disc: BoolMap, dx: NDArray[np.int_], dy: NDArray[np.int_], *, black: bool
) -> tuple[BoolMap, FloatMap] | None:
    """The paper around a circle and its counts, which may be uneven: a plane is fitted to it.

    None where there is too little paper.
    """
    dark, bright = (np.percentile(part, p) for p in (DARK_PERCENT, BRIGHT_PERCENT))
    middle = 0.5 * (dark + bright)
    paper = disc & ((part < middle) if black else (part > middle))
    paper = ndimage.binary_erosion(paper, iterations=1, border_value=1) & disc
    if paper.sum() < MIN_PAPER_PIXELS:
        return None
    design = np.stack((np.ones_like(dx), dx, dy), axis=-1).astype(np.float64)
    return paper, design @ np.linalg.lstsq(design[paper], part[paper], rcond=None)[0]


def _darkness(
    part: FloatMap, disc: BoolMap, dx: NDArray[np.int_], dy: NDArray[np.int_]
) -> tuple[float, FloatMap] | None:
    """Darkness of full ink, and of every pixel in a disc: 0 for paper, 1 for no light.

    None where there is too little paper.
    """
    ground = _ground(part, disc, dx, dy, black=False)
    if ground is None:
        return None
    paper, light = ground
    darkness = np.where(disc, 1.0 - part / np.maximum(light, 1e-6), 0.0)
    full = float(np.percentile(darkness[disc], INK_PERCENT))
    darkness[paper & (np.abs(darkness) < PAPER_NOISE)] = 0.0
    return full, darkness


def _brightness(
    part: FloatMap, disc: BoolMap, dx: NDArray[np.int_], dy: NDArray[np.int_]
) -> tuple[float, FloatMap] | None:
    """Brightness of a full white circle, and of every pixel in a disc, in counts over the black.

    None where there is too little black around the circle.
    """
    ground = _ground(part, disc, dx, dy, black=True)
    if ground is None:
        return None
    paper, light = ground
    brightness = np.where(disc, part - light, 0.0)
    full = float(np.percentile(brightness[disc], INK_PERCENT))
    brightness[paper & (np.abs(brightness) < PAPER_NOISE * full)] = 0.0
    return full, brightness
