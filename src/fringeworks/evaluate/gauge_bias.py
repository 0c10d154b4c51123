"""Bias of a gauge: Cg and Cgk at one reference, linearity over several."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from fringeworks.evaluate.capability import CONFIDENCE, Interval
from fringeworks.evaluate.gauge_anova import (
    DRAWS,
    FEWEST,
    SEED,
    SPREAD,
    Judgement,
    as_values,
    interval_of,
)
from fringeworks.types import LARGEST, FloatMap, Frozen, InputError, Plotted, finite, positive

TOLERANCE_SHARE = 0.2
"""Share of the tolerance that Cg compares with the spread of repeated trials: 20 %, the default of
the automotive handbooks (Bosch, Quality Management in the Bosch Group, booklet 10, 2019)."""
CAPABLE = 1.33
"""Cg and Cgk from which a gauge is accepted (the same booklet)."""
SIGNIFICANT = 1.0 - CONFIDENCE
"""Significance below which a bias, slope or curvature counts as real."""
FEWEST_REFERENCES = 3
"""Reference values of a study of linearity, at least: two show no curvature."""


@dataclass(frozen=True, eq=False, repr=False)
class GaugeType1(Frozen, Plotted):
    """Result of ``gauge_type1``: bias, Cg and Cgk, with 95 % confidence intervals."""

    layout = {"values": "fiu n"}  # noqa: RUF012

    values: FloatMap
    """(n,), in their unit, in the order of the trials."""
    reference: float
    tolerance: float
    """Width of the tolerance, in the values' unit."""
    share: float
    """Share of the tolerance that counts."""
    spread: float
    """Standard deviations that it is compared with."""
    mean: float
    sigma: float
    """Standard deviation of the trials."""
    bias: float
    """Mean minus reference."""
    bias_sigma: float
    """Its standard uncertainty: of the mean, and of the reference."""
    bias_interval: Interval
    t: float
    """Bias over its standard uncertainty."""
    significance: float
    """Probability of a t as far from 0 or farther by chance."""
    cg: float
    cg_interval: Interval
    cgk: float
    cgk_interval: Interval

    @property
    def verdict(self) -> Judgement:
        """``pass`` where Cg and Cgk are 1.33 or more, else ``fail``."""
        return "pass" if min(self.cg, self.cgk) >= CAPABLE else "fail"


@dataclass(frozen=True, eq=False, repr=False)
class GaugeLinearity(Frozen, Plotted):
    """Result of ``gauge_linearity``: the line of the bias over the reference values."""

    layout = {  # noqa: RUF012
        "values": "fiu n",
        "references": "fiu n",
        "levels": "fiu k",
        "mean_bias": "fiu k",
        "line": "fiu k",
        "band": "fiu k",
    }

    values: FloatMap
    """(n,), in their unit."""
    references: FloatMap
    """(n,), the calibrated value of each."""
    levels: FloatMap
    """(k,), the different references in rising order."""
    mean_bias: FloatMap
    """(k,), mean of value minus reference at each level."""
    line: FloatMap
    """(k,), the bias that the line has there."""
    band: FloatMap
    """(k,), half of the line's confidence interval of 95 % there."""
    slope: float
    slope_sigma: float
    slope_significance: float
    intercept: float
    """Bias that the line has at a reference of 0."""
    intercept_sigma: float
    intercept_significance: float
    sigma: float
    """Standard deviation of the bias about the line."""
    curvature_significance: float
    """Probability that chance moves the means as far from the line (test of lack of fit)."""

    @property
    def straight(self) -> bool:
        """Whether the means agree with the line."""
        return bool(self.curvature_significance >= SIGNIFICANT)

    @property
    def verdict(self) -> Judgement:
        """``pass`` where the line and 0 agree at every level, ``fail`` where not, ``undecided``
        where the bias is not on a line."""
        if not self.straight:
            return "undecided"
        return "pass" if bool((np.abs(self.line) <= self.band).all()) else "fail"


def gauge_type1(
    values: FloatMap,
    reference: float,
    tolerance: float,
    *,
    share: float = TOLERANCE_SHARE,
    spread: float = SPREAD,
    reference_sigma: float = 0.0,
) -> GaugeType1:
    """Compare repeated measurements of one reference with its calibrated value.

    Parameters
    ----------
    values : (n,) array
        Measured values, usually 50, in any unit.
    reference : float
        Calibrated value, in the same unit.
    tolerance : float
        Width of the tolerance: largest minus smallest allowed.
    share : float
        Share of the tolerance that counts, 0.2 in most handbooks; 0.15 in some.
    spread : float
        Standard deviations that it is compared with: 6, or 4.
    reference_sigma : float
        Standard uncertainty of the reference, from its certificate: U / k.

    Returns
    -------
    GaugeType1

    Raises
    ------
    InputError for fewer than two values, values that are all equal, and limits that are not > 0.

    Notes
    -----
    ``Cg = share T / (spread s)`` and ``Cgk = (share T / 2 − |bias|) / (spread s / 2)`` (Bosch
    booklet 10, 2019; AIAG, Measurement Systems Analysis, 4th edition, 2010, for the bias). The
    t-test has n − 1 degrees of freedom; those that the reference's uncertainty adds follow from
    Welch and Satterthwaite (GUM, JCGM 100:2008, G.4), with infinitely many of its own. The interval
    of Cg follows from the chi-square distribution, that of Cgk is a generalised one (Weerahandi,
    1993), in which the reference's uncertainty is part.
    """
    known = as_values(values, "values")
    limits = {"tolerance": tolerance, "share": share, "spread": spread}
    for name, value in limits.items():
        if not positive(value):
            raise InputError(f"{name}: expected a number > 0, got {value}")
    if not finite(reference):
        raise InputError(f"reference: expected a number, got {reference}")
    if not (finite(reference_sigma) and reference_sigma >= 0):
        raise InputError(f"reference_sigma: expected 0 or more, got {reference_sigma}")
    sigma = _spread_of(known)
    n, bias = known.size, float(np.mean(known - reference))
    mean_sigma = sigma / float(np.sqrt(n))
    bias_sigma = float(np.hypot(mean_sigma, reference_sigma))
    freedom = (n - 1) * (bias_sigma / mean_sigma) ** 4
    t = bias / bias_sigma
    reach = bias_sigma * _quantile(freedom)
    half, wide = 0.5 * share * tolerance, 0.5 * spread
    rng = np.random.default_rng(SEED)
    sigmas = sigma * np.sqrt((n - 1) / rng.chisquare(n - 1, DRAWS))
    off = bias - sigmas / np.sqrt(n) * rng.normal(size=DRAWS)
    off = off - reference_sigma * rng.normal(size=DRAWS)
    cg = half / (wide * sigma)
    tail = 0.5 * (1.0 - CONFIDENCE)
    chi = [2.0 * float(scipy.special.gammaincinv(0.5 * (n - 1), p)) for p in (tail, 1.0 - tail)]
    low, high = (cg * float(np.sqrt(one / (n - 1))) for one in chi)
    return GaugeType1(
        known, float(reference), float(tolerance), float(share), float(spread),
        float(known.mean()), sigma, bias, bias_sigma, (bias - reach, bias + reach), t,
        _two_sided(t, freedom), cg, (low, high), (half - abs(bias)) / (wide * sigma),
        interval_of((half - np.abs(off)) / (wide * sigmas)),
    )  # fmt: skip


def gauge_linearity(values: FloatMap, references: FloatMap) -> GaugeLinearity:
    """Fit a line to the bias of a gauge over several reference values.

    Parameters
    ----------
    values : (n,) array
        Measured values, in any unit.
    references : (n,) array
        Calibrated value of each, in the same unit: three different ones or more, one of them
        measured twice or more.

    Returns
    -------
    GaugeLinearity

    Raises
    ------
    InputError for fewer references or trials, values that are not finite, and trials that lie on a
    line exactly.

    Notes
    -----
    ``bias = intercept + slope reference`` by least squares; the band at a reference x is
    ``t s √(1/n + (x − x̄)²/S_xx)`` with n − 2 degrees of freedom (AIAG, Measurement Systems
    Analysis, 4th edition, 2010, chapter III, linearity). Whether the bias lies on a line at all is
    tested against the scatter of the trials at each reference (lack of fit; Draper and Smith,
    Applied Regression Analysis, 1998). The references' own uncertainties are not part of the band.
    """
    known, x = as_values(values, "values"), as_values(references, "references")
    if known.shape != x.shape:
        raise InputError(f"references: expected {known.size} numbers, got {x.size}")
    levels, which = np.unique(x, return_inverse=True)
    n, k = known.size, levels.size
    scale = float(np.ptp(x))
    if k < FEWEST_REFERENCES or not scale >= 1 / LARGEST:
        raise InputError(f"references: expected three different ones or more, got {k}")
    if n == k:
        raise InputError("values: expected two trials or more of a reference, got one of each")
    bias, middle = known - x, float(x.mean())
    u = (x - middle) / scale
    s_uu, height = float(u @ u), float(bias.mean())
    slope = float(u @ (bias - height)) / s_uu
    means = np.bincount(which, bias) / np.bincount(which)
    rest, pure = bias - height - slope * u, bias - means[which]
    sigma = float(np.linalg.norm(rest)) / float(np.sqrt(n - 2))
    equal = np.unique(np.stack([x, known]), axis=1).shape[1] == k
    if not sigma >= 1 / LARGEST or equal:
        raise InputError("values: expected trials that scatter, got equal ones")
    at = (levels - middle) / scale
    half = sigma * np.sqrt(1.0 / n + at**2 / s_uu)
    zero = -middle / scale
    intercept, slope_sigma = height + slope * zero, sigma / float(np.sqrt(s_uu))
    intercept_sigma = sigma * float(np.sqrt(1.0 / n + zero**2 / s_uu))
    return GaugeLinearity(
        known, x, levels, means, height + slope * at, _quantile(n - 2) * half,
        slope / scale, slope_sigma / scale, _two_sided(slope / slope_sigma, n - 2),
        intercept, intercept_sigma, _two_sided(intercept / intercept_sigma, n - 2), sigma,
        _lack_of_fit(rest, pure, k),
    )  # fmt: skip


def _spread_of(known: FloatMap) -> float:
    """Standard deviation of the trials, which must differ."""
    if known.size < FEWEST:
        raise InputError(f"values: expected two values or more, got {known.size}")
    sigma = float(np.std(known, ddof=1))
    if not (sigma >= 1 / LARGEST and np.ptp(known) > 0):
        raise InputError(
            "values: expected values that differ, got equal ones: their digits are too few to show "
            "the repeatability"
        )
    return sigma


def _lack_of_fit(rest: FloatMap, pure: FloatMap, levels: int) -> float:
    """Probability that chance moves the means as far from a line."""
    n, inside = rest.size, float(pure @ pure)
    outside = max(float(rest @ rest) - inside, 0.0)
    few, many = levels - 2, n - levels
    ratio = (outside / few) / (inside / many)
    return float(scipy.special.fdtrc(few, many, ratio))


def _quantile(freedom: float) -> float:
    """Student's t that holds 95 % of chances to both sides."""
    return float(scipy.special.stdtrit(freedom, 0.5 * (1.0 + CONFIDENCE)))


def _two_sided(t: Any, freedom: float) -> float:
    """Probability of a t as far from 0 or farther by chance."""
    return 2.0 * float(scipy.special.stdtr(freedom, -abs(t)))
