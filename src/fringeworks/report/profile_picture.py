"""The picture of a profile: values with their error band, gaps where nothing is measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks.report.drawing import Axes
from fringeworks.report.maps import Picture
from fringeworks.report.reason_words import REASON_COLOURS, REASON_WORDS
from fringeworks.types import BoolMap, FloatMap, Profile, Reason
from fringeworks.types.numbers import percent, sigma_text

SIZE_INCH = (9.0, 4.4)
"""Width and height of the picture, inches."""
LINE = "#0072b2"
"""Colour of the values and, paler, of their band."""
BAND_SIGMAS = 2.0
"""Half width of the band in standard deviations: 95 % of normal errors lie in it."""
STRIP_SHARE = 0.03
"""Height of the strip of reasons at the foot of the picture, as a share of it."""


def profile_picture(title: str, profile: Profile) -> Picture:
    """Draw values over the distance along the line, with a band of ±2σ and gaps.

    Parameters
    ----------
    title : str
    profile : Profile

    Returns
    -------
    Picture
    """
    figure = Picture(figsize=SIZE_INCH, layout="constrained")
    axes = figure.add_subplot()
    place, unit = distances(profile)
    found = profile.sigma[np.isfinite(profile.sigma)]
    usual = (
        f"   ·   median σ {sigma_text(float(np.median(found)), profile.unit)}" if found.size else ""
    )
    shares = (
        f"{len(profile.values)} samples   ·   {percent(1.0 - profile.failed_fraction)} measured"
    )
    axes.set_title(f"{title}\n{shares}{usual}", fontsize=11)
    spread = BAND_SIGMAS * profile.sigma
    axes.fill_between(
        place,
        profile.values - spread,
        profile.values + spread,
        color=LINE,
        alpha=0.3,
        linewidth=0,
        label="±2σ of a sample",
    )
    axes.plot(place, profile.values, color=LINE, linewidth=1.2, label=profile.quantity)
    _lonely(axes, place, profile.values)
    _strip(axes, place, profile)
    axes.set_xlabel(f"distance along the line / {unit}")
    axes.set_ylabel(f"{profile.quantity} / {profile.unit}")
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_xlim(float(place.min()), float(place.max()))
    if profile.quantity == "depth z":
        axes.invert_yaxis()  # what is nearer to the camera lies higher
        axes.set_ylabel(f"{profile.quantity} from the camera / {profile.unit}, nearer is up")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    return figure


def distances(profile: Profile) -> tuple[FloatMap, str]:
    """Distance of every sample along the line, and its unit; unmeasured ones lie between."""
    known = None if profile.along_mm is None else np.isfinite(profile.along_mm)
    if profile.along_mm is None or known is None or known.sum() < 2:
        return profile.along_px, "px"
    place = np.interp(profile.along_px, profile.along_px[known], profile.along_mm[known])
    # Beyond the outermost measured samples, at the mean distance of neighbours.
    first, last = np.flatnonzero(known)[[0, -1]]
    step = (place[last] - place[first]) / (profile.along_px[last] - profile.along_px[first])
    place[:first] = place[first] + step * (profile.along_px[:first] - profile.along_px[first])
    place[last:] = place[last] + step * (profile.along_px[last:] - profile.along_px[last])
    return place, "mm"


def _lonely(axes: Axes, place: FloatMap, values: FloatMap) -> None:
    """Mark measured samples between two unmeasured ones, which no line shows."""
    missing = np.concatenate(([True], ~np.isfinite(values), [True]))
    alone = ~missing[1:-1] & missing[:-2] & missing[2:]
    axes.plot(place[alone], values[alone], ".", color=LINE, markersize=4)


def _strip(axes: Axes, place: FloatMap, profile: Profile) -> None:
    """A strip at the foot of the picture: why samples are missing, by colour."""
    half = 0.5 * np.median(np.abs(np.diff(place)))
    for reason in Reason:
        chosen = profile.reason == reason
        if reason == Reason.OK or not chosen.any():
            continue
        for run in _runs(chosen):
            axes.axvspan(
                place[run[0]] - half,
                place[run[-1]] + half,
                ymax=STRIP_SHARE,
                color=REASON_COLOURS[reason],
                linewidth=0,
            )
        axes.plot([], [], "s", color=REASON_COLOURS[reason], label=REASON_WORDS[reason].label)


def _runs(chosen: BoolMap) -> list[NDArray[np.intp]]:
    """The indices of every unbroken run of True."""
    index = np.flatnonzero(chosen)
    return [run for run in np.split(index, np.flatnonzero(np.diff(index) > 1) + 1) if len(run)]
