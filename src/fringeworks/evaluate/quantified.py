"""A value with its uncertainty in parts, freed of what noise alone adds to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fringeworks.evaluate.shares import Share, Shares, joined, scaled, total
from fringeworks.statistics.quantiles import smallest
from fringeworks.surface.form import DISCARDED
from fringeworks.types import FloatMap

REPEATED = 8
"""Number of times that noise is added: its mean effect is then known to a third of its scatter."""
MOST_POINTS = 100_000
"""Approximate number of points, evenly thinned, to which it is added."""
EXTRAPOLATED = 0.12
"""Standard deviation of the share of noise that is extrapolated, over that share. On planes, waves,
wedges, steps and bumps of 2 to 50 times the noise, it was 1 % to 22 % too large."""


@dataclass(frozen=True)
class Quantified:
    """A quantity that was measured."""

    value: float
    """The quantity, less what noise alone has added to it."""
    shares: Shares
    """Parts of the standard deviation of the value."""
    unit: str
    noise: float = 0.0
    """What noise has added to what was seen; 0 where it does not add up."""
    seen_sigma: float | None = None
    """Standard deviation of what was seen; None for that of the value."""

    @cached_property
    def sigma(self) -> float:
        """Standard deviation of the value, of all parts."""
        return total(self.shares)

    @property
    def seen(self) -> float:
        """The quantity of the points as they were measured, with their noise."""
        return self.value + self.noise


class Noise(NamedTuple):
    """What noise alone would make of a quantity that cannot be negative."""

    value: float
    """Its expected value."""
    spread: float
    """Standard deviation around it."""


def narrowest_range(values: FloatMap) -> tuple[float, int, int]:
    """Return the narrowest range that holds 99.7 % of the values, and where its ends lie.

    Returns
    -------
    range, index of the largest and of the smallest value in it
    """
    count = values.size - kept_of(values.size) + 1
    # The ends of a range are among as many of the smallest and of the largest values.
    ends = (np.flatnonzero(smallest(one, count)) for one in (values, -values))
    low, high = (part[np.argsort(values[part])] for part in ends)
    ranges = values[high] - values[low]
    first = int(np.argmin(ranges))
    return float(ranges[first]), int(high[first]), int(low[first])


def narrowest(values: FloatMap) -> float:
    """Return the narrowest range that holds 99.7 % of the values."""
    return narrowest_range(values)[0]


def kept_of(count: int) -> int:
    """Return the number of so many values without the discarded share."""
    return max(int(np.ceil((1.0 - DISCARDED) * count)), 1)


def freed(seen: float, shares: Shares, noise: Noise, unit: str) -> Quantified:
    """Return a quantity that cannot be negative without the share of noise.

    Parameters
    ----------
    seen : float ≥ 0
        The quantity of the noisy points, F.
    shares : parts of σ
        Its standard deviation by all that is no noise.
    noise : Noise
        R ± r.

    Notes
    -----
    Squares of noise and true value add up: the value is √(F² − R²). With s² = σ² + r², its standard
    deviation is s (F + R) / √(F² − R²), so that a value is as many of them from 0 as F is from R;
    but at most √((R + s)² − R²), where F is within s of R.
    """
    parts = joined((*shares, Share("noise", noise.spread)))
    level, s = noise.value, total(parts)
    value = float(np.sqrt(max(seen**2 - level**2, 0.0)))
    most = float(np.sqrt((level + s) ** 2 - level**2))
    own = min(s * (seen + level) / value, most) if value > 0.0 else most
    return Quantified(value, scaled(parts, own / s if s > 0.0 else 0.0), unit, seen - value, s)


def freed_range(
    values: FloatMap,
    noise: FloatMap,
    range_of: Callable[[FloatMap], float],
    shares: Shares,
    like_noise: Callable[[np.random.Generator], FloatMap] | None = None,
) -> Quantified:
    """Return a range of values without what noise adds to it.

    Parameters
    ----------
    values : (n,) array
        Measured values, mm.
    noise : (n,) array
        Standard deviations of their noise.
    range_of : function
        Of the values; not below 0.
    shares : parts of σ
        Standard deviation of the range by all that is no noise.
    like_noise : function, optional
        Draws numbers of variance 1, (n,), that are as alike in neighbours as noise is; independent
        ones otherwise.

    Notes
    -----
    Noise of variance v moves the ends of a range by about √v, whether it makes the range or lies on
    top of a form. As much noise again is added to the values, which shows by how much the range
    grows from √v to √2v, and the range is extrapolated to v = 0 (simulation extrapolation: Cook &
    Stefanski, JASA 89, 1994).
    """
    seen = range_of(values)
    step = -(-len(values) // MOST_POINTS)
    values, noise = values[::step], noise[::step]
    random = np.random.default_rng(0)

    def unit_noise() -> FloatMap:
        return random.normal(size=len(noise)) if like_noise is None else like_noise(random)[::step]

    drawn = [range_of(values + noise * unit_noise()) for _ in range(REPEATED)]
    factor = 1.0 / (2.0**0.5 - 1.0)
    share = factor * max(float(np.mean(drawn)) - range_of(values), 0.0)
    scatter = factor * float(np.std(drawn, ddof=1))
    parts = joined((*shares, Share("noise", scatter, REPEATED - 1.0)))
    value = max(seen - share, 0.0)
    seen_sigma = total((*shares, Share("noise", scatter / factor)))
    parts = (*parts, Share("form filter", EXTRAPOLATED * share))
    return Quantified(value, parts, "mm", seen - value, seen_sigma)
