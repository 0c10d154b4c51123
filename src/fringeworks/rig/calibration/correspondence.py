"""Projector coordinates at the corners of a board: surfaces fitted to the decoded coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks import _core
from fringeworks.types import (
    Axis,
    BoolMap,
    CoordinateMap,
    Decoded,
    FloatMap,
    Frozen,
    InputError,
)

SURFACE_REACH = 0.5
"""Half side of a corner's window over the distance of neighbouring corners: windows are as large as
possible without overlapping, so that the errors of neighbouring corners are independent."""
MIN_SURFACE_HALF_PX = 4
"""Smallest half side of a window, px: 81 pixels for six coefficients."""
MAX_SURFACE_HALF_PX = 40
"""Largest half side of a window, px: beyond, noise hardly matters any more, but deviations from a
quadratic surface and computing time do. Empirical."""
COEFFICIENTS = 6
"""Number of coefficients of a quadratic surface."""
PIXELS_PER_COEFFICIENT = 4
"""Smallest number of decoded pixels in a window, per coefficient, so that outliers differ visibly
from the surface."""
SIGMA_FLOOR = 1.0 / 3.0
"""Lower bound on a pixel's σ, as a fraction of the median σ in the window: a few pixels with a tiny
σ must not determine the surface alone."""
REWEIGHTINGS = 12
"""Number of weighted fits of a surface: half of them towards least absolute deviations, half with
Tukey's weights. On the virtual rig the coordinates are then within 3e-5 px of their limit, at a
noise of 0.003 px."""
BIWEIGHT = 4.7
"""Scale of Tukey's biweight, in standard deviations: 95 % efficient for normal errors (Holland and
Welsch, Communications in Statistics A 6, 1977)."""
MIN_ABSOLUTE = 0.1
"""Lower bound on a deviation in the weights for least absolute deviations, relative to the scatter:
a pixel that happens to lie on the surface must not get an infinite weight."""
MAX_DESIGN_CONDITION = 1e10
"""Largest condition number of the normal matrix without weights. Beyond, the pixels lie almost on a
line and do not determine a surface."""
MAX_NORMAL_CONDITION = 1e12
"""Largest condition number of the normal matrix with weights, which may differ by some powers of
ten between pixels."""
MAX_SIGMA_SHARE = 0.02
"""Largest σ of a corner's coordinate, as a share of the coordinate's change over half a window;
beyond, the corner has no coordinate. On the virtual rig about 0.0001 is usual. Empirical."""
RIPPLE_HARMONICS = 6
"""Number of harmonics of the fringes that are looked for in the residuals: γ and saturation give a
ripple at N and 2N times the fringes' frequency for N = 3 steps."""
MAX_RIPPLE_SHARE = 0.25
"""Largest residual of a pixel, in periods, for the ripple: larger ones are wrong fringe orders."""


@dataclass(frozen=True)
class Ripple:
    """An error of the decoded coordinates that repeats with the fringes, as γ causes it."""

    amplitude_px: float
    """Amplitude of the largest of the first harmonics, projector px."""
    sigma_px: float
    """Amplitude that noise alone would give, projector px."""


@dataclass(frozen=True, eq=False, repr=False)
class Correspondence(Frozen):
    """Projector coordinates at the corners of a board."""

    projector_px: FloatMap
    """Column and row on the projector, (m, 2), px; NaN where they cannot be determined."""
    by_pixel: FloatMap
    """Derivative of the projector coordinate with respect to the camera pixel, (m, 2, 2)."""
    sigma_px: FloatMap
    """Standard deviation, from the scatter within the window, (m, 2), px."""
    outliers: float
    """Share of the decoded pixels that do not lie on the fitted surfaces, 0…1."""
    ripple: dict[Axis, Ripple]
    """Ripple along each axis that has fringes."""

    @property
    def read(self) -> BoolMap:
        """Which corners have projector coordinates, (m,)."""
        return np.asarray(np.isfinite(self.projector_px).all(axis=1))


def projector_at(decoded: Decoded, pixels: FloatMap, spacing_px: float) -> Correspondence:
    """Read projector coordinates at sub-pixel positions in the camera's frame.

    Parameters
    ----------
    decoded : Decoded
        Projector coordinates along both axes.
    pixels : (m, 2) array
        Positions in the camera's frame, px.
    spacing_px : float
        Distance of neighbouring positions, px: windows extend over half of it to each side.

    Returns
    -------
    Correspondence

    Raises
    ------
    InputError where an axis is missing.

    Notes
    -----
    A quadratic surface is fitted to the coordinates in a window, first towards least absolute
    deviations, then with Tukey's biweight. A tenth of the pixels may be wrong by whole periods. No
    homography is involved; the surface follows perspective and lens distortion.
    """
    if decoded.x is None or decoded.y is None:
        missing = "y" if decoded.y is None else "x"
        raise InputError(f"calibration: expected both axes of the projector, {missing} is missing")
    half = int(np.clip(SURFACE_REACH * spacing_px, MIN_SURFACE_HALF_PX, MAX_SURFACE_HALF_PX))
    m = len(pixels)
    projector, by_pixel = np.full((m, 2), np.nan), np.full((m, 2, 2), np.nan)
    sigma = np.full((m, 2), np.nan)
    decoded_pixels, outliers = 0, 0
    ripple: dict[Axis, Ripple] = {}
    for axis, coordinates in enumerate((decoded.x, decoded.y)):
        surfaces = [_surface(coordinates, centre, half) for centre in pixels]
        for k, surface in enumerate(surfaces):
            if surface is None:
                continue
            decoded_pixels += surface.kept.size
            outliers += int(np.sum(~surface.kept))
            slope = surface.coefficients[1:3]
            if surface.sigma < MAX_SIGMA_SHARE * np.hypot(*slope):
                projector[k, axis], sigma[k, axis] = surface.coefficients[0], surface.sigma
                by_pixel[k, axis] = slope / half
        if coordinates.periods_px:
            measured = _ripple([s for s in surfaces if s is not None], min(coordinates.periods_px))
            if measured is not None:
                ripple[coordinates.axis] = measured
    projector[~np.isfinite(projector).all(axis=1)] = np.nan
    return Correspondence(projector, by_pixel, sigma, outliers / max(decoded_pixels, 1), ripple)


@dataclass(frozen=True, eq=False)
class _Surface:
    """A quadratic surface through the decoded coordinates of a window."""

    coefficients: FloatMap
    """Of 1, u, v, u², u v, v², (6,), px, with u and v from the centre in half windows."""
    sigma: float
    """Standard deviation of the first coefficient, the coordinate at the centre, px."""
    fitted: FloatMap
    """The surface at the decoded pixels, (n,), px."""
    residual: FloatMap
    """Decoded coordinate minus the surface, (n,), px."""
    inverse_sigma: FloatMap
    """1/σ of the decoded pixels, (n,), 1/px."""
    kept: BoolMap
    """Which decoded pixels lie on the surface, (n,)."""


def _surface(coordinates: CoordinateMap, centre: FloatMap, half: int) -> _Surface | None:
    """Fit a surface around a position; None where too few pixels are decoded."""
    h, w = coordinates.coordinate_px.shape
    x0, y0 = (int(v) for v in np.rint(centre))
    rows = slice(max(y0 - half, 0), min(y0 + half + 1, h))
    columns = slice(max(x0 - half, 0), min(x0 + half + 1, w))
    values = coordinates.coordinate_px[rows, columns]
    y, x = np.nonzero(np.isfinite(values))
    if len(x) < PIXELS_PER_COEFFICIENT * COEFFICIENTS:
        return None
    q = values[y, x].astype(np.float64)
    sigma = coordinates.sigma_px[rows, columns][y, x].astype(np.float64)
    inverse_sigma: FloatMap = 1.0 / np.maximum(sigma, SIGMA_FLOOR * np.median(sigma))
    u = (x + columns.start - centre[0]) / half
    v = (y + rows.start - centre[1]) / half
    design = np.column_stack((np.ones_like(u), u, v, u * u, u * v, v * v))
    if np.linalg.cond(design.T @ design) > MAX_DESIGN_CONDITION:
        return None
    robust = _robust_fit(design, q, inverse_sigma)
    if robust is None:
        return None
    coefficients, spread, kept = robust
    if kept.sum() < PIXELS_PER_COEFFICIENT * COEFFICIENTS:
        return None
    fitted = design @ coefficients
    return _Surface(coefficients, spread, fitted, q - fitted, inverse_sigma, kept)


def _robust_fit(
    design: FloatMap, q: FloatMap, inverse_sigma: FloatMap
) -> tuple[FloatMap, float, BoolMap] | None:
    """Coefficients, standard deviation of the first, and which pixels count; None if singular.

    Least absolute deviations first: outliers of any size lose their influence.
    """
    coefficients, scale, normals, weight = _core.robust_fit(
        np.ascontiguousarray(design.T),
        q,
        inverse_sigma,
        {"fits": REWEIGHTINGS, "least": MIN_ABSOLUTE, "most": BIWEIGHT},
    )
    square = normals.reshape(-1, COEFFICIENTS, COEFFICIENTS)
    if not np.isfinite(square).all() or not (np.linalg.cond(square) <= MAX_NORMAL_CONDITION).all():
        return None
    return coefficients, scale * float(np.sqrt(np.linalg.inv(square[-1])[0, 0])), weight > 0


def _ripple(surfaces: list[_Surface], period_px: float) -> Ripple | None:
    """Look for the harmonics of the fringes in the residuals of all surfaces."""
    if not surfaces:
        return None
    kept = [s.kept & (np.abs(s.residual) < MAX_RIPPLE_SHARE * period_px) for s in surfaces]
    coordinate, residual, inverse_sigma = (
        np.concatenate([getattr(s, name)[k] for s, k in zip(surfaces, kept, strict=True)])
        for name in ("fitted", "residual", "inverse_sigma")
    )
    if not residual.size:
        return None
    weight = inverse_sigma**2 / np.sum(inverse_sigma**2)
    # The harmonics' phasors are powers of the first one's.
    first = np.exp(1j * (2.0 * np.pi / period_px) * coordinate)
    turned, amplitudes = weight * residual * first, []
    for _ in range(RIPPLE_HARMONICS):
        amplitudes.append(2.0 * float(np.abs(turned.sum())))
        turned *= first
    noise = 2.0 * float(np.sqrt(np.sum(weight**2 * residual**2)))
    return Ripple(max(amplitudes), noise)


def spacing(pixels: FloatMap) -> float:
    """Return the median distance to the nearest neighbour of positions (m, 2), px."""
    if len(pixels) < 2:
        return 1.0
    distance = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return float(np.median(distance.min(axis=1)))
