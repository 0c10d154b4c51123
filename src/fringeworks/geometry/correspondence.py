"""Where on the projector a board's corners lie: a surface fitted to the decoded coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks.types import CoordinateMap, Decoded, FloatMap, InputError

REACH = 0.6
"""Half side of the window over the distance of neighbouring corners."""
SMALLEST, LARGEST = 4, 40
"""Half sides of the window, px."""
TERMS = 6
"""Of a quadratic surface."""
FIRMEST = 1.0 / 3.0
"""Share of the median standard deviation that no pixel is held firmer than."""
ROUNDS = 12
BIWEIGHT = 4.7
"""Scale of Tukey's weights: 95 % efficient for normal errors."""
SPREAD = 0.02
"""Standard deviation of a corner's coordinate beyond which it is not determined, of a window."""


@dataclass(frozen=True, eq=False)
class Correspondence:
    """Projector coordinates at places of the camera's frame."""

    projector_px: FloatMap
    """(m, 2), px; NaN where it cannot be told."""
    by_pixel: FloatMap
    """Derivative by the camera pixel, (m, 2, 2)."""
    sigma_px: FloatMap
    """Standard deviation by the scatter within the window, (m, 2), px."""
    outliers: float
    """Share of decoded pixels that do not lie on the surfaces, 0…1."""


def projector_at(decoded: Decoded, pixels: FloatMap, spacing_px: float) -> Correspondence:
    """Read projector coordinates between pixels.

    Parameters
    ----------
    decoded : Decoded
        Both axes.
    pixels : (m, 2) array
        Places in the camera's frame, px.
    spacing_px : float
        Distance of neighbouring corners, px: windows reach just over half of it.

    Notes
    -----
    A quadratic surface over a window, by least squares with Tukey's biweight from a start of least
    absolute deviations: a tenth of the pixels may be wrong by whole periods. No homography is
    involved, and the surface takes up perspective and distortion.
    """
    if decoded.x is None or decoded.y is None:
        missing = "y" if decoded.y is None else "x"
        raise InputError(f"calibration: expected both axes of the projector, {missing} is missing")
    half = int(np.clip(REACH * spacing_px, SMALLEST, LARGEST))
    m = len(pixels)
    place, by = np.full((m, 2), np.nan), np.full((m, 2, 2), np.nan)
    sigma = np.full((m, 2), np.nan)
    used, left_out = 0, 0
    for axis, found in enumerate((decoded.x, decoded.y)):
        for k, centre in enumerate(pixels):
            fitted = _surface(found, centre, half)
            if fitted is None:
                continue
            solution, spread, kept, all_of = fitted
            used, left_out = used + all_of, left_out + all_of - kept
            if spread > SPREAD * np.hypot(*solution[1:3]):
                continue
            place[k, axis], sigma[k, axis] = solution[0], spread
            by[k, axis] = solution[1:3] / half
    bad = ~np.isfinite(place).all(axis=1)
    place[bad] = np.nan
    return Correspondence(place, by, sigma, left_out / max(used, 1))


def _surface(
    found: CoordinateMap, centre: FloatMap, half: int
) -> tuple[NDArray[np.float64], float, int, int] | None:
    """Coefficients about the centre in units of ``half``, σ of the constant, kept and all pixels."""
    h, w = found.coordinate_px.shape
    x0, y0 = (int(v) for v in np.rint(centre))
    rows = slice(max(y0 - half, 0), min(y0 + half + 1, h))
    columns = slice(max(x0 - half, 0), min(x0 + half + 1, w))
    values = found.coordinate_px[rows, columns]
    y, x = np.nonzero(np.isfinite(values))
    if len(x) < 4 * TERMS:
        return None
    q = values[y, x].astype(np.float64)
    sigma = found.sigma_px[rows, columns][y, x].astype(np.float64)
    firm = 1.0 / np.maximum(sigma, FIRMEST * np.median(sigma))
    u = (x + columns.start - centre[0]) / half
    v = (y + rows.start - centre[1]) / half
    design = np.column_stack((np.ones_like(u), u, v, u * u, u * v, v * v))
    weight = firm
    solution = np.zeros(TERMS)
    scale = 0.0
    for step in range(ROUNDS):
        root = weight[:, None]
        solution, _, rank, _ = np.linalg.lstsq(design * root, q * weight, rcond=None)
        if rank < TERMS:
            return None
        off = np.abs(q - design @ solution) * firm
        scale = max(1.4826 * float(np.median(off)), 1e-9)
        if step < ROUNDS // 2:
            # Towards least absolute deviations: outliers of any size lose their hold.
            weight = firm / np.sqrt(np.maximum(off, 0.1 * scale))
        else:
            weight = firm * np.maximum(0.0, 1.0 - (off / (BIWEIGHT * scale)) ** 2)
    kept = weight > 0
    if kept.sum() < 4 * TERMS:
        return None
    normal = (design * weight[:, None]).T @ (design * weight[:, None])
    spread = scale * float(np.sqrt(np.linalg.inv(normal)[0, 0]))
    return solution, spread, int(kept.sum()), len(q)


def ripple_of(
    found: CoordinateMap, pixels: FloatMap, spacing_px: float
) -> tuple[float, float] | None:
    """What follows the fringes' phase in the coordinates around corners: the projector's γ.

    Returns
    -------
    Amplitude of the largest of the first six harmonics, px, and its standard deviation; None where
    there are no fringes.
    """
    if not found.periods_px:
        return None
    half = int(np.clip(REACH * spacing_px, SMALLEST, LARGEST))
    period = min(found.periods_px)
    phases, misses, weights = [], [], []
    for centre in pixels:
        fitted = _surface(found, centre, half)
        if fitted is None:
            continue
        solution, *_ = fitted
        x0, y0 = (int(v) for v in np.rint(centre))
        rows = slice(max(y0 - half, 0), y0 + half + 1)
        columns = slice(max(x0 - half, 0), x0 + half + 1)
        q = found.coordinate_px[rows, columns].astype(np.float64)
        y, x = np.nonzero(np.isfinite(q))
        u = (x + columns.start - centre[0]) / half
        v = (y + rows.start - centre[1]) / half
        design = np.column_stack((np.ones_like(u), u, v, u * u, u * v, v * v))
        smooth = design @ solution
        miss = q[y, x] - smooth
        near = np.abs(miss) < 0.25 * period
        phases.append(smooth[near] * (2.0 * np.pi / period))
        misses.append(miss[near])
        weights.append(1.0 / found.sigma_px[rows, columns][y, x][near].astype(np.float64) ** 2)
    if not phases:
        return None
    phase, miss, weight = (np.concatenate(p) for p in (phases, misses, weights))
    amplitudes = []
    for harmonic in range(1, 7):
        c, s = np.cos(harmonic * phase), np.sin(harmonic * phase)
        total = 0.5 * weight.sum()
        amplitudes.append(
            float(np.hypot(np.sum(weight * miss * c), np.sum(weight * miss * s)) / total)
        )
    spread = float(np.sqrt(2.0 * np.sum(weight * miss**2) / len(miss) / weight.sum()))
    return max(amplitudes), spread


def spacing(pixels: FloatMap) -> float:
    """Distance of neighbouring places: the median over all of the nearest one's, px."""
    if len(pixels) < 2:
        return 1.0
    distance = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return float(np.median(distance.min(axis=1)))


def lit_share(decoded: Decoded, pixels: FloatMap) -> float:
    """Share of places around which something was decoded."""
    maps = list(decoded.maps.values())
    shape = maps[0].coordinate_px.shape
    ok = np.ones(shape, bool)
    for found in maps:
        ok &= ndimage.maximum_filter(np.isfinite(found.coordinate_px), 9)
    x, y = np.clip(np.rint(pixels).astype(int).T, 0, np.array(shape)[::-1, None] - 1)
    return float(np.mean(ok[y, x]))
