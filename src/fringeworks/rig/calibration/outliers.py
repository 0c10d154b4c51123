"""Corners that do not lie where the rest of the board says: found by a smooth map of the board."""

from __future__ import annotations

import numpy as np

from fringeworks.types import BoolMap, FloatMap
from fringeworks.types.packages import cv2

MIN_POINTS = 8
"""Smallest number of corners that are compared with each other: a homography has eight unknowns,
so with four of them, eight corners leave eight coordinates to judge by."""
POINTS_PER_COEFFICIENT = 3
"""Smallest number of corners per coefficient of the smooth map, so that single wrong corners cannot
bend it. A cubic map has ten coefficients and needs 30 corners."""
MAX_DEGREE = 3
"""Largest degree of the polynomial that is added to the homography. Lens distortion and a bowed
sheet are cubic over one board to a few hundredths of a pixel."""
ROUNDS = 20
"""Number of weighted fits of the smooth map: least absolute deviations, which converge slowly."""
FIRST_SCALE = 1e-3
"""Smallest deviation that the weights of least absolute deviations count, in distances of
neighbouring corners: a corner that lies on the map must not get an infinite weight."""
OFF_MEDIANS = 6.0
"""Distance from the smooth map, in median distances, from which a corner is wrong: seven standard
deviations per coordinate, which one in 10¹⁰ exceeds. Blur differs over a photograph, so real
scatter has longer tails."""
OFF_PX = 0.5
"""Smallest distance from the smooth map at which a corner is wrong, px. Correct corners lie within
0.1 px; print errors and the bend of a real sheet come to 0.2 px. Empirical."""
OFF_SHARE = 0.01
"""The same in distances of neighbouring corners: a print that is off by a hundredth of a square is
not the detector's fault."""
MAX_LEVERAGE = 0.95
"""Upper bound on how much a corner determines the map at its own place. Deviations are divided by
what is left, so that they are those from a map without that corner."""


def off_board(places: FloatMap, pixels: FloatMap) -> BoolMap:
    """Find the corners that do not follow the image of a flat board.

    Parameters
    ----------
    places : (n, 2) array
        Positions on the board in distances of neighbouring corners.
    pixels : (n, 2) array
        Where the corners were found, px.

    Returns
    -------
    (n,) bool array; all False where fewer than ``MIN_POINTS`` corners are given.

    Notes
    -----
    A homography and a polynomial in the board's coordinates, of third degree where there are enough
    corners, are fitted towards least absolute deviations. The polynomial stands for lens distortion
    and a bowed sheet.
    """
    wrong = np.zeros(len(places), bool)
    if len(places) < MIN_POINTS:
        return wrong
    homography, _ = cv2.findHomography(places, pixels, cv2.LMEDS)
    if homography is None:
        return wrong
    deviation = pixels - mapped(np.asarray(homography, np.float64), places)
    pitch = _pitch_px(np.asarray(homography, np.float64), places)
    distance = _distance_from_polynomial(places, deviation, FIRST_SCALE * pitch)
    limit = max(OFF_MEDIANS * float(np.median(distance)), OFF_PX, OFF_SHARE * pitch)
    return np.asarray(distance > limit)


def mapped(homography: FloatMap, points: FloatMap) -> FloatMap:
    """Points (n, 2) mapped by a homography (3, 3)."""
    image = np.column_stack((points, np.ones(len(points)))) @ homography.T
    return np.asarray(image[:, :2] / image[:, 2:])


def _pitch_px(homography: FloatMap, places: FloatMap) -> float:
    """Distance of neighbouring corners in the middle of the board, px."""
    middle = places.mean(axis=0)
    ahead = mapped(homography, middle + np.eye(2)) - mapped(homography, middle[None])
    return float(np.linalg.norm(ahead, axis=1).min())


def _distance_from_polynomial(places: FloatMap, deviation: FloatMap, floor: float) -> FloatMap:
    """Distance of every deviation from a polynomial through the others, (n,), px."""
    low, high = places.min(axis=0), places.max(axis=0)
    x, y = ((places - 0.5 * (low + high)) / np.maximum(0.5 * (high - low), 1e-9)).T
    terms = [[x**i * y ** (d - i) for i in range(d + 1)] for d in range(MAX_DEGREE + 1)]
    design = np.column_stack(terms[0])
    for degree in range(1, MAX_DEGREE + 1):
        more = np.column_stack((design, *terms[degree]))
        if POINTS_PER_COEFFICIENT * more.shape[1] > len(places):
            break
        design = more
    weight = np.ones(len(places))
    for _ in range(ROUNDS):
        weighted = design * np.sqrt(weight)[:, None]
        inverse = np.linalg.pinv(weighted)
        left = deviation - design @ (inverse @ (deviation * np.sqrt(weight)[:, None]))
        distance = np.linalg.norm(left, axis=1)
        weight = 1.0 / np.maximum(distance, floor)
        weight /= weight.max()
    leverage = np.minimum(np.einsum("nk,kn->n", weighted, inverse), MAX_LEVERAGE)
    return np.asarray(distance / (1.0 - leverage))
