"""Small charts of a report: histograms, residuals, coverage."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fringeworks.rig.calibration.calibrate import Calibration
from fringeworks.types import FloatMap

BINS = 80
"""Bars of a histogram: more than a column of pixels each on a page."""
SHOWN_PERCENTILES = (0.1, 99.9)
"""Range of a histogram, percent of the values: outliers do not flatten the rest."""
BAR = "#3b6ea8"
"""Colour of bars and of the camera: dark blue, distinct from orange for all eyes."""
OTHER = "#d9822b"
"""Colour of the second series, and of the projector: orange."""


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
    figure = Figure(figsize=(5.2, 3.0), layout="constrained")
    axes = figure.add_subplot()
    finite = np.asarray(values, np.float64)[np.isfinite(values)]
    if finite.size:
        low, high = np.percentile(finite, SHOWN_PERCENTILES)
        span = (low, high) if high > low else (low - 0.5, high + 0.5)
        axes.hist(np.clip(finite, *span), bins=BINS, range=span, color=BAR)
        median = float(np.median(finite))
        axes.axvline(median, color=OTHER, linewidth=1.5, label=f"median {median:.4g}")
        axes.legend()
    axes.set_xlabel(label)
    axes.set_ylabel(what)
    return figure


def pose_residuals(calibration: Calibration, rows: Sequence[dict[str, object]]) -> Figure:
    """Draw the residuals of every pose, of both devices."""
    figure = Figure(figsize=(max(5.2, 0.55 * len(rows) + 2), 3.2), layout="constrained")
    axes = figure.add_subplot()
    place = np.arange(len(rows))
    for k, (device, colour) in enumerate((("camera", BAR), ("projector", OTHER))):
        values = [float(row[f"{device}_rms_px"]) for row in rows]  # type: ignore[arg-type]
        axes.bar(place + 0.4 * (k - 0.5), values, 0.4, label=device, color=colour)
    axes.set_xticks(place, [str(row["pose"]) for row in rows], rotation=60, ha="right")
    axes.set_ylabel("residual (rms) / px")
    axes.set_title(f"Residuals of {len(calibration.observations)} poses")
    axes.legend()
    return figure


def corner_coverage(calibration: Calibration) -> Figure:
    """Draw where in both frames corners were seen, with the direction of their residuals."""
    first = calibration.observations[0]
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    observed = [o.view.pixels for o in calibration.observations]
    lit = [o.found.projector_px for o in calibration.observations]
    for k, (name, size, poses) in enumerate(
        (("camera", first.camera_size, observed), ("projector", first.projector_size, lit))
    ):
        axes = figure.add_subplot(1, 2, k + 1)
        for pixels in poses:
            axes.plot(pixels[:, 0], pixels[:, 1], ".", markersize=4)
        axes.set_xlim(0, size[0])
        axes.set_ylim(size[1], 0)
        axes.set_aspect("equal")
        axes.set_xlabel("x / px")
        axes.set_ylabel("y / px")
        axes.set_title(f"Corners in the {name}'s frame, a colour for each pose")
    return figure
