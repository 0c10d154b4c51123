"""Readable twins of the kernels that judge coordinates beside edges."""

from __future__ import annotations

import numpy as np

from tests.oracles.isolated import difference, moved

RINGS = 4
MIN_DETERMINANT = 0.05
BEYOND = (2, 3, 4, 5, 6, 7)


def parabola_at_0(places):
    """Weights of the values at places in the parabola's value at 0."""
    return np.linalg.pinv(np.vander(places, 3, increasing=True))[0]


def change(light, down, right):
    """Slope of ln B along an axis; one-sided where a neighbour is unknown."""
    first = light - moved(light, -down, -right)
    second = moved(light, down, right) - light
    left = np.where(np.isnan(first), second, first)
    right_side = np.where(np.isnan(second), first, second)
    return 0.5 * (left + right_side)


def blur_shift(coordinate, sigma, light, most, repeats=np.inf):
    """Shift by blur of one px², and the squared slope; both 0 where no slope is known."""
    shift, slope = np.zeros((2, *coordinate.shape))
    along_x, along_y = change(light, 0, 1), change(light, 1, 0)
    for y, x in np.argwhere(np.isfinite(coordinate)):
        top, left = max(0, y - 2), max(0, x - 2)
        window = np.s_[top : y + 3, left : x + 3]
        u = difference(coordinate[window], coordinate[y, x], repeats)
        with np.errstate(invalid="ignore"):
            same = np.abs(u) < most
        v, h = np.nonzero(same)
        weight = 1.0 / sigma[window][same] ** 2
        places = np.stack([h + left - x, v + top - y]).astype(float)
        centred = places - np.average(places, axis=1, weights=weight)[:, None]
        covariance = (weight * centred) @ centred.T / weight.sum()
        if np.linalg.det(covariance) <= MIN_DETERMINANT:
            continue
        rise = (weight * centred) @ u[same] / weight.sum()
        slopes = np.linalg.solve(covariance, rise)
        found = slopes[0] * along_x[y, x] + slopes[1] * along_y[y, x]
        if np.isfinite(found):
            shift[y, x], slope[y, x] = found, slopes @ slopes
    return shift, slope


def edge_rings(coordinate, sigma, most, repeats=np.inf):
    """Distances from depth steps, and count, sum and squares of the errors at every distance."""
    rings = np.zeros(coordinate.shape, int)
    sums = np.zeros((RINGS, 3))
    for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):

        def at(values, k, down=down, right=right):
            return moved(values, k * down, k * right)

        with np.errstate(invalid="ignore"):
            slope = 0.5 * difference(coordinate, at(coordinate, -2), repeats)
            bend = difference(coordinate, at(coordinate, -1), repeats) - slope
            smooth = np.abs(bend) < 0.5 * most
            nearest = np.zeros(coordinate.shape, int)
            for k in range(RINGS, 0, -1):
                rise = difference(at(coordinate, k), coordinate, repeats)
                step = np.abs(rise - k * slope) >= most
                nearest[np.where(smooth, step, np.abs(rise) >= 2.0 * most)] = k
            error, noise = np.zeros(coordinate.shape), sigma**2
            for k, weight in zip(BEYOND, parabola_at_0(BEYOND), strict=True):
                error = error + weight * difference(at(coordinate, -k), coordinate, repeats)
                noise = noise + weight**2 * at(sigma, -k) ** 2
            seen = np.abs(error) < most
        for k in range(1, RINGS + 1):
            excess = (error**2 - noise)[seen & (nearest == k)]
            sums[k - 1] += excess.size, excess.sum(), np.sum(excess**2)
        closer = (nearest > 0) & ((rings == 0) | (nearest < rings))
        rings[closer] = nearest[closer]
    return rings, sums
