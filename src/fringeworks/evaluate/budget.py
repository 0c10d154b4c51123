"""The uncertainty budget of a quantity: its parts, their effective degrees of freedom, k and U."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np
import scipy

from fringeworks.evaluate.area_points import AreaPoints
from fringeworks.evaluate.quantified import Quantified
from fringeworks.evaluate.shares import Share, Shares, Source, freedom_of, joined, total
from fringeworks.types import FloatMap, Frozen
from fringeworks.types.uncertainty import StatedUncertainty

PROBABILITY = 0.9545
"""Probability that the true value lies within U: that of two standard deviations of a normal
number, as certificates state it (EA-4/02). Usually called 95 %."""
UNIFORM: frozenset[Source] = frozenset({"temperature", "form filter"})
"""Parts that are anywhere between two limits; the others are normal."""

Distribution = Literal["normal", "uniform"]


@dataclass(frozen=True, eq=False, repr=False)
class BudgetLine(Frozen):
    """A part of an uncertainty budget."""

    source: Source
    """What it comes from."""
    input_sigma: float
    """Standard uncertainty of the input: of a point, root mean square over the areas, for noise,
    neighbours, blur and calibration; relative for the board; of the part's temperature."""
    input_unit: str
    """mm, 1 or K; the quantity's own where it has no input of its own."""
    sensitivity: float
    """What the quantity changes by per unit of the input."""
    sigma: float
    """Standard uncertainty of the quantity by this part."""
    freedom: float
    """Degrees of freedom; ∞ where it follows from a model."""
    distribution: Distribution
    share: float
    """Share of the variance, 0…1."""


@dataclass(frozen=True, eq=False, repr=False)
class Budget(Frozen):
    """The uncertainty of a quantity in parts."""

    lines: tuple[BudgetLine, ...]
    """The parts, the largest first; parts of size 0 are left out."""
    sigma: float
    """Standard uncertainty: the root of the sum of the squares of all parts."""
    freedom: float
    """Effective degrees of freedom, by Welch and Satterthwaite."""
    unit: str
    """Of ``sigma``."""

    @property
    def k(self) -> float:
        """Coverage factor for 95 %: a value of Student's t; 2 for many degrees of freedom."""
        return coverage_factor(self.freedom)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U = k σ."""
        return self.k * self.sigma


def coverage_factor(freedom: float) -> float:
    """Return the factor k of a standard uncertainty that a value lies within with 95.45 %.

    Parameters
    ----------
    freedom : float > 0
        Degrees of freedom; rounded down, as JCGM 100:2008, G.6.4 asks, but to 1 at least.
    """
    upper = 0.5 * (1.0 + PROBABILITY)
    if not np.isfinite(freedom):
        return float(NormalDist().inv_cdf(upper))
    return float(scipy.special.stdtrit(max(np.floor(freedom), 1.0), upper))


def scales_of(stated: StatedUncertainty) -> Shares:
    """Return the stated errors of the scale, relative: of the board and by temperature."""
    found = (
        Share("board certificate", stated.board_scale, stated.board_freedom or np.inf),
        Share("temperature", stated.expansion_per_k * temperature_sigma(stated)),
    )
    return tuple(one for one in found if one.sigma > 0)


def temperature_sigma(stated: StatedUncertainty) -> float:
    """Return the standard deviation of the temperature, uniform within its limits, K."""
    return float(stated.temperature_k / np.sqrt(3.0))


def budget_of(
    found: Quantified, areas: Sequence[AreaPoints], stated: StatedUncertainty | None = None
) -> Budget:
    """Return the budget of a quantity that was measured on some areas."""
    inputs = _inputs(areas, stated or StatedUncertainty())
    parts = sorted(joined(found.shares), key=lambda one: -one.sigma)
    whole = total(parts)
    lines = []
    for one in parts:
        if not one.sigma > 0:
            continue
        size, unit = inputs.get(one.source, (0.0, ""))
        if not size > 0:
            size, unit = one.sigma, found.unit
        lines.append(
            BudgetLine(
                one.source,
                size,
                unit,
                one.sigma / size,
                one.sigma,
                one.freedom,
                "uniform" if one.source in UNIFORM else "normal",
                (one.sigma / whole) ** 2,
            )
        )
    return Budget(tuple(lines), whole, freedom_of(parts), found.unit)


def _inputs(
    areas: Sequence[AreaPoints], stated: StatedUncertainty
) -> dict[Source, tuple[float, str]]:
    """Standard uncertainty and unit of what the parts of some areas come from."""
    common = _rms([area.common for area in areas])
    return {
        "noise": (_rms([area.noise for area in areas]), "mm"),
        "neighbours": (common, "mm"),
        "calibration": (common, "mm"),
        "blur": (_rms([area.blur for area in areas]), "mm"),
        "board certificate": (stated.board_scale, "1"),
        "temperature": (temperature_sigma(stated), "K"),
    }


def _rms(values: Sequence[FloatMap]) -> float:
    every = np.concatenate([np.zeros(0), *values])
    return float(np.sqrt(np.mean(every**2))) if every.size else 0.0
