"""What the documentation promises, as numbers that a self-test checks.

``docs/promises.md`` holds the table that ``promise_table`` writes; a test compares them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fringeworks.evaluate.selftest.cases import CaseResult
from fringeworks.evaluate.selftest.scenes import BODIES, DISTURBANCES

PAIR_METHODS = ("windowed", "fourier", "windowed_fourier", "wavelet")
"""Methods for two frames that are tested: those that any pair of frames allows."""
FILTERS = ("fourier", "windowed_fourier", "wavelet")
"""Methods that filter about the carrier."""
LINEAR = ("noise", "strong noise", "shot noise", "defocus")
"""Disturbances that leave the fringes sinusoidal."""


@dataclass(frozen=True)
class Promise:
    """One promise: a quantity of some cases, and the limits that it keeps."""

    name: str
    """Short name, which a failure states."""
    text: str
    """The promise in words."""
    quantity: str
    """Name of the quantity in ``QUANTITIES``."""
    low: float
    """Smallest value that keeps the promise."""
    high: float
    """Largest value that keeps the promise."""
    ways: tuple[str, ...] = ("stack",)
    """Ways of measuring that it holds for."""
    disturbances: tuple[str, ...] = tuple(DISTURBANCES)
    """Disturbances that it holds for."""
    bodies: tuple[str, ...] = BODIES
    """Bodies that it holds for."""
    pooled: bool = False
    """Whether it holds for the mean over the cases, not for each of them."""

    def concerns(self, case: CaseResult) -> bool:
        """Whether a case is one of those that the promise is about."""
        return (
            case.way in self.ways
            and case.disturbance in self.disturbances
            and case.body in self.bodies
        )


QUANTITIES = {
    "within 1 σ": lambda case: case.within_1_sigma,
    "within 2 σ": lambda case: case.within_2_sigma,
    "typical error over bound": lambda case: case.typical / case.bound,
    "stated σ over bound": lambda case: case.sigma / case.bound,
    "size of the bias": lambda case: abs(case.bias),
    "gross errors": lambda case: case.gross,
    "measured": lambda case: case.measured,
}
"""Quantities of a case that promises are about."""


INFINITY = float("inf")
"""Limit of a quantity that has none on this side."""
PROMISES: tuple[Promise, ...] = (
    Promise(
        "stack coverage 1 σ",
        "Twelve frames: two thirds of the errors lie within the stated σ.",
        "within 1 σ",
        0.64,
        0.72,
        disturbances=LINEAR,
    ),
    Promise(
        "stack coverage 2 σ",
        "Twelve frames: 95 % of the errors lie within 2 σ.",
        "within 2 σ",
        0.935,
        0.97,
        disturbances=LINEAR,
    ),
    Promise(
        "stack coverage JPEG",
        "Twelve frames, JPEG 90: the stated σ still covers.",
        "within 2 σ",
        0.92,
        INFINITY,
        disturbances=("jpeg",),
    ),
    Promise(
        "stack coverage paint",
        "Twelve frames, hard edges of paint everywhere: fewer errors lie within 2 σ than should.",
        "within 2 σ",
        0.87,
        INFINITY,
        disturbances=("albedo",),
    ),
    Promise(
        "stack coverage gamma",
        "Twelve frames, γ = 2.2 and not corrected: the stated σ covers the ripple.",
        "within 2 σ",
        0.95,
        INFINITY,
        disturbances=("gamma",),
    ),
    Promise(
        "stack efficiency",
        "Twelve frames: no unbiased decoder could have much smaller errors from these frames.",
        "typical error over bound",
        0.97,
        1.05,
        disturbances=LINEAR,
    ),
    Promise(
        "stack sigma",
        "Twelve frames: the stated σ is that of the noise that was simulated.",
        "stated σ over bound",
        0.95,
        1.05,
        disturbances=LINEAR,
    ),
    Promise(
        "stack bias",
        "Twelve frames: the mean error is below one micrometre.",
        "size of the bias",
        -INFINITY,
        0.001,
    ),
    Promise(
        "stack orders",
        "Twelve frames: no point is off by half a fringe period.",
        "gross errors",
        -INFINITY,
        0.0,
    ),
    Promise(
        "stack measured",
        "Twelve frames without paint: lit pixels are measured.",
        "measured",
        0.92,
        INFINITY,
        disturbances=(*LINEAR, "gamma", "jpeg"),
    ),
    Promise(
        "windowed coverage",
        "`windowed`: the stated σ covers in every scene without paint.",
        "within 2 σ",
        0.90,
        INFINITY,
        ways=("windowed",),
        disturbances=(*LINEAR, "gamma", "jpeg"),
    ),
    Promise(
        "windowed coverage paint",
        "`windowed`, hard edges of paint everywhere: fewer errors lie within 2 σ than should.",
        "within 2 σ",
        0.70,
        INFINITY,
        ways=("windowed",),
        disturbances=("albedo",),
    ),
    Promise(
        "windowed coverage mean",
        "`windowed`: the mean over all scenes of the share within 2 σ.",
        "within 2 σ",
        0.94,
        INFINITY,
        ways=("windowed",),
        pooled=True,
    ),
    Promise(
        "windowed efficiency",
        "`windowed`: the typical error is hardly above the bound of a window of a quarter period.",
        "typical error over bound",
        -INFINITY,
        1.1,
        ways=("windowed",),
        disturbances=(*LINEAR, "gamma"),
    ),
    Promise(
        "filters coverage mean",
        "The other methods for two frames: the mean over all scenes of the share within 2 σ.",
        "within 2 σ",
        0.94,
        INFINITY,
        ways=FILTERS,
        pooled=True,
    ),
    Promise(
        "pair orders",
        "Two frames: hardly a pixel is off by half a fringe period, also at the cliffs.",
        "gross errors",
        -INFINITY,
        0.002,
        ways=PAIR_METHODS,
    ),
    Promise(
        "pair measured",
        "Two frames: lit pixels are measured.",
        "measured",
        0.95,
        INFINITY,
        ways=PAIR_METHODS,
    ),
)
"""All promises. Limits are those of the tables in docs/, rounded so that other seeds keep them."""


@dataclass(frozen=True)
class Judged:
    """A promise, and whether this machine keeps it."""

    promise: Promise
    kept: bool | None
    """None where no case was run that it concerns."""
    value: float
    """The value that is nearest to a limit, or furthest beyond it."""
    case: str
    """The case of this value; empty for a mean."""

    @property
    def sentence(self) -> str:
        """The outcome in one line."""
        if self.kept is None:
            return f"{self.promise.name}: not tested"
        where = f" ({self.case})" if self.case else ""
        state = "kept" if self.kept else "NOT KEPT"
        return (
            f"{self.promise.name}: {state}: {self.promise.quantity} {self.value:.4g}{where}, "
            f"promised {limits(self.promise)}"
        )


def limits(promise: Promise) -> str:
    """Limits of a promise in words."""
    if not np.isfinite(promise.high):
        return f"at least {promise.low:g}"
    if not np.isfinite(promise.low):
        return f"at most {promise.high:g}"
    return f"{promise.low:g} to {promise.high:g}"


def judge(promise: Promise, cases: Sequence[CaseResult]) -> Judged:
    """Judge one promise by the cases that it concerns.

    Parameters
    ----------
    promise : Promise
    cases : sequence of CaseResult

    Returns
    -------
    Judged. A case of which nothing was measured breaks its promises.
    """
    chosen = [case for case in cases if promise.concerns(case)]
    if not chosen:
        return Judged(promise, None, float("nan"), "")
    values = [QUANTITIES[promise.quantity](case) for case in chosen]
    if promise.pooled:
        mean = float(np.mean(values))
        return Judged(promise, _margin(promise, mean) >= 0, mean, "")
    margins = [_margin(promise, value) for value in values]
    worst = int(np.argmin(margins))
    case = chosen[worst]
    name = f"{case.name}: {case.why}" if case.why else case.name
    return Judged(promise, margins[worst] >= 0, values[worst], name)


def _margin(promise: Promise, value: float) -> float:
    """Distance to the nearer limit; negative beyond it, −∞ where there is no value."""
    if np.isnan(value):
        return float("-inf")
    return min(value - promise.low, promise.high - value)


def promise_table(promises: Iterable[Promise] = PROMISES) -> str:
    """The table of the promises for the documentation, Markdown."""
    lines = ["| name | promise | quantity | limits |", "|---|---|---|---|"]
    for one in promises:
        lines.append(f"| `{one.name}` | {one.text} | {one.quantity} | {limits(one)} |")
    return "\n".join(lines) + "\n"


def as_row(judged: Judged) -> dict[str, Any]:
    """A judged promise as a row of results."""
    one = judged.promise
    return {
        "promise": one.name,
        "text": one.text,
        "quantity": one.quantity,
        "low": one.low,
        "high": one.high,
        "value": judged.value,
        "case": judged.case,
        "kept": judged.kept,
    }
