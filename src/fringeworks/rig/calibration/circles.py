"""Circles of a board: found by OpenCV, then measured by their centres of gravity."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import MIN_CORNERS, BoardView, eight_bit, flattened
from fringeworks.rig.calibration.outliers import mapped, off_board
from fringeworks.types import BoardNotFound, BoolMap, FloatMap
from fringeworks.types.packages import cv2

MIN_CIRCLE_PX2 = 20.0
"""Smallest area of a circle that is looked for, px²: five pixels across. Smaller ones have no
reliable centre."""
CELL_SHARE = 4.0
"""Largest area of a circle that is looked for, as a divisor of the frame's area per circle. A
circle fills a quarter of its cell or so, and the board never more than the frame."""
DISC_REACH = 0.48
"""Radius of the disc in which a circle is measured, over the distance to the nearest circle: just
below half, so that no neighbour enters."""
MIN_NEAREST = 0.5
"""Smallest distance to the nearest circle that is believed, over the usual one: perspective
changes it by a third over a board."""
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
CLEAR_PAPER = 0.8
"""Brightness between ink (0) and paper (1) above which a pixel next to a circle's rim counts as
paper: it shares a fifth with the ink at most."""
MIN_PAPER_PIXELS = 20
"""Smallest number of paper pixels from which the light is fitted: a plane has three parameters."""
PAPER_NOISE = 0.5
"""Paper pixels that differ from the fitted light by less than this, relative to it, count as
exactly white, so that noise far from the circle does not move its centre. Larger differences are
not noise."""
MAX_OFF_GRID = 0.3
"""Largest distance of a circle from a homography of the board, over the distance of neighbours:
lens distortion reaches a tenth, and a wrong row is a whole distance away."""
MAX_WRONG_SHARE = 0.1
"""Largest share of circles that may lie farther away: OpenCV takes something else for a hidden
circle now and then."""
MAX_INK_ERROR = 0.12
"""Largest deviation of a circle's area from that of the others, relative, after perspective: noise
makes up to 0.1, and the edge of the projector's light across a circle 0.15 or more. Empirical."""
AREA_STEP = 0.05
"""Step of the finite differences of areas, in pitches: far above rounding, and small enough for
perspective to be linear."""
MAX_CENTRE_SHIFT = 0.2
"""Largest distance of a centre of gravity from OpenCV's centre, over the disc's radius. A circle
that is partly hidden moves further."""


def circles_view(image: NDArray[Any], board: Board) -> BoardView:
    """Find the circles of a board.

    Raises
    ------
    InputError where no such grid of circles is found.
    """
    values, fewer = image.astype(np.float64), "found no such grid"
    # Black circles on white are usual; white ones on black are found in the negative.
    for white in (False, True):
        for grey in _greys(image, white):
            for found in _grids(grey, board):
                start = numbered(found, board)
                if start is None:
                    continue
                view = _without_wrong(_centroids(values, start, white), board)
                if len(view.index) >= MIN_CORNERS:
                    return view
                fewer = f"found {len(view.index)} of them inside the image and whole"
    raise BoardNotFound(f"expected {board.columns} × {board.rows} circles, {fewer}")


def _greys(image: NDArray[Any], white: bool) -> Iterator[NDArray[np.uint8]]:
    """The photograph in 8 bit with dark circles, in which OpenCV may find the grid.

    Clutter beside the board gets more contrast where light is made even or counts are stretched,
    so the photograph as it is comes last.
    """
    if white:
        yield _negative(image)
        yield np.asarray(255 - eight_bit(image), np.uint8)
    else:
        yield flattened(image)
        yield eight_bit(image)


def _grids(grey: NDArray[np.uint8], board: Board) -> Iterator[FloatMap]:
    """Grids of dark circles that OpenCV finds, (n, 2), px, in its own order."""
    symmetric = board.kind == "circles"
    grid = cv2.CALIB_CB_SYMMETRIC_GRID if symmetric else cv2.CALIB_CB_ASYMMETRIC_GRID
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.maxArea = grey.size / (CELL_SHARE * board.columns * board.rows)
    parameters.minArea = MIN_CIRCLE_PX2
    detector = cv2.SimpleBlobDetector.create(parameters)
    for method in (0, cv2.CALIB_CB_CLUSTERING):
        found, centres = cv2.findCirclesGrid(
            grey, board.grid, flags=grid | method, blobDetector=detector
        )
        if found:
            yield np.asarray(centres, np.float64).reshape(-1, 2)


def numbered(centres: FloatMap, board: Board) -> FloatMap | None:
    """Bring the circles that OpenCV found into the order of the board's points.

    OpenCV swaps neighbouring rows of asymmetric grids with an even number of rows, mirrors square
    grids, and may name one circle twice where it misses another.

    Parameters
    ----------
    centres : (n, 2) array
        Centres of circles, row by row as OpenCV numbers them, px.
    board : Board

    Returns
    -------
    (n, 2) array; of the orders that are not mirrored, the one whose rows run from left to right and
    from top to bottom. None where no order is the image of the board.
    """
    across, down = board.grid
    rows = centres.reshape(down, across, 2)
    orders = [rows]
    if board.kind == "asymmetric-circles" and down % 2 == 0:
        orders.append(rows.reshape(down // 2, 2, across, 2)[:, ::-1].reshape(down, across, 2))
    if across == down:
        orders.append(rows.transpose(1, 0, 2))
    orders += [order[:, ::-1] for order in orders]
    orders += [order[::-1] for order in orders]
    best: tuple[float, FloatMap] | None = None
    for order in orders:
        trial = order.reshape(-1, 2)
        upright = _uprightness(trial, board)
        if upright is not None and (best is None or upright > best[0]):
            best = (upright, trial)
    return None if best is None else best[1]


def _uprightness(centres: FloatMap, board: Board) -> float | None:
    """How far a board's x runs to the right and its y down; None if it is no image of the board."""
    places = board.points_mm[:, :2] / board.pitch_mm
    homography, _ = cv2.findHomography(places, centres, cv2.LMEDS)
    if homography is None:
        return None
    H = np.asarray(homography, np.float64)
    middle = places.mean(axis=0)
    along, down = mapped(H, middle + np.eye(2)) - mapped(H, middle[None])
    if along[0] * down[1] - along[1] * down[0] <= 0:
        return None  # mirrored
    off = np.linalg.norm(mapped(H, places) - centres, axis=1)
    pitch = min(np.linalg.norm(along), np.linalg.norm(down))
    if np.mean(off > MAX_OFF_GRID * pitch) > MAX_WRONG_SHARE:
        return None
    return float(along[0] + down[1])


def _without_wrong(view: BoardView, board: Board) -> BoardView:
    """The view without circles that are not whole: others say another place or another size."""
    assert view.ink_px is not None
    places = board.points_mm[view.index, :2] / board.pitch_mm
    good = ~off_board(places, view.pixels)
    homography = None
    if good.sum() >= MIN_CORNERS:
        homography, _ = cv2.findHomography(places[good], view.pixels[good], cv2.LMEDS)
    if homography is not None:
        ink = view.ink_px / _areas(np.asarray(homography, np.float64), places)
        good &= np.abs(ink / np.median(ink[good]) - 1.0) < MAX_INK_ERROR
    return BoardView(view.index[good], view.pixels[good], ink_px=view.ink_px[good])


def _areas(homography: FloatMap, places: FloatMap) -> FloatMap:
    """Area of a square with the side of one pitch around each place, (n,), px²."""
    right, left, down, up = (
        mapped(homography, places + step)
        for step in ((AREA_STEP, 0), (-AREA_STEP, 0), (0, AREA_STEP), (0, -AREA_STEP))
    )
    (ax, ay), (bx, by) = (right - left).T, (down - up).T
    return np.asarray(np.abs(ax * by - ay * bx) / (2.0 * AREA_STEP) ** 2)


def _negative(image: NDArray[Any]) -> NDArray[np.uint8]:
    """The negative of a photograph in 8 bit, from its darkest to its brightest counts."""
    low, high = (float(v) for v in np.nanpercentile(image, RANGE_PERCENT))
    level = np.clip((np.nan_to_num(image) - low) / max(high - low, 1e-6), 0.0, 1.0)
    return np.asarray(np.rint(255.0 * (1.0 - level)), np.uint8)


def _centroids(image: FloatMap, start: FloatMap, white: bool) -> BoardView:
    """Measure circles by the centres of gravity of their ink, which blur does not move."""
    pixels, ink = np.full(start.shape, np.nan), np.zeros(len(start))
    halves = _disc_radii(start)
    for k, (centre, half) in enumerate(zip(np.rint(start).astype(int), halves, strict=True)):
        dy, dx = np.mgrid[-half : half + 1, -half : half + 1]
        disc = np.hypot(dx, dy) <= half
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
    good = np.isfinite(pixels).all(axis=1) & (shift < MAX_CENTRE_SHIFT * halves)
    return BoardView(np.flatnonzero(good), pixels[good], ink_px=ink[good])


def _disc_radii(centres: FloatMap) -> NDArray[np.int_]:
    """Radius of the disc in which each circle is measured, (n,), px: perspective changes it."""
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    distance[np.diag_indices(len(centres))] = np.inf
    nearest = distance.min(axis=1)
    # A circle that was named twice is at a distance of zero from itself.
    nearest = np.maximum(nearest, MIN_NEAREST * np.median(nearest))
    return np.asarray(np.maximum(MIN_DISC_PX, DISC_REACH * nearest), np.int_)


def _ground(
    part: FloatMap, disc: BoolMap, dx: NDArray[np.int_], dy: NDArray[np.int_], *, black: bool
) -> tuple[BoolMap, FloatMap] | None:
    """The paper around a circle and its counts, which may be uneven: a plane is fitted to it.

    None where there is too little paper.
    """
    dark, bright = (float(np.percentile(part, p)) for p in (DARK_PERCENT, BRIGHT_PERCENT))
    level = (part - dark) / max(bright - dark, 1e-6)
    if black:
        level = 1.0 - level
    paper = scipy.ndimage.binary_erosion(disc & (level > 0.5), iterations=1, border_value=1) & disc
    if paper.sum() < MIN_PAPER_PIXELS:
        # Between large circles, the paper is a narrow ring that erosion leaves nothing of.
        paper = disc & (level > CLEAR_PAPER)
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
