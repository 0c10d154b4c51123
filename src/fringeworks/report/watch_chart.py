"""The chart of a watched rig: how far each scan is over the limit of an alarm."""

from __future__ import annotations

import numpy as np

from fringeworks.report.drawing import Figure
from fringeworks.report.verdicts import VERDICT_COLOURS, VERDICT_MARKS
from fringeworks.rig.drift_watch import RigWatch

SIZE_INCH = (9.6, 3.2)
"""Width and height of the chart, inches."""
LOOKS = {"holds": "pass", "suspect": "undecided", "has moved": "fail"}
"""Verdicts of parts whose colours and marks those of scans have."""
MOST_NAMES = 26
"""Names of scans below the chart, which fit beside each other when they stand upright."""


def watch_chart(title: str, watch: RigWatch) -> Figure:
    """Draw the evidence of each scan, alone and with those before it, as a ratio to its limit."""
    figure = Figure(figsize=SIZE_INCH, layout="constrained")
    axes = figure.add_subplot()
    place = np.arange(1, len(watch.scans) + 1)
    verdicts = [one.verdict for one in watch.scans]
    excess = np.array([one.excess for one in watch.scans], float)
    own = np.array([one.own_excess for one in watch.scans], float)
    axes.plot(place, own, ".", color="#8c8c8c", ms=4, label="this scan alone")
    for verdict, look in LOOKS.items():
        chosen = np.array([one == verdict for one in verdicts], bool) & np.isfinite(excess)
        if chosen.any():
            label = f"{verdict}: {int(chosen.sum())}"
            mark, colour = VERDICT_MARKS[look], VERDICT_COLOURS[look]
            axes.plot(place[chosen], excess[chosen], mark, color=colour, ms=5, label=label)
    axes.axhline(1.0, color="#d55e00", linewidth=1.4, label="limit of an alarm")
    learnt = verdicts.count("learning")
    if learnt:
        axes.axvspan(0.5, learnt + 0.5, color="#8c8c8c", alpha=0.2, label=f"learning: {learnt}")
    axes.set_title(title)
    axes.set_xlim(0.5, max(len(place), 1) + 0.5)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("scan")
    axes.set_ylabel("evidence / limit")
    if 0 < len(place) <= MOST_NAMES:
        axes.set_xticks(place, [one.name for one in watch.scans], rotation=90, fontsize=7)
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    return figure
