"""How an area moves: its displacement over time, and the spectrum of its vibration."""

from __future__ import annotations

import numpy as np

from fringeworks.evaluate.vibrations import Displacement, Vibration
from fringeworks.report.drawing import Figure
from fringeworks.types.numbers import number

SIZE_INCH = (9.0, 5.2)
"""Width and height of the figure, inches."""
MOST_NAMED = 3
"""Vibrations that are named in the figure; the largest ones."""


def motion_chart(
    title: str, moved: Displacement, spectrum: Vibration | None, *, rate_known: bool
) -> Figure:
    """Draw the displacement of an area and its spectrum.

    Parameters
    ----------
    title : str
        Name of the area.
    moved : Displacement
    spectrum : Vibration, optional
    rate_known : bool
        Whether times are in seconds; otherwise they are in frames.
    """
    figure = Figure(figsize=SIZE_INCH, layout="constrained")
    rows = 1 if spectrum is None else 2
    top = figure.add_subplot(rows, 1, 1)
    top.plot(moved.time_s, moved.distance_mm, color="#0072b2", linewidth=1)
    band = 2.0 * moved.sigma_mm
    top.fill_between(
        moved.time_s,
        moved.distance_mm - band,
        moved.distance_mm + band,
        color="#0072b2",
        alpha=0.25,
        linewidth=0,
        label="2 σ of noise",
    )
    if spectrum is not None:
        middle = np.nanmean(moved.distance_mm)
        line = middle + spectrum.drift_mm_per_s * (moved.time_s - moved.time_s.mean())
        top.plot(moved.time_s, line, "--", color="black", linewidth=1, label="drift")
    top.set(
        title=title,
        xlabel="time, s" if rate_known else "time, frames",
        ylabel="towards the camera, mm",
    )
    top.legend(fontsize="small")
    if spectrum is not None:
        _draw_spectrum(figure, spectrum, rate_known)
    return figure


def _draw_spectrum(figure: Figure, spectrum: Vibration, rate_known: bool) -> None:
    axes = figure.add_subplot(2, 1, 2)
    shown = spectrum.amplitude_mm > 0
    axes.semilogy(
        spectrum.frequency_hz[shown], spectrum.amplitude_mm[shown], color="#0072b2", linewidth=1
    )
    axes.semilogy(
        spectrum.frequency_hz, spectrum.floor_mm, color="#888888", linewidth=1, label="floor"
    )
    for frequency, amplitude in spectrum.peaks[:MOST_NAMED]:
        axes.annotate(
            f"{number(frequency)}: {number(1000 * amplitude)} µm",
            (frequency, amplitude),
            textcoords="offset points",
            xytext=(6, 2),
            fontsize="small",
        )
    axes.set(xlabel="frequency, Hz" if rate_known else "frequency, 1/frame", ylabel="amplitude, mm")
    axes.legend(fontsize="small")
