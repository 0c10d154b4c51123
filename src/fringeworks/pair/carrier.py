"""The carrier: the direction in which the fringes vary, and their period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import Axis, FloatMap, InputError

MIN_PERIODS = 3.0
"""Smallest number of periods across the frame.

Below that, fringes cannot be distinguished from shading, which is as slow. An empirical choice.
"""
PERIODS_SLACK = 0.05
"""Periods by which the refined count may fall short of ``MIN_PERIODS``.

The refined frequency of a frame of exactly three periods can come out slightly low. An empirical
choice.
"""
MIN_PERIOD_PX = 4.0
"""Shortest period that can be measured, px: four samples a period, half the Nyquist frequency."""
MIN_SAMPLES = 8
"""Shortest side along which a spectrum is used, px; a shorter one has too few lines to compare."""
LINE_EXPONENT = 1.5
"""Exponent of the frequency by which spectral lines are weighted before they are compared.

It must be below 2: the power of a square wave's k-th harmonic falls as 1/k², and with 2 it would
equal the carrier's. A high value lifts fringes over shading, whose spectrum falls off fast.
"""
LINE_HALF_WIDTH = 0.3
"""Half-width of the carrier's line in the spectrum, as a share of its frequency.

Perspective and the object spread the line. A wider band counts more noise as fringes. An empirical
choice.
"""
MIN_SHARE = 0.2
"""Smallest share of the frame's contrast that the carrier's line must hold, 0…1.

Noise and ramps stay below it; strongly shaded or noisy fringes above. An empirical choice.
"""
LARGEST_TILT_DEG = 45.0
"""Tilt of the fringes against an axis, degrees, above which the other axis is tried."""
STEEPEST_TILT_DEG = 60.0
"""Largest tilt against an axis that the caller gives, degrees. At 60°, the displacement along the
axis and its σ are twice those across the fringes."""
BLOCK_ROWS = 64
"""Rows whose spectra are in memory at a time: together they are a small part of a frame."""
REFINEMENTS = 3
"""Steps of the sub-bin frequency; each divides its error by more than ten."""


@dataclass(frozen=True)
class Carrier:
    """Direction and period of the dominant fringes of a frame."""

    axis: Axis
    """Axis along which the fringes vary faster."""
    period_px: float
    """Mean period along that axis, > 0, px."""
    share: float
    """Share of the frame's contrast in the carrier's line, 0…1."""
    cross_frequency: float = 0.0
    """Frequency along the other axis, cycles/px; 0 where the fringes are parallel to that axis."""

    @property
    def tilt_deg(self) -> float:
        """Angle between the fringes' normal and ``axis``, −60…60 degrees; beyond ±45 only where the
        caller gives the axis."""
        return float(np.degrees(np.arctan(self.cross_frequency * self.period_px)))


def _without_slope(rows: FloatMap) -> FloatMap:
    """Subtract its least-squares line from each row.

    ``scipy.signal.detrend`` does the same, but importing ``scipy.signal`` takes half a second.
    """
    n = rows.shape[1]
    t = np.arange(n) - 0.5 * (n - 1)
    centred = rows - rows.mean(axis=1, keepdims=True, dtype=np.float64)
    slope = centred @ t / (t @ t)
    for row, rise in zip(centred, slope, strict=True):  # a whole plane would be one more frame
        row -= rise * t
    return np.asarray(centred)


@dataclass(frozen=True)
class _Line:
    """The strongest line of a power spectrum within a band."""

    frequency: float
    """cycles/px"""
    energy: float
    """Sum of the line's power above the noise, counts² up to the window's factor."""
    share: float
    """Energy over that of the spectrum, 0…1."""


NO_LINE = _Line(0.0, 0.0, 0.0)
"""Result for a band without a line."""


def _lines(frame: FloatMap) -> tuple[_Line, _Line]:
    """Strongest line along the rows among the measurable frequencies, and among all."""
    n = frame.shape[1]
    if n < MIN_SAMPLES:
        return NO_LINE, NO_LINE
    window = np.hanning(n)
    power = np.zeros(n // 2 + 1)
    for first in range(0, frame.shape[0], BLOCK_ROWS):
        rows = _without_slope(frame[first : first + BLOCK_ROWS]) * window
        power += np.sum(np.abs(scipy.fft.rfft(rows, axis=1, workers=-1)) ** 2, axis=0)
    power /= frame.shape[0] * n**2
    # Contrast between the rows' means is not in the rows' spectra. It counts against the line, in
    # the units of the windowed spectrum (Parseval).
    between_rows = (
        0.5 * float(np.mean(window**2)) * _fast_variance(frame.mean(axis=1, dtype=np.float64))
    )
    slowest = int(MIN_PERIODS)
    noise = float(np.median(power[slowest:])) if power.size > slowest else 0.0
    # Frequencies below the slowest fringe are shading and do not count against a measurable line.
    fast = between_rows + float(power[slowest - 1 :].sum())
    total = between_rows + float(power.sum())
    return (
        _strongest_line(power, n, (slowest, int(n / MIN_PERIOD_PX)), noise, fast),
        _strongest_line(power, n, (1, power.size - 1), noise, total),
    )


def _strongest_line(
    power: FloatMap, samples: int, band: tuple[int, int], noise: float, total: float
) -> _Line:
    """Strongest line between two bins of the power spectrum of rows of ``samples`` px.

    ``noise`` is the power per bin of the noise, ``total`` the energy that the share refers to.
    """
    first, last = band
    inside = power[first : last + 1]
    if inside.size < 3 or not inside.any():
        return NO_LINE
    bins = np.arange(first, first + inside.size)
    peak = first + int(np.argmax(inside * bins**LINE_EXPONENT))
    reach = max(2, round(LINE_HALF_WIDTH * peak))
    near = power[max(first - 1, peak - reach, 1) : peak + reach + 1]
    energy = float(np.maximum(near - noise, 0.0).sum())
    # The line of a Hann window is three bins wide.
    core = np.arange(max(peak - 1, 0), min(peak + 2, power.size))
    frequency = float(np.dot(core, power[core]) / power[core].sum()) / samples
    return _Line(frequency, energy, energy / total if total > 0 else 0.0)


def _fast_variance(values: FloatMap) -> float:
    """Variance of a profile without the waves slower than the slowest fringe."""
    if values.size < MIN_SAMPLES:
        return float(values.var())
    spectrum = np.abs(scipy.fft.rfft(values - values.mean())) ** 2
    return float(2.0 * spectrum[int(MIN_PERIODS) :].sum()) / values.size**2


def _refine(frame: FloatMap, frequency: float) -> tuple[float, float]:
    """Sub-bin frequency of the carrier along x and along y, cycles/px.

    The frame is demodulated with the present frequency. The remaining phase difference between its
    left and right half, over their distance, is the error of the frequency along x; upper and
    lower half give the error along y.
    """
    h, w = frame.shape
    flat = _without_slope(frame)
    x, y = np.arange(w), np.arange(h)
    cross_frequency = 0.0
    for step in range(REFINEMENTS):
        half = w // 2
        wave = np.exp(-2j * np.pi * frequency * x)
        left = _product(flat[:, :half], np.hanning(half) * wave[:half])
        right = _product(flat[:, w - half :], np.hanning(half) * wave[w - half :])
        rows = left + right
        if h >= MIN_SAMPLES:
            if step == 0:
                cross_frequency = _strongest_frequency(rows)
            demodulated = rows * np.exp(-2j * np.pi * cross_frequency * y)
            middle = h // 2
            upper = demodulated[:middle] @ np.hanning(middle)
            lower = demodulated[h - middle :] @ np.hanning(middle)
            turns = float(np.angle(lower * np.conj(upper))) / (2.0 * np.pi * (h - middle))
            cross_frequency += turns
        frequency += float(np.angle(np.vdot(left, right))) / (2.0 * np.pi * (w - half))
    return frequency, cross_frequency


def _product(rows: FloatMap, wave: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Sum of each row times a complex wave, without a complex copy of the rows."""
    return np.asarray(rows @ wave.real + 1j * (rows @ wave.imag))


def _strongest_frequency(values: NDArray[np.complex128]) -> float:
    """Frequency of the largest line in the spectrum of a complex profile, cycles/px."""
    n = values.size
    spectrum = np.abs(scipy.fft.fft(values * np.hanning(n)))
    return float(scipy.fft.fftfreq(n)[np.argmax(spectrum)])


def find_carrier(frame: FloatMap, axis: Axis | None = None, *, name: str = "reference") -> Carrier:
    """Find the direction and the period of the fringes in a frame.

    Parameters
    ----------
    frame : (h, w) float array
        Finite counts.
    axis : "x", "y" or None
        Axis along which the fringes vary: "x" from column to column, "y" from row to row; None to
        find it.
    name : str
        Name of the frame in messages.

    Returns
    -------
    Carrier

    Raises
    ------
    InputError
        If the frame is constant, has no dominant line in its spectrum, has fewer than 3 periods,
        or has a period below 4 px; if its fringes are tilted by more than 60° against the axis.

    Notes
    -----
    Theory §5, "Carrier": the strongest line of the mean power spectrum of rows or columns, weighted
    by f^1.5, then refined below one bin from the phases of the frame's halves.

    Examples
    --------
    >>> y, x = np.mgrid[:200, :300]
    >>> carrier = find_carrier(np.cos(2 * np.pi * (x / 17.3 + y / 90.0)))
    >>> carrier.axis, round(carrier.period_px, 2), round(1 / carrier.cross_frequency, 1)
    ('x', 17.3, 90.0)
    """
    if frame.ndim != 2 or min(frame.shape) < 1 or max(frame.shape) < MIN_SAMPLES:
        raise InputError(
            f"{name} frame: expected fringes over {MIN_SAMPLES} px or more, got shape {frame.shape}"
        )
    if float(np.ptp(frame)) == 0.0:
        raise InputError(f"{name} frame: expected fringes, got the constant {frame.flat[0]:g}")
    if axis not in (None, "x", "y"):
        raise InputError(f"axis: expected x or y, got {axis!r}")
    lines: dict[Axis, tuple[_Line, _Line]] = {}
    for direction in ("x", "y"):
        if axis in (None, direction):
            lines[direction] = _lines(frame if direction == "x" else frame.T)
    # Tilted fringes have equal energy on both axes; the axis with the higher frequency decides.
    best = max(lines, key=lambda d: lines[d][0].frequency * lines[d][0].energy)
    found = _along(frame, best, lines[best][0])
    if axis is None and found is not None and abs(found.tilt_deg) > LARGEST_TILT_DEG:
        # Near 45° the spectra of an object's fringes may speak for the wrong one.
        other: Axis = "y" if best == "x" else "x"
        found = _along(frame, other, lines[other][0]) or found
    if found is not None and abs(found.tilt_deg) > STEEPEST_TILT_DEG:
        raise InputError(
            f"{name} frame: expected fringes tilted by at most {STEEPEST_TILT_DEG:g}° against "
            f"axis {found.axis}, got {abs(found.tilt_deg):.0f}°; use the other axis"
        )
    if found is None:
        raise InputError(_complaint(name, axis, frame.shape, lines))
    return found


def _along(frame: FloatMap, axis: Axis, line: _Line) -> Carrier | None:
    """The carrier of a line along an axis; None where it is weak or has too few periods."""
    if line.share < MIN_SHARE:
        return None
    turned = frame if axis == "x" else frame.T
    frequency, cross_frequency = _refine(turned, line.frequency)
    if frequency * turned.shape[1] < MIN_PERIODS - PERIODS_SLACK:
        return None
    return Carrier(axis, 1.0 / frequency, line.share, cross_frequency)


def _complaint(
    name: str,
    axis: Axis | None,
    shape: tuple[int, ...],
    lines: dict[Axis, tuple[_Line, _Line]],
) -> str:
    """Message for a frame without a measurable carrier."""
    where = f"along {axis}" if axis else "along x or y"
    expected = (
        f"{name} frame: expected fringes {where} with a period of at least {MIN_PERIOD_PX:g} px "
        f"and at least {MIN_PERIODS:g} periods"
    )
    best = max(lines, key=lambda d: lines[d][1].energy)
    line = lines[best][1]
    size = shape[1] if best == "x" else shape[0]
    if line.share >= MIN_SHARE and line.frequency > 0:
        return (
            f"{expected}, got a period of {1.0 / line.frequency:.1f} px along {best}, "
            f"{line.frequency * size:.1f} periods"
        )
    strongest = max(measurable.share for measurable, _ in lines.values())
    return (
        f"{expected}, got no dominant line (the strongest holds {strongest:.0%} of the contrast, "
        f"{MIN_SHARE:.0%} is required)"
    )
