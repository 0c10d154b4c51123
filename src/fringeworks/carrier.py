"""The carrier: which way the fringes vary, and with what period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from fringeworks.types import Axis, FloatMap, InputError

MIN_PERIODS = 2.0
"""Fewer fringes than this across the frame are not told from shading."""
MIN_SHARE = 0.2
"""Least share of the frame's contrast that must lie in the carrier's line."""


@dataclass(frozen=True)
class Carrier:
    """The dominant fringe of a frame."""

    axis: Axis
    period_px: float
    """Mean period along the axis, px."""
    share: float
    """Share of the frame's contrast in the carrier's line, 0…1."""


def _without_slope(rows: FloatMap) -> FloatMap:
    """Rows less their least-squares line (``scipy.signal`` takes half a second to import)."""
    n = rows.shape[1]
    t = np.arange(n) - 0.5 * (n - 1)
    centred = rows - rows.mean(axis=1, keepdims=True)
    slope = centred @ t / (t @ t)
    return np.asarray(centred - slope[:, None] * t)


def _line(frame: FloatMap) -> tuple[float, float, float]:
    """Frequency (cycles/px), energy and share of the strongest line along the rows."""
    n = frame.shape[1]
    if n < 8:
        return 0.0, 0.0, 0.0
    # Shading is mostly a slope along the row; what differs between the rows' means counts against
    # the line as well, in the spectrum's units (Parseval).
    window = np.hanning(n)
    spectrum = np.abs(fft.rfft(_without_slope(frame) * window, axis=1, workers=-1)) ** 2
    power = spectrum.mean(axis=0) / n**2
    across = 0.5 * float(frame.mean(axis=1).var() * np.mean(window**2))
    first = max(2, int(np.ceil(MIN_PERIODS)))
    # Beyond half the Nyquist frequency a fringe has fewer than four samples: not measurable.
    inside = power[first : n // 4 + 1]
    if inside.size < 3 or not inside.any():
        return 0.0, 0.0, 0.0
    peak = first + int(np.argmax(inside))
    near = slice(max(first - 1, peak - 2), peak + 3)
    energy = float(power[near].sum())
    # A Hann window's line is three bins wide; its centre of gravity is the sub-bin frequency.
    core = slice(peak - 1, peak + 2)
    frequency = float(np.dot(np.arange(peak - 1, peak + 2), power[core]) / power[core].sum()) / n
    return frequency, energy, energy / (across + float(power.sum()))


def find_carrier(frame: FloatMap, axis: Axis | None = None) -> Carrier:
    """Find the direction and period of the fringes in a frame.

    Parameters
    ----------
    frame : (h, w) float array of finite values, counts.
    axis : "x" where the fringes vary along the columns, "y" along the rows; None to find it.

    Returns
    -------
    Carrier with the period in px (sub-bin, from the windowed row spectrum).

    Raises
    ------
    InputError where the frame is constant or has no dominant fringe with 2 periods or more.
    """
    if float(np.ptp(frame)) == 0.0:
        raise InputError(f"reference frame: expected fringes, got the constant {frame.flat[0]:g}")
    candidates: dict[Axis, tuple[float, float, float]] = {}
    for name in ("x", "y"):
        if axis in (None, name):
            candidates[name] = _line(frame if name == "x" else frame.T)
    # A tilted fringe shows on both axes with equal energy: it is steepest where it is fastest.
    best = max(candidates, key=lambda name: candidates[name][0] * candidates[name][1])
    frequency, _, share = candidates[best]
    if frequency <= 0.0 or share < MIN_SHARE:
        where = f"along {axis}" if axis else "along x or y"
        raise InputError(
            f"reference frame: expected fringes {where} with a period between 4 px and half the "
            f"frame, got no dominant line (strongest holds {share:.0%} of the contrast, "
            f"{MIN_SHARE:.0%} needed)"
        )
    return Carrier(best, 1.0 / frequency, share)
