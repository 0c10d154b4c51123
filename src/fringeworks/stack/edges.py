"""Errors of coordinates beside edges: the shift that blur makes at paint, and mixed depths.

The camera's blur mixes the light of neighbouring pixels. Beside an edge of brightness this shifts
the coordinate in a known way, which is taken out. Beside a depth step the shift depends on what is
hidden, so that σ covers it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.kernel_settings import Decoding
from fringeworks.statistics.quantiles import NORMAL_MEDIAN, median, quantile
from fringeworks.statistics.surface_scatter import MIN_DIFFERENCES, SHARED
from fringeworks.statistics.third_difference import third_difference, third_difference_variance
from fringeworks.types import BoolMap, FloatMap

STEP = 3
"""Distance of the pixels whose differences the blur is estimated from, px. At 1 px, the higher
orders of a blur of 1.3 px lower the estimate to 0.9 px; at 3 and 4 px it is right within 0.1 px."""

STRONG = 0.97
"""Quantile of the influence of the blur from which on differences are used. Errors at weak edges
are noise, ripple and relief. Empirical; 0.9 to 0.99 give the same blur within 3 %."""

PASSES = 4
"""Most passes; each computes slopes without the shift that the one before has found. For a blur of
1.3 px, one, two and three passes leave rms errors of 0.26, 0.17 and 0.16 px. Simulated."""

SETTLED = 0.01
"""Relative change of the blur's variance from pass to pass that ends them. Narrow blur needs two
passes, one of 1.3 px four."""

SAMPLED = 50_000
"""Approximate number of pixels per direction that the blur is estimated from: they determine its
variance to 1 %."""

MOST_BLUR_PX = 3.0
"""Largest blur that is taken out, px: the first order of a wider one does not describe it."""

SIGNIFICANT = 4.0
"""Standard errors of the blur's variance from which on it is taken out."""

EXPLAINED = 0.5
"""Share of the squared differences beyond noise that the shift must explain. Simulated blur
explains 0.65 and more, even beside vibration; ripple of a bent response beside paint, blending and
mixed depths explain up to 0.3 by chance."""

ROBUST = 2.0
"""Scale of the Cauchy weights of the differences, in standard deviations of their scatter."""

ROUNDS = 8
"""Rounds of reweighting; most stacks need four."""

SLOPE_REACH = 3
"""Distance to both sides over which the slope along a line is taken, px."""

STEEPEST = 0.25
"""Steepest slope of a coordinate along a line that is used, periods of the fringes per px."""

TINY = 1e-12
"""Divides instead of a zero."""

RINGS = 4
"""Largest distance from a depth step at which σ is raised, px, as in the kernel."""

FEWEST = 30
"""Smallest number of pixels at a distance from steps whose errors count by themselves: their rms
is known to 13 %. With fewer, the errors at the next smaller distance count."""


class Fringes(TypedDict):
    """What the coordinates of a map are measured by."""

    period_px: float
    """Shortest period of the fringes, projector px."""
    repeats_px: float
    """Distance after which coordinates repeat, projector px; infinite for absolute ones."""


def fringes_of(decoding: Decoding) -> Fringes:
    """What the coordinates of a decoding are measured by."""
    return {"period_px": decoding.finest_px, "repeats_px": decoding.repeats_px}


def remove_blur_shift(
    coordinate: FloatMap, sigma: FloatMap, modulation: FloatMap, **fringes: Unpack[Fringes]
) -> float:
    """Remove the shift of coordinates by the camera's blur at edges of brightness, in place.

    Parameters
    ----------
    coordinate, sigma : (h, w) float32 arrays, projector px
        NaN where a coordinate is unknown.
    modulation : (h, w) float32 array, counts

    Returns
    -------
    float ≥ 0: standard deviation of the blur, camera px; 0 where the map does not show one.

    Notes
    -----
    A Gaussian blur of variance v shifts the coordinate u by v ∇ln B · ∇u, where B is the blurred
    modulation. v is the regression of the third differences of u on those of the shift, which
    vanish on smooth surfaces. σ contains the error of v, and the noise of ln B.
    """
    light, period_px, repeats_px = _log(modulation), fringes["period_px"], fringes["repeats_px"]
    shift, slope = np.empty((2, *coordinate.shape), np.float32)

    def shift_of(moved: FloatMap) -> FloatMap:
        steps: _core._EdgeSteps = {"most": 0.5 * period_px, "repeats": repeats_px}
        _core.blur_shift(moved, sigma, light, steps, shift, slope)
        return np.asarray(shift)

    stride = -(-coordinate.size // SAMPLED)
    found = _blur(coordinate, sigma, shift_of, period_px, ((1, stride), (0, stride)))
    if found is None:
        return 0.0
    variance, error, _ = found
    # The modulation of equal steps has the relative noise of the phase, its difference over 2 px
    # half of that variance.
    noise = 0.5 * (variance * TURN / period_px) ** 2
    sigma *= np.sqrt(1.0 + np.float32(noise) * slope)
    np.hypot(sigma, np.float32(error) * shift, out=sigma)
    coordinate -= np.float32(variance) * shift
    return float(variance**0.5)


def line_shift(
    coordinate: FloatMap, sigma: FloatMap, modulation: FloatMap, **fringes: Unpack[Fringes]
) -> FloatMap | None:
    """Shift of coordinates along single lines, (r, l), by the camera's blur, projector px; None
    where the lines do not show any.

    The parameters are those of ``remove_blur_shift``. Slopes across the lines are not known: the
    shift is that along them.
    """
    light, period_px = _log(modulation), fringes["period_px"]

    def shift_of(moved: FloatMap) -> FloatMap:
        rise = _central(moved, SLOPE_REACH)
        rise[~(np.abs(rise) < STEEPEST * period_px)] = np.nan
        return np.asarray(np.nan_to_num(rise * _central(light, 1)))

    if coordinate.shape[1] <= 2 * SLOPE_REACH:
        return None
    found = _blur(coordinate, sigma, shift_of, period_px, ((1, 1),))
    return None if found is None else np.float32(found[0]) * found[2]


def _log(modulation: FloatMap) -> FloatMap:
    """Logarithm of the modulation, NaN where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        light: FloatMap = np.log(modulation)
    light[~np.isfinite(light)] = np.nan
    return light


def _central(values: FloatMap, reach: int) -> FloatMap:
    """Slopes along rows between the pixels ``reach`` away to both sides; NaN at the ends."""
    slopes = np.full_like(values, np.nan)
    slopes[:, reach:-reach] = (values[:, 2 * reach :] - values[:, : -2 * reach]) / (2 * reach)
    return slopes


def _blur(
    coordinate: FloatMap,
    sigma: FloatMap,
    shift_of: Callable[[FloatMap], FloatMap],
    period_px: float,
    directions: tuple[tuple[int, int], ...],
) -> tuple[float, float, FloatMap] | None:
    """Variance of the blur and its standard error, px², and the shift by blur of one px²; None
    where the coordinates show none.

    ``shift_of`` computes the shift from coordinates without it; ``directions`` are the axes along
    which coordinates are compared, each with the stride of the lines.
    """
    moved, least, before = coordinate, 0.25 * period_px, float("inf")
    for _ in range(PASSES):
        shift = shift_of(moved)
        parts = [
            _differences(
                [np.moveaxis(m, k, 1)[::stride] for m in (coordinate, sigma, shift)], least
            )
            for k, stride in directions
        ]
        seen, made, noise = (np.concatenate(values) for values in zip(*parts, strict=True))
        variance, error = _regression(seen, made, noise)
        if not SIGNIFICANT * error < variance < MOST_BLUR_PX**2:
            return None
        if abs(variance - before) < SETTLED * variance:
            break
        moved, before = coordinate - np.float32(variance) * shift, variance
    return variance, error, shift


def _differences(maps: list[FloatMap], step_px: float) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Third differences along rows of coordinate and shift, and the variance of the former, where
    no depth step lies between the pixels. ``maps`` are coordinate, σ and shift."""
    coordinate, sigma, shift = maps
    length = max(0, coordinate.shape[1] - 2 * STEP)
    left, middle, right = (coordinate[:, k * STEP : k * STEP + length] for k in range(3))
    straight: BoolMap = np.abs(left - 2.0 * middle + right) < step_px
    smooth = straight[:, STEP:] & straight[:, :-STEP]
    variance = third_difference_variance(sigma**2, STEP)[smooth]
    return (
        third_difference(coordinate, STEP)[smooth],
        third_difference(shift, STEP)[smooth],
        variance,
    )


def _regression(seen: FloatMap, made: FloatMap, noise: FloatMap) -> tuple[float, float]:
    """Robust coefficient of what was ``seen`` on what the shift has ``made``, by the variances of
    the noise, and its standard error; infinite where there are too few values, or where the shift
    explains little of them."""
    if seen.size < MIN_DIFFERENCES:
        return 0.0, float("inf")
    influence = made**2 / noise
    strong = influence >= max(quantile(influence, STRONG), TINY)
    if not strong.any():
        return 0.0, float("inf")
    seen, made, noise = seen[strong], made[strong], noise[strong]
    weight, found = 1.0 / noise, 0.0
    for _ in range(ROUNDS):
        found = float(np.sum(weight * seen * made) / np.sum(weight * made**2))
        off = (seen - found * made) ** 2 / noise
        scatter = median(off) / NORMAL_MEDIAN**2
        weight = 1.0 / noise / (1.0 + off / max(ROBUST**2 * scatter, TINY))
    left = seen - found * made
    excess = np.sum(weight * (seen**2 - noise))
    if np.sum(weight * (seen**2 - left**2)) < EXPLAINED * excess:
        return 0.0, float("inf")
    scores = weight * made * left
    error = float(np.sqrt(SHARED * np.sum(scores**2)) / np.sum(weight * made**2))
    return found, error


def sigma_beside_steps(
    coordinate: FloatMap, sigma: FloatMap, **fringes: Unpack[Fringes]
) -> FloatMap | None:
    """Standard deviations with the errors that pixels beside depth steps show; None for no such.

    Parameters
    ----------
    coordinate, sigma : (h, w) float32 arrays, projector px
        NaN where a coordinate is unknown.

    Returns
    -------
    (h, w) float32 array, projector px, or None

    Notes
    -----
    A pixel with a share w < ½ of the light of another surface is off by less than a quarter of a
    period; a difference of that size is a step. The variance of the pixels at 1, 2, 3 and 4 px
    from a step grows by the mean square of their distances from what the pixels behind them
    extrapolate to, less the share of noise.
    """
    rings: NDArray[np.uint8] = np.empty(coordinate.shape, np.uint8)
    steps: _core._EdgeSteps = {"most": step_px(fringes), "repeats": fringes["repeats_px"]}
    found = _core.edge_rings(coordinate, sigma, steps, rings)
    added = np.zeros(len(found) + 1, np.float32)
    for ring, (count, total, squares) in enumerate(found, start=1):
        if count < FEWEST:
            added[ring] = added[ring - 1]
        elif total > SIGNIFICANT * squares**0.5:
            added[ring] = total / count
    if not added.any():
        return None
    variance = added[rings]
    # A pixel in the middle of a blurred step continues neither side.
    for along in (variance, variance.T):
        middle = along[:, 1:-1]
        np.maximum(middle, np.minimum(along[:, :-2], along[:, 2:]), out=middle)
    return np.asarray(np.sqrt(sigma**2 + variance))


def has_steps(coordinate: FloatMap, **fringes: Unpack[Fringes]) -> bool:
    """Whether coordinates along lines, (r, l), jump as at depth steps."""
    repeats_px, length = fringes["repeats_px"], coordinate.shape[1] - 2
    slope = 0.5 * (coordinate[:, 2:] - coordinate[:, :-2])
    for distance in range(1, min(RINGS, length - 1) + 1):
        here, ahead = coordinate[:, 2:-distance], coordinate[:, 2 + distance :]
        jump = ahead - here - distance * slope[:, :-distance]
        if np.isfinite(repeats_px):
            jump -= repeats_px * np.round(jump / repeats_px)
        with np.errstate(invalid="ignore"):
            if np.any(np.abs(jump) >= step_px(fringes)):
                return True
    return False


def step_px(fringes: Fringes) -> float:
    """Smallest difference of coordinates that is a depth step, projector px."""
    return 0.25 * fringes["period_px"]
