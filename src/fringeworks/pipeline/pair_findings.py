"""What a pair's frames and displacement reveal about faults of the capture, and what to do."""

from __future__ import annotations

from typing import get_args

import numpy as np

from fringeworks.pair.carrier import find_carrier
from fringeworks.pair.counting import RowMethod
from fringeworks.types import DisplacementMap, InputError, Pair

FINITE_SIGMAS = 5.0
"""Smallest displacement that counts as the object's, in its standard deviations."""
MIN_OBJECT_PERIODS = 0.05
"""Smallest displacement that counts as the object's, periods; the reference plane bends less."""
ONE_SIDED = 0.95
"""Share of the object's pixels on one side of the reference from which the sign is judged."""
MIN_OBJECT_SHARE = 0.01
"""Smallest share of the frame that shows an object."""
NOISY_ROWS = 0.005
"""Median standard deviation from which row methods are advised against, periods."""
FEW_MEASURED = 0.5
"""Share of measured pixels below which a large loss is reported."""
MOSAIC_STEP = 0.1
"""Difference in mean brightness between pixels of even and odd rows and columns, over the mean,
from which a frame is a mosaic of colour filters. Raw frames under white light have 0.4 or more,
other frames less than 0.02."""


def pair_findings(pair: Pair, found: DisplacementMap) -> list[str]:
    """Describe likely faults of a capture, one sentence each: what was seen, and what to do.

    Parameters
    ----------
    pair : Pair
    found : DisplacementMap
        The displacement of that pair.

    Returns
    -------
    list of str; empty where nothing was found.
    """
    seen = (
        _mosaic(pair),
        _turned(pair, found),
        _swapped(pair, found),
        _rows(found),
        _mostly_lost(found),
    )
    return [text for text in seen if text]


def _mosaic(pair: Pair) -> str:
    """Frames of a colour camera before the channels are separated."""
    frame = np.nan_to_num(np.asarray(pair.object, dtype=np.float64), posinf=0.0, neginf=0.0)
    if min(frame.shape) < 2:
        return ""
    means = np.array([frame[v::2, u::2].mean() for v in (0, 1) for u in (0, 1)])
    step = float(np.ptp(means) / max(means.mean(), np.finfo(float).tiny))
    if not np.isfinite(step) or step < MOSAIC_STEP:
        return ""
    return (
        f"pixels of even and odd rows and columns differ in brightness by {100 * step:.0f} %: the "
        "object frame is probably a raw frame of a colour camera; places without fringes cannot be "
        "recognised in it; convert it to grey first"
    )


def _turned(pair: Pair, found: DisplacementMap) -> str:
    """Fringes of the two frames that do not run the same way, or differ in their period."""
    if pair.reference is None:
        return ""
    frame = np.nan_to_num(np.asarray(pair.object, dtype=np.float64), posinf=0.0, neginf=0.0)
    try:
        axis = find_carrier(frame, name="object").axis
    except InputError:
        return ""
    if axis == found.axis:
        return ""
    return (
        f"the reference's fringes vary along {found.axis}, those of the object frame mainly along "
        f"{axis}: one frame may be turned by 90° or belong to another capture; check the frames"
    )


def _swapped(pair: Pair, found: DisplacementMap) -> str:
    """An object that lies behind the reference plane nearly everywhere."""
    if pair.geometry is None:
        return ""
    u = found.displacement_px * pair.geometry.sign
    with np.errstate(invalid="ignore"):
        clear = np.abs(u) > np.maximum(
            FINITE_SIGMAS * found.sigma_px, MIN_OBJECT_PERIODS * found.period_px
        )
    if clear.mean() < MIN_OBJECT_SHARE:
        return ""
    behind = float(np.mean(u[clear] < 0))
    if behind < ONE_SIDED:
        return ""
    return (
        f"{100 * behind:.0f} % of the object lies behind the reference plane: the two frames may "
        "be swapped, or the projector is on the other side (sign); check both"
    )


def _rows(found: DisplacementMap) -> str:
    """A method of single pixels on frames with noise."""
    ok = np.isfinite(found.sigma_px)
    if found.method not in get_args(RowMethod) or not ok.any():
        return ""
    sigma = float(np.median(found.sigma_px[ok]))
    if sigma < NOISY_ROWS * found.period_px:
        return ""
    return (
        f"{found.method} uses single pixels and averages no noise: the standard deviation is "
        f"{sigma:.2f} px; windowed or fourier reach a fraction of that on photographs"
    )


def _mostly_lost(found: DisplacementMap) -> str:
    """A result that most pixels do not have."""
    measured = float(np.isfinite(found.displacement_px).mean())
    if measured >= FEW_MEASURED:
        return ""
    return (
        f"only {100 * measured:.0f} % of the pixels are measured: check that both frames show the "
        "same fringes, sharp and not saturated; the reasons are in the map of reasons"
    )
