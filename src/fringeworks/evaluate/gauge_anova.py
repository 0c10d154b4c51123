"""Gauge studies: repeatability and reproducibility from crossed trials, by analysis of variance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy

from fringeworks.evaluate.capability import CONFIDENCE, Interval
from fringeworks.types import LARGEST, FloatMap, Frozen, InputError, Plotted, finite, positive
from fringeworks.types.checks import unmasked

POOLING_LEVEL = 0.25
"""Significance above which the interaction is pooled with the repeatability (AIAG, Measurement
Systems Analysis, 4th edition, 2010, chapter III, ANOVA method)."""
SPREAD = 6.0
"""Width of the spread that is compared with a tolerance, in standard deviations: 99.73 % of normal
values (AIAG MSA, 4th edition; the editions before used 5.15)."""
CATEGORY_WIDTH = 1.41
"""Distinct categories per ratio of part variation to gauge variation, √2 as the manual rounds it
(AIAG MSA, 4th edition)."""
ACCEPTED = 0.10
"""Share up to which a gauge is accepted (AIAG MSA, 4th edition, table II-D 1)."""
REFUSED = 0.30
"""Share above which a gauge is not accepted; between the two, the use decides (the same table)."""
DRAWS = 20_000
"""Draws of a generalised confidence interval. They move its ends by 1 % of its width or so."""
SEED = 48
"""Seed of these draws, so that equal values have equal intervals."""
FEWEST = 2
"""Parts and trials of a study, at least: one value has no spread."""
MOST_NAMED = 3
"""Cells that a message names."""
NO_OPERATOR = ""
"""Name of the operator of a study that has none."""

Judgement = Literal["pass", "fail", "undecided"]


@dataclass(frozen=True, eq=False, repr=False)
class AnovaRow(Frozen):
    """A row of the table of the analysis of variance."""

    source: str
    """operators, parts, interaction, repeatability or total."""
    squares: float
    """Sum of squares, in the values' unit squared."""
    freedom: int
    """Degrees of freedom."""
    mean_square: float
    ratio: float
    """F: the mean square over that of what it is tested against; NaN where nothing is."""
    significance: float
    """Probability of a ratio as large or larger by chance; NaN as above."""


@dataclass(frozen=True, eq=False, repr=False)
class GaugeComponent(Frozen):
    """A component of the variation of a gauge study."""

    name: str
    """repeatability, operators, interaction, gauge, parts or total."""
    sigma: float
    """Standard deviation, in the values' unit."""
    interval: Interval
    """Confidence interval of 95 %."""
    total_share: float
    """Share of the total variation, of standard deviations: shares do not add up to 1."""
    total_interval: Interval
    tolerance_share: float
    """Spread over the width of the tolerance; NaN without a tolerance."""
    tolerance_interval: Interval


@dataclass(frozen=True, eq=False, repr=False)
class GaugeStudy(Frozen, Plotted):
    """Result of ``gauge_study``: components of variation, with 95 % confidence intervals."""

    layout = {"values": "fiu opr"}  # noqa: RUF012

    values: FloatMap
    """(operators, parts, trials), in their unit."""
    operators: tuple[str, ...]
    """Names in the order of the values; one empty name where there are no operators."""
    parts: tuple[str, ...]
    table: tuple[AnovaRow, ...]
    """Analysis of variance; the interaction always has its own row where there are operators."""
    pooled: bool
    """Whether the interaction counts as repeatability."""
    components: tuple[GaugeComponent, ...]
    tolerance: float | None
    """Width of the tolerance, in the values' unit."""
    spread: float
    """Standard deviations that are compared with the tolerance."""
    categories: int
    """Number of distinct categories ndc, rounded down."""
    categories_interval: Interval
    """Confidence interval of the number that is rounded."""

    def component(self, name: str) -> GaugeComponent:
        """Return the component of a name.

        Raises
        ------
        InputError for a name that the study does not have.
        """
        for one in self.components:
            if one.name == name:
                return one
        known = ", ".join(one.name for one in self.components)
        raise InputError(f"component: expected one of {known}, got {name!r}")

    @property
    def judged_share(self) -> float:
        """Share that the verdict follows from: of the tolerance, else of the total variation."""
        gauge = self.component("gauge")
        return gauge.total_share if self.tolerance is None else gauge.tolerance_share

    @property
    def verdict(self) -> Judgement:
        """``pass`` up to 10 %, ``fail`` above 30 %, ``undecided`` between: the use decides."""
        share = self.judged_share
        return "pass" if share <= ACCEPTED else "undecided" if share <= REFUSED else "fail"


def gauge_study(
    values: FloatMap,
    parts: Sequence[Any],
    operators: Sequence[Any] | None = None,
    *,
    tolerance: float | None = None,
    spread: float = SPREAD,
) -> GaugeStudy:
    """Estimate repeatability and reproducibility of a gauge from crossed trials.

    Parameters
    ----------
    values : (n,) array
        Measured values, in any unit.
    parts : n labels
        The part of each value.
    operators : n labels, optional
        The operator of each value, or the scanner, the fixture, the day. Without them, or with one,
        there is repeatability only.
    tolerance : float, optional
        Width of the tolerance, in the values' unit: largest minus smallest allowed.
    spread : float
        Standard deviations that are compared with the tolerance: 6, or 5.15 as older manuals say.

    Returns
    -------
    GaugeStudy

    Raises
    ------
    InputError for values that are not finite, a part that an operator did not measure as often as
    the others, fewer than two parts or trials, and trials that are all equal.

    Notes
    -----
    ``y = mean + part + operator + interaction + repeatability``, all random (AIAG, Measurement
    Systems Analysis, 4th edition, 2010). With o operators, p parts and r trials, and mean squares
    M, the variances are::

        repeatability  M_e
        interaction    (M_op − M_e) / r
        operators      (M_o − M_op) / (p r)
        parts          (M_p − M_op) / (o r)

    and 0 where they would be negative. An interaction whose significance is above 0.25 is pooled:
    M_e and M_op are then their mean, weighted by degrees of freedom. The gauge is the sum of the
    first three, the total the sum of all; ndc is 1.41 parts / gauge, rounded down.

    Intervals are generalised confidence intervals (Weerahandi, Journal of the American Statistical
    Association 88, 1993; Hamada and Weerahandi, Journal of Quality Technology 32, 2000): each mean
    square is replaced by M ν/χ²_ν. They never pool, because a test that finds no interaction does
    not show that there is none. Few operators make that of reproducibility wide.
    """
    cells, names, pieces = _cells(values, parts, operators)
    _check_tolerance(tolerance, spread)
    middle = cells - cells.mean()
    scale = float(np.abs(middle).max())
    if not scale >= 1 / LARGEST or not np.ptp(cells, axis=2).max() > 0:
        raise InputError(
            "values: expected trials that differ, got equal ones: their digits are too few to show "
            "the repeatability"
        )
    squares = _mean_squares(middle / scale)
    pooled = _is_pooled(squares)
    found = _variances(_pool(squares) if pooled else squares, cells.shape)
    drawn = _drawn(squares, cells.shape)
    ratio = CATEGORY_WIDTH * np.sqrt(drawn["parts"] / drawn["gauge"])
    distinct = CATEGORY_WIDTH * float(np.sqrt(found["parts"] / found["gauge"]))
    return GaugeStudy(
        cells,
        names,
        pieces,
        _table(squares, pooled, middle / scale, scale),
        pooled,
        _components(found, drawn, scale, tolerance, spread),
        tolerance,
        float(spread),
        int(distinct),
        interval_of(ratio),
    )


def interval_of(draws: FloatMap) -> Interval:
    """The interval that holds the middle 95 % of draws."""
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(draws, [tail, 100.0 - tail])
    return float(low), float(high)


def as_values(values: Any, name: str) -> FloatMap:
    """Return measured values as an array, which must be finite.

    Raises
    ------
    InputError for anything else.
    """
    try:
        known = np.asarray(unmasked(values, name))
        shape_ok = known.ndim == 1 and known.size > 0 and known.dtype.kind in "fiu"
    except InputError:
        raise
    except ValueError:
        shape_ok = False
    if not shape_ok:
        raise InputError(f"{name}: expected a list of numbers, got something else")
    known = known.astype(np.float64)
    wrong = np.flatnonzero(~(np.abs(known) <= LARGEST))
    if wrong.size:
        place = int(wrong[0])
        raise InputError(
            f"{name}: expected finite numbers, got {known.flat[place]} at index {place}; measure "
            "that trial again, or leave its part out"
        )
    return known


def _check_tolerance(tolerance: float | None, spread: float) -> None:
    if tolerance is not None and not positive(tolerance):
        raise InputError(f"tolerance: expected a width > 0, got {tolerance}")
    if not (finite(spread) and spread >= 1):
        raise InputError(f"spread: expected 1 or more standard deviations, got {spread}")


def _cells(
    values: Any, parts: Any, operators: Any
) -> tuple[FloatMap, tuple[str, ...], tuple[str, ...]]:
    """Values by operator, part and trial, with the names of operators and parts."""
    known = as_values(values, "values")
    which_part, pieces = _labels(parts, "parts", known.size)
    labels = [NO_OPERATOR] * known.size if operators is None else operators
    which, names = _labels(labels, "operators", known.size)
    cell = which * len(pieces) + which_part
    counts = np.bincount(cell, minlength=len(names) * len(pieces))
    if len(pieces) < FEWEST:
        raise InputError(f"parts: expected two parts or more, got {len(pieces)}")
    often = np.bincount(counts)
    usual = int(np.flatnonzero(often == often.max())[-1])
    odd = np.flatnonzero(counts != usual)
    if odd.size:
        said = [
            f"{_cell_name(names[k // len(pieces)], pieces[k % len(pieces)])} has {counts[k]}"
            for k in odd[:MOST_NAMED]
        ]
        more = f" and {odd.size - MOST_NAMED} more" if odd.size > MOST_NAMED else ""
        raise InputError(
            f"values: expected as many trials of every part by every operator, got {usual} of most,"
            f" but {', '.join(said)}{more}; measure what is missing, or leave these parts out"
        )
    if usual < FEWEST:
        raise InputError(f"values: expected two trials or more of every part, got {usual}")
    order = np.argsort(cell, kind="stable")
    return known[order].reshape(len(names), len(pieces), usual), names, pieces


def _cell_name(operator: str, part: str) -> str:
    return f"part {part}" + (f" by operator {operator}" if operator else "")


def _labels(labels: Any, name: str, count: int) -> tuple[Any, tuple[str, ...]]:
    """Number of each label, and the labels in the order of their first appearance."""
    if isinstance(labels, str | bytes) or not hasattr(labels, "__len__") or np.ndim(labels) == 0:
        raise InputError(f"{name}: expected a label for each value, got {labels!r}")
    listed = [str(one) for one in unmasked(labels, name).ravel().tolist()]
    if len(labels) != len(listed) or len(listed) != count:
        raise InputError(f"{name}: expected {count} labels, one for each value, got {len(listed)}")
    places: dict[str, int] = {}
    which = np.array([places.setdefault(one, len(places)) for one in listed])
    return which, tuple(places)


Squares = dict[str, tuple[Any, int]]
"""Mean square, or draws of it, and degrees of freedom by source."""


def _mean_squares(y: FloatMap) -> Squares:
    """Mean squares of a balanced design; operators and interaction only where there are several."""
    o, p, r = y.shape
    cell, by_operator, by_part = y.mean(axis=2), y.mean(axis=(1, 2)), y.mean(axis=(0, 2))
    whole = y.mean()
    error = float(np.sum((y - cell[:, :, None]) ** 2))
    part = o * r * float(np.sum((by_part - whole) ** 2))
    many = o * p * (r - 1)
    found = {"parts": (part / (p - 1), p - 1), "repeatability": (error / many, many)}
    if o > 1:
        rest = cell - by_operator[:, None] - by_part[None, :] + whole
        crossed = (o - 1) * (p - 1)
        found["operators"] = (
            p * r * float(np.sum((by_operator - whole) ** 2)) / (o - 1),
            o - 1,
        )
        found["interaction"] = (r * float(np.sum(rest**2)) / crossed, crossed)
    return found


def _chance(squares: Squares, source: str, against: str) -> tuple[float, float]:
    """Ratio of two mean squares, and the probability of a larger one."""
    (upper, freedom), (lower, rest) = squares[source], squares[against]
    ratio = upper / lower if lower > 0 else np.inf if upper > 0 else np.nan
    return float(ratio), float(scipy.special.fdtrc(freedom, rest, ratio))


def _is_pooled(squares: Squares) -> bool:
    if "interaction" not in squares:
        return False
    return _chance(squares, "interaction", "repeatability")[1] > POOLING_LEVEL


def _pool(squares: Squares) -> Squares:
    """The mean squares with interaction and repeatability as one."""
    (one, few), (other, many) = squares["interaction"], squares["repeatability"]
    pooled = ((one * few + other * many) / (few + many), few + many)
    return squares | {"interaction": pooled, "repeatability": pooled}


def _components_of(squares: Squares, shape: tuple[int, ...]) -> dict[str, Any]:
    """Components of variance of the sources, which chance can make negative."""
    o, p, r = shape
    error, part = squares["repeatability"][0], squares["parts"][0]
    found, rest = {"repeatability": error}, error
    if "operators" in squares:
        rest = squares["interaction"][0]
        found["operators"] = (squares["operators"][0] - rest) / (p * r)
        found["interaction"] = (rest - error) / r
    return found | {"parts": (part - rest) / (o * r)}


def _summed(parts: dict[str, Any]) -> dict[str, Any]:
    """Components with their sums, in the order in which they are shown."""
    gauge = {name: value for name, value in parts.items() if name != "parts"}
    whole = sum(gauge.values())
    return gauge | {"gauge": whole, "parts": parts["parts"], "total": whole + parts["parts"]}


def _variances(squares: Squares, shape: tuple[int, ...]) -> dict[str, Any]:
    """Components of variance, none below 0, and their sums."""
    raw = _components_of(squares, shape)
    return _summed({name: max(value, 0.0) for name, value in raw.items()})


def _drawn(squares: Squares, shape: tuple[int, ...]) -> dict[str, FloatMap]:
    """Draws of the generalised pivots of all components.

    Sums are those of the components as they are: with the negative ones at 0, the draws of the
    gauge are too large, and its interval held the true value 91 times out of 100.
    """
    rng = np.random.default_rng(SEED)
    drawn = {
        name: (mean * freedom / rng.chisquare(freedom, DRAWS), freedom)
        for name, (mean, freedom) in squares.items()
    }
    found = _summed(_components_of(drawn, shape))
    return {name: np.maximum(value, 0.0) for name, value in found.items()}


def _table(squares: Squares, pooled: bool, y: FloatMap, scale: float) -> tuple[AnovaRow, ...]:
    """The table; operators and parts are tested against the interaction, or what it is pooled
    into."""
    tested = _pool(squares) if pooled else squares
    has = "operators" in squares
    base = "interaction" if has else "repeatability"
    against = {"operators": base, "parts": base, "interaction": "repeatability"}
    rows = []
    for name in ("operators", "parts", "interaction", "repeatability"):
        if name not in squares:
            continue
        mean, freedom = squares[name]
        ratio, chance = np.nan, np.nan
        if name in against:
            ratio, chance = _chance(
                squares if name == "interaction" else tested, name, against[name]
            )
        mean *= scale**2
        rows.append(AnovaRow(name, mean * freedom, freedom, mean, ratio, chance))
    whole = float(np.sum((y - y.mean()) ** 2)) * scale**2
    rows.append(AnovaRow("total", whole, y.size - 1, whole / (y.size - 1), np.nan, np.nan))
    return tuple(rows)


def _components(
    found: dict[str, Any],
    drawn: dict[str, FloatMap],
    scale: float,
    tolerance: float | None,
    spread: float,
) -> tuple[GaugeComponent, ...]:
    """Standard deviations and shares of all components, with their intervals."""
    rows = []
    for name, variance in found.items():
        draws = np.broadcast_to(np.sqrt(drawn[name]), (DRAWS,))
        low, high = (scale * end for end in interval_of(draws))
        sigma = scale * float(np.sqrt(variance))
        wide = np.nan if tolerance is None else spread / tolerance
        rows.append(
            GaugeComponent(
                name,
                sigma,
                (low, high),
                float(np.sqrt(variance / found["total"])),
                interval_of(draws / np.sqrt(drawn["total"])),
                wide * sigma,
                (wide * low, wide * high),
            )
        )
    return tuple(rows)
