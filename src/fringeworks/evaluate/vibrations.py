"""How areas of a scene move along a sequence: their displacement, drift and vibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from fringeworks.evaluate.area_points import MIN_POINTS
from fringeworks.types import (
    LARGEST,
    Area,
    BoolMap,
    FloatMap,
    Frozen,
    InputError,
    PointCloud,
    Reason,
    finite,
)

FLOOR_BINS = 51
"""Neighbouring frequencies whose median amplitude is the floor: a peak spreads over four."""
LOWEST_BIN = 3
"""Lowest frequency of a vibration, in those of one period over the whole sequence."""
MEDIAN_TO_RMS = 0.8326
"""Median over rms of the amplitude of noise, √ln 2 for Rayleigh's distribution."""
PEAK_FLOORS = 4.0
"""Amplitude of a vibration over the rms of the floor, at least. About one in 100 spectra of noise
alone exceeds it, because the floor is an estimate too."""
FEWEST_BINS = 12
"""Frequencies that a floor can be told from, at least."""
MOST_SINES = 5
"""Vibrations that are fitted beside the drift, the largest ones: a sine of few periods
biases the slope."""
FEWEST_MOMENTS = 16
"""Moments that a spectrum needs."""


@dataclass(frozen=True, eq=False, repr=False)
class Displacement(Frozen):
    """How an area has moved since the first moment, along its normal and towards the camera."""

    layout = {  # noqa: RUF012
        "time_s": "fiu n",
        "distance_mm": "fiu n",
        "sigma_mm": "fiu n",
    }

    time_s: FloatMap
    """(n,), s; frames where no rate is known."""
    distance_mm: FloatMap
    """(n,), mm; NaN where too little was measured."""
    sigma_mm: FloatMap
    """Standard deviation by noise, (n,), mm."""
    frames_shared: float = 1.0
    """Moments per cycle of the plan: so many neighbours share frames."""


@dataclass(frozen=True, eq=False, repr=False)
class Vibration(Frozen):
    """The spectrum of a displacement, and what stands out of it."""

    frequency_hz: FloatMap
    """(m,), Hz; per frame where no rate is known."""
    amplitude_mm: FloatMap
    """Amplitude of a sine of each frequency, (m,), mm."""
    floor_mm: FloatMap
    """Rms amplitude of what surrounds each frequency, (m,), mm."""
    peaks: tuple[tuple[float, float], ...]
    """Frequency (Hz) and amplitude (mm) of each vibration, the largest first."""
    drift_mm_per_s: float
    """Slope of the displacement, mm/s; mm per frame where no rate is known."""
    drift_sigma: float
    """Its standard deviation, in the same unit."""


class AreaTracker:
    """Follow areas of a scene along a sequence.

    Parameters
    ----------
    areas : Area by name
        Of the camera's image: they stay where they are.
    """

    def __init__(self, areas: Mapping[str, Area]) -> None:
        self._areas = dict(areas)
        self._reference: dict[str, tuple[BoolMap, FloatMap, FloatMap]] = {}
        self._rows: dict[str, list[tuple[float, float]]] = {name: [] for name in areas}
        self._times: list[float] = []

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the areas."""
        return tuple(self._areas)

    def add(self, time: float, points: PointCloud) -> dict[str, tuple[float, float]]:
        """Add a moment; return displacement and standard deviation of each area, mm.

        Parameters
        ----------
        time : float
            Frames from the first one; ``displacement`` turns it into seconds.
        points : PointCloud

        Raises
        ------
        InputError for an area outside of the image.

        Notes
        -----
        Every pixel counts with its own distance from the first moment in which the area was
        measured, along the normal of the area then, so that pixels that come and go change nothing.
        """
        self._times.append(time)
        for name, area in self._areas.items():
            self._rows[name].append(self._displacement(name, area, points))
        return {name: rows[-1] for name, rows in self._rows.items()}

    def _displacement(self, name: str, area: Area, points: PointCloud) -> tuple[float, float]:
        wanted = area.pixels(points.shape)
        measured = wanted & (points.reason == Reason.OK)
        if name not in self._reference:
            if np.count_nonzero(measured) < MIN_POINTS:
                return np.nan, np.nan
            here = points.xyz_mm[measured].astype(np.float64)
            normal = np.linalg.svd(here - here.mean(axis=0), full_matrices=False)[2][2]
            # Towards the camera, which is at the origin.
            normal = -np.sign(normal @ here.mean(axis=0)) * normal
            self._reference[name] = wanted, points.xyz_mm[wanted].astype(np.float64), normal
        inside, before, normal = self._reference[name]
        moved = (points.xyz_mm[inside] - before) @ normal
        known = np.isfinite(moved)
        if np.count_nonzero(known) < MIN_POINTS:
            return np.nan, np.nan
        noise = points.noise_mm[inside][known].astype(np.float64)
        return float(moved[known].mean()), float(np.sqrt(np.sum(noise**2)) / known.sum())

    def displacement(
        self, name: str, *, rate_hz: float = 1.0, frames_shared: float = 1.0
    ) -> Displacement:
        """Return the displacement of an area.

        Parameters
        ----------
        name : str
        rate_hz : float > 0
            Frames per second.
        frames_shared : float ≥ 1
            Frames of the plan over frames between moments.
        """
        rows = np.array(self._rows[name], float).reshape(-1, 2)
        time = np.array(self._times) / rate_hz
        return Displacement(time, rows[:, 0], rows[:, 1], max(frames_shared, 1.0))


def vibration(moved: Displacement) -> Vibration:
    """Find drift and vibrations of a displacement.

    Parameters
    ----------
    moved : Displacement
        At equal distances in time; gaps are filled by straight lines.

    Returns
    -------
    Vibration

    Raises
    ------
    InputError for fewer than 16 moments, or more gaps than moments.

    Notes
    -----
    What a straight line leaves is weighted by a Hann window, and its
    amplitudes are those of sines (``scipy.signal.periodogram``). A vibration is a peak of four
    times the floor, which is the median of the neighbouring frequencies; its frequency and height
    are those of a parabola through three lines. The spectrum ends where a period has two cycles of
    the plan. A moment is a mean over its frames: vibrations whose period is less than four cycles
    appear too small. The drift is fitted together with the largest vibrations.
    """
    known = np.isfinite(moved.distance_mm)
    if not finite(*moved.time_s) or not (np.diff(moved.time_s) > 0).all():
        raise InputError("vibration: expected rising times, got others")
    steps = np.diff(moved.time_s)
    if not (np.abs(moved.distance_mm[known]) <= LARGEST).all():
        raise InputError(f"vibration: expected distances up to {LARGEST:g} mm, got more")
    if not (finite(moved.frames_shared) and moved.frames_shared > 0):
        raise InputError(f"frames_shared: expected > 0, got {moved.frames_shared}")
    if known.sum() < FEWEST_MOMENTS or 2 * known.sum() < known.size:
        raise InputError(
            f"vibration: expected {FEWEST_MOMENTS} moments or more, half of them measured or more, "
            f"got {int(known.sum())} of {known.size}"
        )
    time = moved.time_s - moved.time_s.mean()
    values = np.interp(moved.time_s, moved.time_s[known], moved.distance_mm[known])
    line = np.polyfit(time, values, 1)
    rate = 1.0 / float(np.median(steps))
    frequency, power = scipy.signal.periodogram(
        values - np.polyval(line, time), rate, window="hann", scaling="spectrum"
    )
    # Faster than half a cycle's rate, moments that share frames show noise as a tone of its own.
    count = int(np.searchsorted(frequency, 0.5 * rate / moved.frames_shared, side="right"))
    if count < LOWEST_BIN:
        raise InputError(
            f"vibration: expected cycles of fewer moments, got {moved.frames_shared} a cycle"
        )
    frequency, amplitude = frequency[:count], np.sqrt(2.0 * power[:count])
    # The lowest frequencies lose power with the line, and the window spreads that.
    low = min(LOWEST_BIN, count - 1)
    floor = scipy.ndimage.median_filter(amplitude[low:], FLOOR_BINS, mode="mirror") / MEDIAN_TO_RMS
    floor = np.concatenate((np.full(low, floor[0]), floor))
    high = scipy.signal.find_peaks(amplitude, height=PEAK_FLOORS * floor)[0]
    high = high[high >= low] if count - low >= FEWEST_BINS else high[:0]
    peaks = sorted((_peak(frequency, amplitude, k) for k in high), key=lambda peak: -peak[1])
    slope, sigma = _drift(time, values, peaks, moved.frames_shared)
    return Vibration(frequency, amplitude, floor, tuple(peaks), slope, sigma)


def _peak(frequency: FloatMap, amplitude: FloatMap, k: int) -> tuple[float, float]:
    """Frequency and amplitude of a sine between the lines of a spectrum, by the parabola through
    the logarithms of three."""
    before, here, after = np.log(amplitude[k - 1 : k + 2])
    off = 0.5 * (before - after) / (before - 2.0 * here + after)
    height = here - 0.25 * (before - after) * off
    return float(frequency[k] + off * (frequency[1] - frequency[0])), float(np.exp(height))


def _drift(
    time: FloatMap, values: FloatMap, peaks: list[tuple[float, float]], shared: float
) -> tuple[float, float]:
    """Slope of a straight line beside the largest vibrations, and its standard deviation."""
    columns = [time, np.ones_like(time)]
    for frequency, _ in peaks[:MOST_SINES]:
        phase = 2.0 * np.pi * frequency * time
        columns += [np.cos(phase), np.sin(phase)]
    design = np.stack(columns, axis=-1)
    inverse = np.linalg.pinv(design)
    fitted = inverse @ values
    # Moments that share frames are not independent.
    freedom = max(time.size / shared - len(columns), 1.0)
    variance = float(np.sum((values - design @ fitted) ** 2)) / freedom
    return float(fitted[0]), float(np.sqrt(variance * (inverse @ inverse.T)[0, 0]))
