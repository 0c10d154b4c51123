"""The errors of phases in two parts: noise, and a floor that does not shrink with the modulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from fringeworks.signal.noise import chi_square_quantile
from fringeworks.types import FloatMap, Reason

GROUPS = 6
"""Number of groups of similar modulation; two parts are fitted to them. An empirical choice."""

MIN_GROUP = 60
"""Smallest number of pixels in a group; its median χ² then errs by about 20 %."""

NOISE_ALONE = 1.15
"""Variance over that of noise alone up to which noise is the only cause.

The sample's median χ² scatters by 2 to 3 %, and simulated stacks without errors have 0.99 to 1.02.
The rest of the margin allows for errors of the measured noise. Empirical.
"""

QUANTILES = (0.5, 0.9)
"""Quantiles of χ² that both must agree with the errors: the middle, and the beginning of the tail."""


@dataclass(frozen=True)
class PhaseErrors:
    """Errors of phases beyond the noise of the camera."""

    noise_factor: float = 1.0
    """Variance of the noise over that of the camera's noise; ≥ 1."""
    floor_rad: float = 0.0
    """Standard deviation of the part that does not shrink with the modulation, rad."""
    ratio: float = 1.0
    """Median χ² of the sample over its expectation for camera noise alone."""

    @property
    def by_noise(self) -> bool:
        """Whether the noise of the camera is the only cause."""
        return self.noise_factor == 1.0 and self.floor_rad == 0.0


def errors_of_sets(maps: dict[str, Any], variance_rad2: FloatMap, sets: int) -> PhaseErrors:
    """Find both parts in the disagreement of sets of fringes.

    Parameters
    ----------
    maps : the kernel's maps of a sample, with the disagreement for camera noise alone
    variance_rad2 : (1, n) float array
        Variance of the phases by camera noise alone, mean of the sets, rad².
    sets : int
        Number of sets of fringes, two or more.

    Notes
    -----
    The expectation of χ² over its degrees of freedom is s² + f² / v, with the noise factor s², the
    floor f and the variance v by noise. Groups of similar v give both by least squares.
    """
    lit = (maps["reason"] == Reason.OK) | (maps["reason"] == Reason.ORDER_AMBIGUOUS)
    known = lit & np.isfinite(maps["disagreement"])
    return two_parts(maps["disagreement"][known], variance_rad2[known], sets - 1)


def two_parts(square: FloatMap, variance_rad2: FloatMap, freedom: float) -> PhaseErrors:
    """Find both parts in sums of squared errors, each over the variance by camera noise.

    Parameters
    ----------
    square : (n,) float array
        χ² of every pixel for camera noise alone.
    variance_rad2 : (n,) float array
        Variance of the phase by camera noise alone, rad².
    freedom : float > 0
        Degrees of freedom of every χ².
    """
    groups = [
        part
        for part in np.array_split(np.argsort(variance_rad2, kind="stable"), GROUPS)
        if part.size >= MIN_GROUP
    ]
    if not groups:
        return PhaseErrors()
    ratio = float(np.median(square)) / chi_square_quantile(0.5, freedom)
    worst = PhaseErrors(ratio=ratio)
    inverse = np.array([float(np.mean(1.0 / variance_rad2[part])) for part in groups])
    for quantile in QUANTILES:
        usual = chi_square_quantile(quantile, freedom)
        seen = np.array([float(np.quantile(square[part], quantile)) for part in groups]) / usual
        if seen.max() <= NOISE_ALONE:
            continue
        weights = 1.0 / seen
        design = np.column_stack((np.ones_like(inverse), inverse)) * weights[:, None]
        extra, _ = optimize.nnls(design, np.maximum(seen - 1.0, 0.0) * weights)
        found = PhaseErrors(1.0 + float(extra[0]), float(np.sqrt(extra[1])), ratio)
        worst = PhaseErrors(
            max(worst.noise_factor, found.noise_factor),
            max(worst.floor_rad, found.floor_rad),
            ratio,
        )
    return worst
