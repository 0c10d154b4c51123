"""Values of an acceptance test against their limits."""

from __future__ import annotations

import numpy as np

from fringeworks.evaluate.acceptance.certify import NAMES, Certificate, QualityParameter
from fringeworks.report.drawing import Axes, Figure
from fringeworks.report.verdicts import VERDICT_COLOURS, VERDICT_MARKS

CHART_INCH = (9.6, 2.2)
"""Width, and height for each parameter, inches."""
ROOM = 1.15
"""Largest height that is shown, over that of values and limits."""
MICRO = 1e3
"""µm in a millimetre."""
SIGNED = ("PS", "SD")
"""Parameters whose values may be negative."""


def certificate_chart(found: Certificate, name: str | None) -> Figure:
    """Draw the values of each quality parameter with its limit."""
    count = len(found.parameters)
    figure = Figure(figsize=(CHART_INCH[0], CHART_INCH[1] * max(count, 1)), layout="constrained")
    for k, one in enumerate(found.parameters):
        axes = figure.add_subplot(count, 1, k + 1)
        _draw(axes, one)
    if name is not None:
        figure.suptitle(name, fontsize=11)
    return figure


def _draw(axes: Axes, one: QualityParameter) -> None:
    values = MICRO * np.array(one.values_mm)
    verdict = one.verdict or "pass"
    place = np.arange(1, len(values) + 1)
    axes.plot(place, values, VERDICT_MARKS[verdict], color=VERDICT_COLOURS[verdict], ms=5)
    high = float(np.abs(values).max())
    if one.limit_mm is not None:
        most = MICRO * one.limit_mm
        high = max(high, most)
        for side in (1.0, -1.0) if one.parameter in SIGNED else (1.0,):
            axes.axhline(side * most, color="black", linestyle="--", linewidth=1.2)
    axes.set_ylim(-ROOM * high if one.parameter in SIGNED else 0.0, ROOM * high)
    axes.set_title(f"{one.parameter}: {NAMES[one.parameter]}", fontsize=10, loc="left")
    axes.set_ylabel("µm")
    axes.set_xticks(place)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
