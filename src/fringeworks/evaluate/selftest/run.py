"""The self-test: run the cases, judge the promises."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

from fringeworks.evaluate.selftest.cases import CaseResult, pair_cases, stack_case
from fringeworks.evaluate.selftest.promises import (
    PAIR_METHODS,
    PROMISES,
    Judged,
    Promise,
    as_row,
    judge,
)
from fringeworks.evaluate.selftest.scenes import BODIES, DISTURBANCES
from fringeworks.types import InputError, Provenance, made_by

QUICK = (("sphere", "noise"), ("step", "jpeg"), ("plane", "defocus"))
"""Bodies and disturbances of a quick self-test: each body once."""
QUICK_METHODS = ("windowed", "fourier")
"""Methods for two frames in a quick self-test."""


@dataclass(frozen=True)
class SelfTest:
    """Errors of every case on this machine, and which promises they keep."""

    cases: tuple[CaseResult, ...]
    """How the errors of each case are distributed."""
    judged: tuple[Judged, ...]
    """Every promise, and whether it is kept."""
    seconds: float
    """Time that it took, s."""
    provenance: Provenance
    """How it was made."""

    @property
    def broken(self) -> tuple[Judged, ...]:
        """Promises that this machine does not keep."""
        return tuple(one for one in self.judged if one.kept is False)

    @property
    def passed(self) -> bool:
        """Whether every promise that was tested is kept."""
        return not self.broken

    def rows(self) -> list[dict[str, Any]]:
        """The cases as rows of a table."""
        return [asdict(case) for case in self.cases]

    def as_dict(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        return {
            "passed": self.passed,
            "seconds": self.seconds,
            "promises": [as_row(one) for one in self.judged],
            "cases": self.rows(),
            "provenance": self.provenance.as_dict(),
        }


def selftest(
    *,
    quick: bool = False,
    seed: int = 0,
    promises: tuple[Promise, ...] = PROMISES,
    progress: Callable[[str], None] = lambda _: None,
) -> SelfTest:
    """Measure known bodies on the virtual rig, and judge the promises by the results.

    Parameters
    ----------
    quick : bool
        Run three of the scenes and two of the methods only. Promises about others are not tested.
    seed : int ≥ 0
        Seed of the noise; other seeds are other frames.
    promises : tuple of Promise
        What is judged; all promises of the documentation by default.
    progress : callable
        Called with the name of each scene.

    Returns
    -------
    SelfTest

    Raises
    ------
    InputError for a negative seed.

    Notes
    -----
    A plane, a sphere and a step are measured by twelve frames and by two, under noise, strong
    noise, shot noise, a response of γ = 2.2, defocus, paint and JPEG. Truth and noise are those
    that were simulated. The judgement uses only two values that the package has estimated: the σ
    that is judged, and the modulation in the bound of stacks.

    Examples
    --------
    >>> found = selftest(quick=True)  # doctest: +SKIP
    >>> found.passed  # doctest: +SKIP
    True
    """
    if seed < 0:
        raise InputError(f"seed: expected at least 0, got {seed}")
    started = time.perf_counter()
    cases = tuple(_cases(quick, seed, progress))
    judged = tuple(judge(one, cases) for one in promises)
    origin = made_by("selftest", options={"quick": quick, "seed": seed})
    return SelfTest(cases, judged, time.perf_counter() - started, origin)


def _cases(quick: bool, seed: int, progress: Callable[[str], None]) -> Iterator[CaseResult]:
    """All cases, the scenes one after the other."""
    every = [(body, disturbance) for disturbance in DISTURBANCES for body in BODIES]
    for number, (body, disturbance) in enumerate(QUICK if quick else every):
        progress(f"{body}, {disturbance}: twelve frames")
        # Every scene has noise of its own.
        own = seed * len(every) + number
        yield stack_case(body, disturbance, seed=own)
        progress(f"{body}, {disturbance}: two frames")
        yield from pair_cases(body, disturbance, QUICK_METHODS if quick else PAIR_METHODS, seed=own)
