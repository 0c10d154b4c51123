"""Where on the projector a board's corners lie: a surface fitted to the decoded coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types import Axis, BoolMap, CoordinateMap, Decoded, FloatMap, InputError

REACH = 0.5
"""Half side of the window over the distance of neighbouring corners: windows do not overlap."""
SMALLEST, LARGEST = 4, 40
"""Half sides of the window, px."""
TERMS = 6
"""Of a quadratic surface."""
FIRMEST = 1.0 / 3.0
"""Share of the median standard deviation that no pixel is held firmer than."""
ROUNDS = 12
BIWEIGHT = 4.7
"""Scale of Tukey's weights: 95 % efficient for normal errors."""
HARMONICS = 6
"""Of the fringes that are looked for in what surfaces leave."""
SPREAD = 0.02
"""Standard deviation of a corner's coordinate beyond which it is not determined, of a window."""


@dataclass(frozen=True)
class Ripple:
    """What follows the fringes' phase in decoded coordinates: the projector's γ."""

    amplitude_px: float
    """Of the largest of the first harmonics, projector px."""
    sigma_px: float
    """What noise makes of it."""


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
    ripple: dict[Axis, Ripple]
    """By axis, where there are fringes."""


def projector_at(decoded: Decoded, pixels: FloatMap, spacing_px: float) -> Correspondence:
    """Read projector coordinates between pixels.

    Parameters
    ----------
    decoded : Decoded
        Both axes.
    pixels : (m, 2) array
        Places in the camera's frame, px.
    spacing_px : float
        Distance of neighbouring corners, px: windows reach half of it.

    Raises
    ------
    InputError where an axis is missing.

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
    decoded_pixels, left_out = 0, 0
    ripple: dict[Axis, Ripple] = {}
    for axis, found in enumerate((decoded.x, decoded.y)):
        surfaces = [_surface(found, centre, half) for centre in pixels]
        for k, surface in enumerate(surfaces):
            if surface is None:
                continue
            decoded_pixels += surface.kept.size
            left_out += int(np.sum(~surface.kept))
            slope = surface.coefficients[1:3]
            if surface.sigma < SPREAD * np.hypot(*slope):
                place[k, axis], sigma[k, axis] = surface.coefficients[0], surface.sigma
                by[k, axis] = slope / half
        if found.periods_px:
            measured = _ripple([s for s in surfaces if s is not None], min(found.periods_px))
            if measured is not None:
                ripple[found.axis] = measured
    place[~np.isfinite(place).all(axis=1)] = np.nan
    return Correspondence(place, by, sigma, left_out / max(decoded_pixels, 1), ripple)


@dataclass(frozen=True, eq=False)
class _Surface:
    """A quadratic surface through the coordinates of a window."""

    coefficients: FloatMap
    """About the centre, in half windows: 1, u, v, u², uv, v²."""
    sigma: float
    """Standard deviation of the first."""
    smooth: FloatMap
    """The surface at the decoded pixels, (n,), px."""
    miss: FloatMap
    """What was decoded minus the surface, (n,), px."""
    firm: FloatMap
    """1/σ of those pixels, (n,)."""
    kept: BoolMap
    """Which of them lie on the surface, (n,)."""


def _surface(found: CoordinateMap, centre: FloatMap, half: int) -> _Surface | None:
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
    firm: FloatMap = 1.0 / np.maximum(sigma, FIRMEST * np.median(sigma))
    u = (x + columns.start - centre[0]) / half
    v = (y + rows.start - centre[1]) / half
    design = np.column_stack((np.ones_like(u), u, v, u * u, u * v, v * v))
    if np.linalg.cond(design.T @ design) > 1e10:
        return None
    weight, scale = firm, 0.0
    for step in range(ROUNDS):
        weighted = design * (weight * weight)[:, None]
        normal = design.T @ weighted
        if np.linalg.cond(normal) > 1e12:
            return None
        coefficients = np.linalg.solve(normal, q @ weighted)
        off = np.abs(q - design @ coefficients) * firm
        scale = max(1.4826 * float(np.median(off)), 1e-9)
        if step < ROUNDS // 2:
            # Towards least absolute deviations: outliers of any size lose their hold.
            weight = firm / np.sqrt(np.maximum(off, 0.1 * scale))
        elif step < ROUNDS - 1:
            weight = firm * np.maximum(0.0, 1.0 - (off / (BIWEIGHT * scale)) ** 2)
    kept = weight > 0
    if kept.sum() < 4 * TERMS:
        return None
    spread = scale * float(np.sqrt(np.linalg.inv(normal)[0, 0]))
    smooth = design @ coefficients
    return _Surface(coefficients, spread, smooth, q - smooth, firm, kept)


def _ripple(surfaces: list[_Surface], period_px: float) -> Ripple | None:
    """The largest of the first harmonics of the fringes in what surfaces leave."""
    if not surfaces:
        return None
    kept = [s.kept & (np.abs(s.miss) < 0.25 * period_px) for s in surfaces]
    phase, miss, firm = (
        np.concatenate([getattr(s, name)[k] for s, k in zip(surfaces, kept, strict=True)])
        for name in ("smooth", "miss", "firm")
    )
    if not miss.size:
        return None
    weight = firm**2 / np.sum(firm**2)
    turn = 2.0 * np.pi / period_px
    amplitudes = [
        2.0 * float(np.abs(np.sum(weight * miss * np.exp(1j * k * turn * phase))))
        for k in range(1, HARMONICS + 1)
    ]
    spread = 2.0 * float(np.sqrt(np.sum(weight**2 * miss**2)))
    return Ripple(max(amplitudes), spread)


def spacing(pixels: FloatMap) -> float:
    """Distance of neighbouring places: the median over all of the nearest one's, px."""
    if len(pixels) < 2:
        return 1.0
    distance = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return float(np.median(distance.min(axis=1)))
