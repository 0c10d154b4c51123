"""Small charts of a report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fringeworks.types import FloatMap
from fringeworks.types.numbers import number

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure

BINS = 80
"""Bars of a histogram: more than a column of pixels each on a page."""
SHOWN_PERCENTILES = (0.1, 99.9)
"""Range of a histogram, percent of the values: outliers do not flatten the rest."""
NARROW = 1e-6
"""Range of the values over their size below which they count as equal: single precision."""
TINY = 1e-12
"""Half of the range of a histogram of zeros, in the unit of the values."""
BAR = "#3b6ea8"
"""Colour of bars: dark blue."""
LINE = "#d9822b"
"""Colour of the median: orange, distinct from blue for all eyes."""


def histogram(values: FloatMap, label: str, *, what: str = "pixels") -> Figure:
    """Draw the distribution of values, with its median.

    Parameters
    ----------
    values : array
        NaN does not count.
    label : str
        Quantity and unit.
    what : str
        What is counted.
    """
    from fringeworks.report.drawing import Figure  # Matplotlib, for those only who draw

    figure = Figure(figsize=(5.2, 3.0), layout="constrained")
    axes = figure.add_subplot()
    finite = np.asarray(values, np.float64)[np.isfinite(values)]
    if finite.size:
        low, high = np.percentile(finite, SHOWN_PERCENTILES)
        # Equal values, to rounding, become one bar in the middle.
        half = 0.0 if high - low > NARROW * abs(high) else max(NARROW * abs(high), TINY)
        span = (low - half, high + half)
        axes.hist(np.clip(finite, *span), bins=BINS, range=span, color=BAR)
        median = float(np.median(finite))
        axes.axvline(median, color=LINE, linewidth=1.5, label=f"median {number(median)}")
        axes.legend()
    axes.set_xlabel(label)
    axes.set_ylabel(what)
    return figure
