"""Control charts: a quantity of one part after another, with its limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.report.drawing import Figure
from fringeworks.types import FloatMap

SIZE_INCH = (9.0, 3.4)
"""Width and height of a chart, inches."""
COLOURS = {"pass": "#0072b2", "fail": "#d55e00", "undecided": "#e69f00"}
"""Colours of the verdicts, told apart by eyes that confuse red and green."""
MARKS = {"pass": "o", "fail": "X", "undecided": "D"}
"""Marks of the verdicts."""
BAND_SIGMAS = 2.0
"""Half length of a bar, standard deviations of a value."""
RANGE_TO_SIGMA = 1.128
"""Mean difference of neighbours over their standard deviation, for normal numbers (d₂ of two)."""
CONTROL_SIGMAS = 3.0
"""Distance of the control limits from the mean, standard deviations of the process."""
MOST_BARS = 300
"""Parts whose bars are drawn; more would hide the values."""


def control_limits(values: FloatMap) -> tuple[float, float, float]:
    """Return mean and control limits of a process, from the differences of neighbours.

    Notes
    -----
    A drift hardly changes the differences, and therefore not the limits: it leaves them (Shewhart's
    chart of individuals; ISO 7870-2).
    """
    known = values[np.isfinite(values)]
    if known.size < 2:
        return np.nan, np.nan, np.nan
    sigma = float(np.mean(np.abs(np.diff(known)))) / RANGE_TO_SIGMA
    mean = float(known.mean())
    return mean, mean - CONTROL_SIGMAS * sigma, mean + CONTROL_SIGMAS * sigma


def control_chart(
    title: str,
    values: FloatMap,
    sigma: FloatMap,
    verdicts: Sequence[str],
    limits: tuple[float | None, float | None],
) -> Figure:
    """Draw the values of a quantity in the order of the parts.

    Parameters
    ----------
    title : str
        The quantity and its unit.
    values, sigma : (n,) arrays
        NaN where a part was not measured.
    verdicts : n of "pass", "fail", "undecided"
    limits : (smallest, largest)
        The tolerance; None for none.
    """
    figure = Figure(figsize=SIZE_INCH, layout="constrained")
    axes = figure.add_subplot()
    number = np.arange(1, len(values) + 1)
    if len(values) <= MOST_BARS:
        axes.errorbar(
            number, values, BAND_SIGMAS * sigma, fmt="none", ecolor="#bbbbbb", elinewidth=1
        )
    for verdict, colour in COLOURS.items():
        chosen = np.array([one == verdict for one in verdicts]) & np.isfinite(values)
        if chosen.any():
            label = f"{verdict}: {int(chosen.sum())}"
            axes.plot(
                number[chosen], values[chosen], MARKS[verdict], color=colour, ms=4, label=label
            )
    for limit, name in zip(limits, ("smallest", "largest"), strict=True):
        if limit is not None:
            axes.axhline(limit, color="black", linewidth=1.4, label=f"{name} allowed {limit:g}")
    mean, low, high = control_limits(values)
    if np.isfinite(mean):
        axes.axhline(mean, color="#009e73", linewidth=1, label=f"mean {mean:.5g}")
        for limit in (low, high):
            axes.axhline(limit, color="#009e73", linewidth=1, linestyle="--")
        axes.plot([], [], "--", color="#009e73", label=f"control limits {low:.5g}, {high:.5g}")
    axes.set_title(title, fontsize=11)
    axes.set_xlabel("part")
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    return figure
