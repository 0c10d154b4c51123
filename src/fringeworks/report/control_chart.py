"""Control charts: a quantity of one part after another, with its limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fringeworks.evaluate.capability import CONTROL_SIGMAS, control_limits
from fringeworks.evaluate.nelson import control_series
from fringeworks.report.drawing import Axes, Figure
from fringeworks.report.verdicts import COVERAGE, VERDICT_COLOURS, VERDICT_MARKS
from fringeworks.types import FloatMap
from fringeworks.types.numbers import limit as limit_text
from fringeworks.types.numbers import number as number_text

SIZE_INCH = (9.6, 2.9)
"""Width and height of a chart, inches."""
PROCESS = "#009e73"
"""Colour of mean and control limits: green, which no verdict has."""
MOST_BARS = 300
"""Parts whose bars are drawn; more would hide the values."""
MOST_NAMES = 26
"""Names of parts below a chart, which fit beside each other when they stand upright."""
NAME_LETTERS = 16
"""Letters of a name that are shown below a chart; its end differs from part to part."""
SIGNAL_RISE_PT = 5
"""Height of the numbers of rules above their value, pt."""
ROOM = 0.12
"""Room above and below the values and limits, share of their range."""


def control_chart(
    title: str,
    values: FloatMap,
    sigma: FloatMap,
    verdicts: Sequence[str],
    limits: tuple[float | None, float | None],
    *,
    unit: str = "",
    names: Sequence[str] = (),
    order: str = "part",
    least: float = -np.inf,
    meanings: Mapping[str, str] | None = None,
) -> Figure:
    """Draw the values of a quantity in the order of the parts.

    Parameters
    ----------
    title : str
        The quantity.
    values, sigma : (n,) arrays
        NaN where a part was not measured.
    verdicts : n of "pass", "fail", "undecided"
    limits : (smallest, largest)
        The tolerance; None for none.
    unit : str
        Of the values.
    names : n texts
        Serial numbers of the parts; numbers from 1 without them.
    order : str
        What the parts are ordered by.
    least : float
        The smallest value that the quantity can have; no control limit is below it.
    meanings : mapping, optional
        What the verdicts mean where values are not of parts.
    """
    figure = Figure(figsize=SIZE_INCH, layout="constrained")
    axes = figure.add_subplot()
    place = np.arange(1, len(values) + 1)
    if len(values) <= MOST_BARS:
        axes.errorbar(place, values, COVERAGE * sigma, fmt="none", ecolor="#999999", elinewidth=1)
    for verdict, colour in VERDICT_COLOURS.items():
        chosen = np.array([one == verdict for one in verdicts]) & np.isfinite(values)
        if chosen.any():
            meant = verdict if meanings is None else meanings[verdict]
            label, mark = f"{meant}: {int(chosen.sum())}", VERDICT_MARKS[verdict]
            axes.plot(place[chosen], values[chosen], mark, color=colour, ms=4, label=label)
    for limit, name in zip(limits, ("smallest", "largest"), strict=True):
        if limit is not None:
            label = f"{name} allowed {limit_text(limit)} {unit}".rstrip()
            axes.axhline(limit, color="black", linewidth=1.4, label=label)
    process = _process(axes, values, unit, least)
    _signals(axes, values)
    _span(axes, values, [*process, *(v for v in limits if v is not None)])
    axes.set_title(title, fontsize=11)
    axes.set_ylabel(unit)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_xlabel(order)
    _name(axes, names or [str(k) for k in place])
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    return figure


def _process(axes: Axes, values: FloatMap, unit: str, least: float) -> tuple[float, ...]:
    """Draw the mean and the control limits that a value can reach; return these limits."""
    mean, low, high = control_limits(values)
    if not np.isfinite(mean):
        return ()
    sigma = (high - low) / (2 * CONTROL_SIGMAS)
    shown = [number_text(v, sigma) for v in (mean, low, high)]
    axes.axhline(mean, color=PROCESS, linewidth=1, label=f"mean {shown[0]} {unit}".rstrip())
    reached = (low, high) if low > least else (high,)
    for limit in reached:
        axes.axhline(limit, color=PROCESS, linewidth=1, linestyle="--")
    allowed = f"control limits\n{shown[1]} … {shown[2]}"
    label = allowed if low > least else f"control limit\n{shown[2]}"
    axes.plot([], [], "--", color=PROCESS, label=f"{label} {unit}".rstrip())
    return reached


def _signals(axes: Axes, values: FloatMap) -> None:
    """At values that complete a pattern of Nelson's rules, the number of the first such rule."""
    rules: dict[int, int] = {}
    for one in control_series(values).signals:
        rules[one.last] = min(one.rule, rules.get(one.last, one.rule))
    for place, rule in rules.items():
        axes.annotate(
            str(rule),
            (place + 1, values[place]),
            xytext=(0, SIGNAL_RISE_PT),
            textcoords="offset points",
            ha="center",
            fontsize=7,
            color=PROCESS,
        )
    if rules:
        axes.plot([], [], " ", label="digits: Nelson's rules")


def _span(axes: Axes, values: FloatMap, limits: Sequence[float]) -> None:
    """Show all values and limits; bars may run out of the picture."""
    known = [*values[np.isfinite(values)], *limits]
    if known and max(known) > min(known):
        room = ROOM * (max(known) - min(known))
        axes.set_ylim(min(known) - room, max(known) + room)


def _name(axes: Axes, names: Sequence[str]) -> None:
    """Names of the parts, or of every k-th one."""
    every = -(-len(names) // MOST_NAMES)
    shown = [
        name if len(name) <= NAME_LETTERS else f"…{name[1 - NAME_LETTERS :]}"
        for name in names[::every]
    ]
    axes.set_xticks(np.arange(1, len(names) + 1, every), shown, rotation=90, fontsize=8)
    for label in axes.get_xticklabels():
        label.set_parse_math(False)  # a dollar sign would begin a formula
    axes.set_xlim(0.2, len(names) + 0.8)
