"""Nelson's rules: patterns in a series of values that chance hardly makes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringeworks.evaluate.capability import CONTROL_SIGMAS, FEWEST, control_limits
from fringeworks.types import BoolMap, FloatMap, Frozen, InputError, finite, unmasked

RULES = {
    1: "a value beyond 3 σ",
    2: "nine values in a row on one side of the mean",
    3: "six values in a row that rise, or fall",
    4: "fourteen values in a row that rise and fall in turn",
    5: "two of three values in a row beyond 2 σ on one side",
    6: "four of five values in a row beyond 1 σ on one side",
    7: "fifteen values in a row within 1 σ",
    8: "eight values in a row beyond 1 σ on either side",
}
"""What each rule finds (L. S. Nelson, Journal of Quality Technology 16, 1984, 237–239,
doi:10.1080/00224065.1984.11978921)."""
MEANINGS = {
    1: "one value that differs from the others",
    2: "the mean has moved",
    3: "a drift",
    4: "two causes in turn, such as two operators",
    5: "a larger shift",
    6: "a smaller shift",
    7: "σ is too large for what is charted, or values of several sources are mixed",
    8: "values of two sources are mixed",
}
"""What each rule usually means."""
LENGTHS = {1: 1, 2: 9, 3: 6, 4: 14, 5: 3, 6: 5, 7: 15, 8: 8}
"""Values that each rule looks at."""


@dataclass(frozen=True, eq=False, repr=False)
class NelsonSignal(Frozen):
    """A pattern in a series."""

    rule: int
    """Number of the rule, 1…8."""
    first: int
    """Place of its first value in the series, from 0 on."""
    last: int
    """Place of the value that completed it."""

    def __str__(self) -> str:
        place = f"value {self.last + 1}"
        if self.first < self.last:
            place = f"values {self.first + 1} to {self.last + 1}"
        return f"rule {self.rule}, {place}: {RULES[self.rule]}: {MEANINGS[self.rule]}"


@dataclass(frozen=True, eq=False, repr=False)
class ControlSeries(Frozen):
    """A series of values on a control chart."""

    layout = {"values": "f n"}  # noqa: RUF012

    values: FloatMap
    """(n,); NaN where nothing was measured: it interrupts no run."""
    mean: float
    """Centre line."""
    sigma: float
    """Standard deviation of one value; NaN where too few values tell it."""
    signals: tuple[NelsonSignal, ...]
    """Patterns that chance hardly makes, in the order in which they were completed."""

    @property
    def limits(self) -> tuple[float, float]:
        """Control limits: the mean ± 3 σ."""
        reach = CONTROL_SIGMAS * self.sigma
        return self.mean - reach, self.mean + reach


def control_series(
    values: ArrayLike, *, mean: float | None = None, sigma: float | None = None
) -> ControlSeries:
    """Look for the eight patterns of Nelson in a series of values.

    Parameters
    ----------
    values : (n,) array
        In the order in which they were measured; NaN where nothing was.
    mean, sigma : float, optional
        Centre line and standard deviation, from a time when the process was in control. By default
        the mean of the values, and σ from the differences of neighbours.

    Returns
    -------
    ControlSeries; each value that completes a pattern is a signal, so that a long run has several.

    Raises
    ------
    InputError for values that are no series of numbers, and a σ that is not above 0.

    Notes
    -----
    Of independent normal values with known mean and σ, one in 44 completes a pattern by chance;
    docs/control.md has the rate of each rule.

    Examples
    --------
    >>> found = control_series([0.1, -0.3, 0.2, -0.1, 0.3, 4.0], mean=0.0, sigma=1.0)
    >>> [(one.rule, one.last) for one in found.signals]
    [(1, 5)]
    """
    series = unmasked(values, "values")
    if series.ndim != 1 or series.dtype.kind not in "fiu":
        raise InputError(f"values: expected numbers (n,), got {series.dtype} {series.shape}")
    series = series.astype(np.float64)
    if np.isinf(series).any():
        raise InputError("values: expected finite numbers or NaN, got ∞")
    if sigma is not None and not (finite(sigma) and sigma > 0):
        raise InputError(f"sigma: expected a number > 0, got {sigma}")
    if mean is not None and not finite(mean):
        raise InputError(f"mean: expected a finite number, got {mean}")
    middle, _, high = control_limits(series)
    centre = middle if mean is None else float(mean)
    spread = (high - middle) / CONTROL_SIGMAS if sigma is None else float(sigma)
    at = np.flatnonzero(np.isfinite(series))
    found: list[NelsonSignal] = []
    if np.isfinite(centre) and spread > 0 and (len(at) >= FEWEST or sigma is not None):
        z = (series[at] - centre) / spread
        for rule, test in TESTS.items():
            length = LENGTHS[rule]
            for end in np.flatnonzero(test(z)):
                found.append(NelsonSignal(rule, int(at[end - length + 1]), int(at[end])))
    found.sort(key=lambda one: (one.last, one.rule))
    return ControlSeries(series, centre, float(spread), tuple(found))


def _runs(holds: BoolMap, length: int, least: int | None = None) -> BoolMap:
    """Which values end a stretch of a length in which ``least`` values, or all, hold."""
    count: NDArray[np.int64] = np.cumsum(np.concatenate(([0], holds)))
    ends = np.zeros(len(holds), bool)
    if len(holds) >= length:
        ends[length - 1 :] = count[length:] - count[:-length] >= (least or length)
    return ends


def _either(one: BoolMap, other: BoolMap, length: int, least: int | None = None) -> BoolMap:
    """Stretches to either side; the value that completes one belongs to it."""
    return np.asarray(
        (_runs(one, length, least) & one) | (_runs(other, length, least) & other), bool
    )


def _beyond(z: FloatMap) -> BoolMap:
    return np.asarray(np.abs(z) > CONTROL_SIGMAS)


def _one_side(z: FloatMap) -> BoolMap:
    return _either(z > 0, z < 0, LENGTHS[2])


def _steps(z: FloatMap) -> FloatMap:
    """Each value less the one before; the first has none."""
    return np.diff(z, prepend=z[:1])


def _trend(z: FloatMap) -> BoolMap:
    step = _steps(z)
    # Six values have five steps between them.
    return _either(step > 0, step < 0, LENGTHS[3] - 1)


def _in_turn(z: FloatMap) -> BoolMap:
    step = _steps(z)
    turned = np.concatenate(([False], step[1:] * step[:-1] < 0))[: len(z)]
    # Fourteen values have twelve turns between their thirteen steps.
    return _runs(turned, LENGTHS[4] - 2)


def _two_of_three(z: FloatMap) -> BoolMap:
    return _either(z > 2.0, z < -2.0, LENGTHS[5], 2)


def _four_of_five(z: FloatMap) -> BoolMap:
    return _either(z > 1.0, z < -1.0, LENGTHS[6], 4)


def _near(z: FloatMap) -> BoolMap:
    return _runs(np.abs(z) < 1.0, LENGTHS[7])


def _far(z: FloatMap) -> BoolMap:
    return _runs(np.abs(z) > 1.0, LENGTHS[8])


TESTS = {
    1: _beyond,
    2: _one_side,
    3: _trend,
    4: _in_turn,
    5: _two_of_three,
    6: _four_of_five,
    7: _near,
    8: _far,
}
"""Which values complete each pattern, of values in σ from the mean."""
