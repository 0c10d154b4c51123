"""Errors of phases in two parts: noise, and a floor that does not shrink with the modulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks import _core
from fringeworks.statistics.chi_square import chi_square_quantile
from fringeworks.statistics.groups import similar_groups
from fringeworks.statistics.quantiles import NORMAL_MEDIAN, median, quantile
from fringeworks.types import FloatMap

GROUPS = 6
"""Number of groups of similar modulation; two parts are fitted to them. An empirical choice."""

MIN_GROUP = 60
"""Smallest number of pixels in a group; its median χ² then errs by about 20 %."""

NOISE_ALONE = 1.15
"""Variance over that of noise alone up to which noise is the only cause.

The sample's median χ² scatters by 2 to 3 %, and simulated stacks without errors have 0.99 to 1.02.
The rest of the margin allows for errors of the measured noise. Empirical.
"""

GROUP_NOISE_ALONE = 1.5
"""The same for a group of similar modulation, which scatters more. Empirical."""

QUANTILES = (0.5, 0.9)
"""Quantiles of χ² that both must agree with the errors: the middle and the tail."""


SPREAD_QUANTILES = (0.5, 0.9, 0.99)
"""Quantiles of the errors of a rounding that all must agree with their spread."""

TAIL = 0.99
"""Quantile of the errors of a rounding that counts as their bound; edges of the scene may hold up
to a hundredth of the pixels."""

TAIL_SAFETY = 1.5
"""Factor on this bound. The 99th percentile of Gaussian errors is 2.6 standard deviations; times
1.5, one in ten thousand exceeds it."""

TINY = float(np.finfo(float).tiny)
"""Divides instead of a zero."""

OFFSET_SIGMAS = 5.0
"""Constant residual of a set that counts as significant, in standard errors."""

OFFSET_SHARE = 0.1
"""Constant residual that matters, as a share of the phase noise of a pixel."""


@dataclass(frozen=True)
class PhaseErrors:
    """Errors of phases beyond the noise of the camera."""

    noise_factor: float = 1.0
    """Variance of the noise over that of the camera's noise; ≥ 1."""
    floor_rad: float = 0.0
    """Standard deviation of the part that does not shrink with the modulation, rad."""
    ratio: float = 1.0
    """Median χ² of the sample over its expectation for camera noise alone."""

    offset_turns: float = 0.0
    """Error of a rounding by constant offsets between the sets, where it is too large to be taken
    out, turns."""

    @property
    def by_noise(self) -> bool:
        """Whether the noise of the camera is the only cause."""
        return self.noise_factor == 1.0 and self.floor_rad == 0.0


def two_parts(square: FloatMap, variance_rad2: FloatMap, freedom: int) -> PhaseErrors:
    """Find both parts in sums of squared errors, each over the variance by camera noise.

    Parameters
    ----------
    square : (n,) float array
        χ² of every pixel for camera noise alone.
    variance_rad2 : (n,) float array
        Variance of the phase by camera noise alone, rad².
    freedom : int ≥ 1
        Degrees of freedom of every χ².

    Notes
    -----
    The expectation of χ² over its degrees of freedom is s² + f² / v, with the noise factor s², the
    floor f and the variance v by noise. Groups of similar v give both by least squares.
    """
    square = square.astype(np.float64)
    groups = similar_groups(variance_rad2, square, GROUPS, MIN_GROUP)
    if not groups:
        return PhaseErrors()
    ratio = median(square) / chi_square_quantile(0.5, freedom)
    worst = PhaseErrors(ratio=ratio)
    inverse = np.array([float(np.mean(1.0 / variance)) for variance, _ in groups])
    shares = list(QUANTILES)
    of_groups = np.array([_core.quantiles(part, shares) for _, part in groups])
    of_all = _core.quantiles(square, shares)
    for k, share in enumerate(QUANTILES):
        usual = chi_square_quantile(share, freedom)
        seen, whole = of_groups[:, k] / usual, of_all[k] / usual
        if whole <= NOISE_ALONE and seen.max() <= GROUP_NOISE_ALONE:
            continue
        weights = 1.0 / seen
        design = np.column_stack((np.ones_like(inverse), inverse)) * weights[:, None]
        extra = non_negative(design, np.maximum(seen - 1.0, 0.0) * weights)
        found = PhaseErrors(1.0 + float(extra[0]), float(np.sqrt(extra[1])), ratio)
        worst = PhaseErrors(
            max(worst.noise_factor, found.noise_factor),
            max(worst.floor_rad, found.floor_rad),
            ratio,
        )
    return worst


def non_negative(design: FloatMap, values: FloatMap) -> FloatMap:
    """Least squares with two unknowns, neither of them below zero.

    Parameters
    ----------
    design : (n, 2) float array
    values : (n,) float array

    Returns
    -------
    (2,) float array

    Notes
    -----
    Where the free solution is negative, the best one lies on an axis. SciPy has this for any number
    of unknowns, but importing it takes three times as long as decoding a stack.
    """
    free = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0])
    if (free >= 0).all():
        return free
    alone = np.maximum(design.T @ values / np.maximum(np.sum(design**2, axis=0), TINY), 0.0)
    gains = alone * (2.0 * design.T @ values - alone * np.sum(design**2, axis=0))
    best = int(np.argmax(gains))
    return np.where(np.arange(2) == best, alone, 0.0)


def order_errors(
    amplification: FloatMap, residuals: FloatMap, variances: FloatMap
) -> tuple[float, ...]:
    """Errors of the roundings of an order chain that are no noise, from the residuals of the sets.

    Parameters
    ----------
    amplification : (R, M) array
        Error of every rounding per phase error.
    residuals : (M, n) array, turns
        Phases of the sets less those of the coordinate.
    variances : (M, n) array, turns²
        Variances of the phases by noise.

    Returns
    -------
    (R,) floats, turns

    Notes
    -----
    A rounding combines the phases so that the coordinate cancels. Its error is therefore seen in
    the residuals. The part beyond the noise is taken from the 99th percentile, so that bounded
    errors, such as ripple, count less than noise of the same standard deviation.
    """
    errors = []
    for row in amplification:
        error = np.abs(row @ residuals)
        noise = row**2 @ variances
        seen = quantile(error, TAIL) ** 2
        expected = quantile(noise, TAIL) * chi_square_quantile(TAIL, 1)
        errors.append(TAIL_SAFETY * float(np.sqrt(max(seen - expected, 0.0))))
    return tuple(errors)


def order_spread(amplification: FloatMap, residuals: FloatMap, variances: FloatMap) -> FloatMap:
    """Standard deviations of the errors of the roundings that are no noise, (R,), turns.

    Parameters
    ----------
    amplification, residuals, variances
        As for ``order_errors``.

    Notes
    -----
    Errors are seen modulo one turn of the rounding. Their quantiles are those of a normal
    distribution that is as wide, less the noise, up to the widest that is seen: that of 0.19 turns
    at the 99th percentile, of 0.3 at the 90th.
    """
    spread = []
    for row in amplification:
        turns, noise = row @ residuals, row**2 @ variances
        error = np.abs(turns - np.rint(turns))
        excess = [
            quantile(error, share) ** 2 / chi_square_quantile(share, 1) - quantile(noise, share)
            for share in SPREAD_QUANTILES
        ]
        spread.append(max(0.0, *excess) ** 0.5)
    return np.array(spread)


def set_offsets(residuals: FloatMap, variances: FloatMap) -> FloatMap:
    """Constant errors of the phases of the sets, turns; without the common shift of the coordinate.

    Parameters
    ----------
    residuals, variances
        As for ``order_errors``.

    Returns
    -------
    (M,) array, turns; 0 where they are not significant.

    Notes
    -----
    The real steps of a set are known up to a common shift. In several sets, these shifts show as
    constant residuals, except for the part that a shift of the coordinate explains.
    """
    middle = np.array([median(row) for row in residuals])
    matters = OFFSET_SHARE * np.sqrt([median(row) for row in variances])
    large = np.abs(middle) >= matters
    if not large.any():
        return np.zeros(len(middle))
    pairs = zip(residuals, middle, strict=True)
    scatter = np.array([median(np.abs(row - m)) for row, m in pairs]) / NORMAL_MEDIAN
    error = 1.25 * scatter / np.sqrt(residuals.shape[1])
    seen = large & (np.abs(middle) >= OFFSET_SIGMAS * error)
    return middle if seen.any() else np.zeros(len(middle))
