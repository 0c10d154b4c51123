"""The carrier: which way the fringes vary, and with what period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from fringeworks.types import Axis, FloatMap, InputError

MIN_PERIODS = 3.0
"""Fewer fringes than this across the frame are not told from shading."""
MIN_PERIOD_PX = 4.0
"""Finer fringes have less than four samples: above half the Nyquist frequency."""
TILT = 1.5
"""Exponent of the frequency by which lines are compared; a square wave's harmonics stay below."""
SPREAD = 0.3
"""Half-width of the carrier's line, share of its frequency."""
MIN_SHARE = 0.2
"""Least share of the frame's contrast that must lie in the carrier's line."""
REFINEMENTS = 3
"""Steps of the sub-bin frequency; each divides its error by more than ten."""


@dataclass(frozen=True)
class Carrier:
    """The dominant fringe of a frame."""

    axis: Axis
    """The axis along which the fringes vary faster."""
    period_px: float
    """Mean period along that axis, px."""
    share: float
    """Share of the frame's contrast in the carrier's line, 0…1."""
    across: float = 0.0
    """Frequency along the other axis, cycles/px; 0 for fringes that run straight along it."""

    @property
    def tilt_deg(self) -> float:
        """Angle between the fringes' direction of change and the axis, −45…45 degrees."""
        return float(np.degrees(np.arctan(self.across * self.period_px)))


def _without_slope(rows: FloatMap) -> FloatMap:
    """Rows less their least-squares line (``scipy.signal`` takes half a second to import)."""
    n = rows.shape[1]
    t = np.arange(n) - 0.5 * (n - 1)
    centred = rows - rows.mean(axis=1, keepdims=True)
    slope = centred @ t / (t @ t)
    return np.asarray(centred - slope[:, None] * t)


@dataclass(frozen=True)
class _Line:
    """The strongest line of the row spectrum within a band."""

    frequency: float  # cycles/px
    energy: float
    share: float


NOTHING = _Line(0.0, 0.0, 0.0)


def _lines(frame: FloatMap) -> tuple[_Line, _Line]:
    """The strongest line along the rows that can be measured, and the strongest of all."""
    n = frame.shape[1]
    if n < 8:
        return NOTHING, NOTHING
    window = np.hanning(n)
    spectrum = np.abs(fft.rfft(_without_slope(frame) * window, axis=1, workers=-1)) ** 2
    power = spectrum.mean(axis=0) / n**2
    # What differs between the rows' means counts against the line as well, in the spectrum's
    # units (Parseval).
    across = 0.5 * float(np.mean(window**2)) * _fast_variance(frame.mean(axis=1))
    slow = int(MIN_PERIODS)
    noise = float(np.median(power[slow:])) if power.size > slow else 0.0

    def strongest(first: int, last: int, total: float) -> _Line:
        inside = power[first : last + 1]
        if inside.size < 3 or not inside.any():
            return NOTHING
        # Shading falls off fast with the frequency, harmonics of a fringe do so too: between the
        # two, the fringe stands out.
        bins = np.arange(first, first + inside.size)
        peak = first + int(np.argmax(inside * bins**TILT))
        # Perspective and the object spread the line; noise lies under all of it.
        reach = max(2, round(SPREAD * peak))
        near = power[max(first - 1, peak - reach, 1) : peak + reach + 1]
        energy = float(np.maximum(near - noise, 0.0).sum())
        # A Hann window's line is three bins wide.
        core = np.arange(max(peak - 1, 0), min(peak + 2, power.size))
        frequency = float(np.dot(core, power[core]) / power[core].sum()) / n
        return _Line(frequency, energy, energy / total if total > 0 else 0.0)

    # Slower than the slowest fringe is shading: it does not count against a line.
    fast = across + float(power[slow - 1 :].sum())
    return (
        strongest(slow, int(n / MIN_PERIOD_PX), fast),
        strongest(1, power.size - 1, across + float(power.sum())),
    )


def _fast_variance(values: FloatMap) -> float:
    """Variance of a profile without its slowest waves."""
    if values.size < 8:
        return float(values.var())
    spectrum = np.abs(fft.rfft(values - values.mean())) ** 2
    return float(2.0 * spectrum[int(MIN_PERIODS) :].sum()) / values.size**2


def _refine(frame: FloatMap, frequency: float) -> tuple[float, float]:
    """Frequency along the rows, and across them, cycles/px: where the fringe's phase stands still.

    The phase of the frame against the present frequency, summed over the left and the right half
    (the upper and the lower), tells by how much it runs.
    """
    h, w = frame.shape
    flat = _without_slope(frame)
    x, y = np.arange(w), np.arange(h)
    across = 0.0
    for step in range(REFINEMENTS):
        half = w // 2
        wave = np.exp(-2j * np.pi * frequency * x)
        left = flat[:, :half] @ (np.hanning(half) * wave[:half])
        right = flat[:, w - half :] @ (np.hanning(half) * wave[w - half :])
        rows = left + right
        if h >= 8:
            if step == 0:
                spectrum = np.abs(fft.fft(rows * np.hanning(h)))
                across = float(fft.fftfreq(h)[np.argmax(spectrum)])
            turned = rows * np.exp(-2j * np.pi * across * y)
            middle = h // 2
            upper = turned[:middle] @ np.hanning(middle)
            lower = turned[h - middle :] @ np.hanning(middle)
            across += float(np.angle(lower * np.conj(upper))) / (2.0 * np.pi * (h - middle))
        frequency += float(np.angle(np.vdot(left, right))) / (2.0 * np.pi * (w - half))
    return frequency, across


def find_carrier(frame: FloatMap, axis: Axis | None = None, *, name: str = "reference") -> Carrier:
    """Find the direction and period of the fringes in a frame.

    Parameters
    ----------
    frame : (h, w) float array of finite values, counts.
    axis : "x" where the fringes vary along the columns, "y" along the rows; None to find it.
    name : str
        What the frame is called in messages.

    Returns
    -------
    Carrier with the period in px and the frequency across, both sub-bin.

    Raises
    ------
    InputError where the frame is constant, has no dominant fringe, fewer than 3 periods, or a
    period below 4 px.

    Examples
    --------
    >>> y, x = np.mgrid[:200, :300]
    >>> carrier = find_carrier(np.cos(2 * np.pi * (x / 17.3 + y / 90.0)))
    >>> carrier.axis, round(carrier.period_px, 2), round(1 / carrier.across, 1)
    ('x', 17.3, 90.0)
    """
    if float(np.ptp(frame)) == 0.0:
        raise InputError(f"{name} frame: expected fringes, got the constant {frame.flat[0]:g}")
    found: dict[Axis, tuple[_Line, _Line]] = {}
    for direction in ("x", "y"):
        if axis in (None, direction):
            found[direction] = _lines(frame if direction == "x" else frame.T)
    # A tilted fringe shows on both axes with equal energy: it is steepest where it is fastest.
    best = max(found, key=lambda d: found[d][0].frequency * found[d][0].energy)
    line = found[best][0]
    if line.share < MIN_SHARE:
        raise InputError(_complaint(name, axis, frame.shape, found))
    turned = frame if best == "x" else frame.T
    frequency, across = _refine(turned, line.frequency)
    if abs(across) > frequency or frequency * turned.shape[1] < MIN_PERIODS - 0.05:
        raise InputError(_complaint(name, axis, frame.shape, found))
    return Carrier(best, 1.0 / frequency, line.share, across)


def _complaint(
    name: str,
    axis: Axis | None,
    shape: tuple[int, ...],
    found: dict[Axis, tuple[_Line, _Line]],
) -> str:
    """What was expected of the carrier, and what came."""
    where = f"along {axis}" if axis else "along x or y"
    expected = (
        f"{name} frame: expected fringes {where} with a period of at least {MIN_PERIOD_PX:g} px "
        f"and at least {MIN_PERIODS:g} periods"
    )
    best = max(found, key=lambda d: found[d][1].energy)
    line = found[best][1]
    size = shape[1] if best == "x" else shape[0]
    if line.share >= MIN_SHARE and line.frequency > 0:
        return (
            f"{expected}, got a period of {1.0 / line.frequency:.1f} px along {best}, "
            f"{line.frequency * size:.1f} periods"
        )
    strongest = max(entry[0].share for entry in found.values())
    return (
        f"{expected}, got no dominant line (strongest holds {strongest:.0%} of the contrast, "
        f"{MIN_SHARE:.0%} needed)"
    )
