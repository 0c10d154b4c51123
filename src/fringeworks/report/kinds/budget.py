"""What is shown of an uncertainty budget, and of Monte Carlo beside it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fringeworks.evaluate.budget import Budget, BudgetLine
from fringeworks.evaluate.monte_carlo import MonteCarlo
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.report.page.blocks import Block, Chapter, Table, Text
from fringeworks.report.page.chapter import Context
from fringeworks.types.numbers import estimate, number, percent, sigma_text

COLUMNS = ("source", "u of the input", "distribution", "sensitivity", "u", "ν", "share")
"""Columns of a budget."""
WHOLE = "together"
"""Name of the row of all parts."""
LEAST_SHARE = 0.001
"""Smallest share of a variance that is shown as a number: it changes σ by 0.05 %, and σ has two
digits."""
MANY_FREEDOM = 1000.0
"""Degrees of freedom from which on they are shown as ∞: k then differs from 2 by under 0.2 %."""
EXPLAINED = (
    "u is the standard uncertainty of the value by each source: the sensitivity times that of the "
    "input, which for points is the root mean square over the areas. Degrees of freedom ν add up "
    "by Welch and Satterthwaite; U = k u holds the true value with 95 % (JCGM 100:2008)."
)
"""What a reader needs to know about the table."""


def freedom_text(freedom: float) -> str:
    """Return degrees of freedom as a whole number, ∞ for many."""
    return "∞" if not freedom < MANY_FREEDOM else f"{int(freedom)}"


def _freedom(freedom: float) -> float | None:
    """Degrees of freedom for JSON, which has no ∞."""
    return float(freedom) if np.isfinite(freedom) else None


def figures(budget: Budget) -> dict[str, Any]:
    """The parts, and what they make together; None for ∞ degrees of freedom."""
    return {
        "sigma": budget.sigma,
        "freedom": _freedom(budget.freedom),
        "k": budget.k,
        "expanded": budget.expanded,
        "unit": budget.unit,
        "parts": [
            {
                "source": one.source,
                "input_sigma": one.input_sigma,
                "input_unit": one.input_unit,
                "distribution": one.distribution,
                "sensitivity": one.sensitivity,
                "sigma": one.sigma,
                "freedom": _freedom(one.freedom),
                "share": one.share,
            }
            for one in budget.lines
        ],
    }


def monte_carlo_figures(found: MonteCarlo) -> dict[str, Any]:
    """The draws beside the budget."""
    return {
        "draws": found.draws,
        "mean": found.mean,
        "sigma": found.sigma,
        "interval": list(found.interval),
        "numerical_tolerance": found.tolerance,
        "error": found.error,
        "differs": found.differs,
        "agrees": found.agrees,
    }


def rows(budget: Budget) -> list[tuple[str, ...]]:
    """Return the parts as rows, and all of them together."""
    together = (
        WHOLE,
        "",
        "",
        "",
        sigma_text(budget.sigma, budget.unit),
        freedom_text(budget.freedom),
        f"k = {number(budget.k)}, U = {sigma_text(budget.expanded, budget.unit)}",
    )
    return [*(_row(one, budget.unit) for one in budget.lines), together]


def _row(one: BudgetLine, unit: str) -> tuple[str, ...]:
    own = "" if one.input_unit == "1" else one.input_unit
    return (
        one.source,
        sigma_text(one.input_sigma, own),
        one.distribution,
        number(one.sensitivity),
        sigma_text(one.sigma, unit),
        freedom_text(one.freedom),
        _share_text(one.share),
    )


def _share_text(share: float) -> str:
    """A share of the variance; nobody reads the digits of a negligible one."""
    if share < LEAST_SHARE:
        return f"< {percent(LEAST_SHARE)}"
    most = 1.0 - LEAST_SHARE
    return f"> {percent(most)}" if most < share < 1.0 else percent(share)


def monte_carlo_text(found: MonteCarlo, unit: str) -> str:
    """Return what Monte Carlo says beside the budget, in a sentence or two."""
    low, high = (number(end, found.sigma) for end in found.interval)
    far, allowed = sigma_text(found.differs, unit), sigma_text(found.tolerance, unit)
    said = {
        True: f"agrees with the budget: ends differ by {far}, {allowed} are allowed",
        False: f"differs from the budget: an end by {far}, where {allowed} are allowed (JCGM "
        "101:2008, 8.1). Take this interval",
        None: "has too few draws to tell whether it agrees with the budget: ends differ by "
        f"{far} ± {sigma_text(found.error)}, {allowed} are allowed",
    }[found.agrees]
    return (
        f"Monte Carlo with {found.draws:,} draws: {estimate(found.mean, found.sigma, unit)}, "
        f"95 % within {low} … {high} {unit}. It {said}."
    )


def budget_blocks(
    name: str, budget: Budget | None, monte_carlo: MonteCarlo | None
) -> tuple[Block, ...]:
    """Return the blocks of a report: the table, and what Monte Carlo says."""
    if budget is None or not budget.lines:
        return ()
    table = Table(COLUMNS, tuple(rows(budget)), f"Uncertainty budget: {name}")
    if monte_carlo is None:
        return (table,)
    return (table, Text(monte_carlo_text(monte_carlo, budget.unit)))


def words(budget: Budget, _: dict[str, Any]) -> Iterator[Word]:
    """The budget as a table."""
    yield Rows(COLUMNS, rows(budget))


def chapter(budget: Budget, context: Context) -> Chapter:
    """The budget alone."""
    return Chapter(context.name, (*budget_blocks(context.name, budget, None), Text(EXPLAINED)))


describe(Budget, Kind(figures, words, chapter=chapter))
