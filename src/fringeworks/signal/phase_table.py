"""Tables of the phase error over the phase, one for each range of brightness (theory §6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import FloatMap, InputError

TABLE_BINS = 256
"""Entries of a phase table over one turn.

A bin of 1.4° is short against the period of the highest harmonic of ``HARMONICS``, 30°. The
decoding kernel and the response files are made for this number.
"""

HARMONICS = 12
"""Harmonics of the phase that a table keeps.

N steps make errors with N, 2N, 3N … periods a turn, so that twelve keep at least the first three
for three and four steps. Faster changes are mostly noise. An empirical choice.
"""

MIN_BIN_PIXELS = 20
"""Smallest number of pixels in every bin of a table.

The median of 20 pixels scatters by 0.3 standard deviations, and the harmonics average over the
bins. An empirical choice: a larger number refuses small boards.
"""

PIXELS_PER_TABLE = 40_000
"""Smallest number of pixels per table when the pixels are split by brightness.

It leaves 156 pixels per bin on average. More pixels per table make it less noisy but blur its
dependence on brightness. An empirical choice.
"""

MAX_TABLES = 8
"""Largest number of tables, each for a range of brightness.

The decoder interpolates between the tables, and eight resolve the smooth bend of a camera's
response near its limit. An empirical choice.
"""


def phase_table(phase_rad: FloatMap, ideal_rad: FloatMap) -> tuple[NDArray[np.float64], float]:
    """Measure the phase error as a function of the phase.

    Parameters
    ----------
    phase_rad : float array of any shape
        Wrapped phase of N steps on a white plane, rad; NaN where not valid.
    ideal_rad : float array of the same shape
        Phase that was projected, modulo 2π, rad; NaN where unknown.

    Returns
    -------
    table : (256,) float array, rad
        Mean-free error, phase − ideal, at the middles of equal bins from −π on.
    residual : float
        Standard deviation of the error that the table leaves, rad.

    Raises
    ------
    InputError
        If a bin of the phase holds fewer than 20 pixels.

    Notes
    -----
    The medians of the bins are reduced to their first twelve harmonics. Zhang & Huang, Optical
    Engineering 46(6):063601, 2007; theory §6.
    """
    known = np.isfinite(phase_rad) & np.isfinite(ideal_rad)
    phase = phase_rad[known].astype(np.float64)
    error = np.angle(np.exp(1j * (phase - ideal_rad[known])))
    at = np.floor((phase + np.pi) * (TABLE_BINS / (2.0 * np.pi))).astype(np.intp) % TABLE_BINS
    order = np.argsort(at, kind="stable")
    count = np.bincount(at, minlength=TABLE_BINS)
    if count.min() < MIN_BIN_PIXELS:
        raise InputError(
            f"phase table: expected {MIN_BIN_PIXELS} pixels or more at every phase, got "
            f"{count.min()} at one: too few pixels, or no whole fringe in the frames"
        )
    parts = np.split(error[order], np.cumsum(count)[:-1])
    spectrum = np.fft.rfft([float(np.median(part)) for part in parts])
    spectrum[0] = 0.0
    spectrum[HARMONICS + 1 :] = 0.0
    table = np.fft.irfft(spectrum, TABLE_BINS)
    residual = error - _look_up(table, phase)
    return table, float(np.std(residual))


def table_position(phase_rad: FloatMap) -> tuple[NDArray[np.intp], FloatMap]:
    """Position of phases between the entries of a periodic table.

    Parameters
    ----------
    phase_rad : float array of any shape, rad; values that are not finite count as 0.

    Returns
    -------
    below : integer array
        Index of the entry before each phase, −1 … 255; −1 is the last entry.
    share : float array
        Weight of the following entry, 0…1.
    """
    finite = np.where(np.isfinite(phase_rad), phase_rad, 0.0)
    at = (finite + np.pi) * (TABLE_BINS / (2.0 * np.pi)) - 0.5
    below = np.floor(at).astype(np.intp)
    return below, at - below


def _look_up(table: FloatMap, phase_rad: FloatMap) -> FloatMap:
    """Interpolate linearly in a periodic table whose entries are the middles of its bins."""
    below, share = table_position(phase_rad)
    n = table.size
    return np.asarray(table[below % n] * (1.0 - share) + table[(below + 1) % n] * share)


def tables_by_brightness(
    phase_rad: FloatMap, ideal_rad: FloatMap, brightness: FloatMap
) -> tuple[NDArray[np.float64], tuple[float, ...]]:
    """Measure a phase table for each range of brightness that has enough pixels at every phase.

    Parameters
    ----------
    phase_rad, ideal_rad : (h, w) float arrays, rad; as for ``phase_table``
    brightness : (h, w) float array, counts

    Returns
    -------
    tables : (K, 256) float array, rad, K ≤ 8
    brightness : tuple of K floats
        Median brightness of every table's pixels, counts, rising.

    Raises
    ------
    InputError
        If all pixels together have fewer than 20 in a bin of the phase.
    """
    known = np.flatnonzero(np.isfinite(phase_rad) & np.isfinite(ideal_rad))
    order = known[np.argsort(brightness.flat[known], kind="stable")]
    count = int(np.clip(known.size // PIXELS_PER_TABLE, 1, MAX_TABLES))
    phase, ideal = phase_rad.ravel(), ideal_rad.ravel()
    tables, medians = [], []
    for part in np.array_split(order, count):
        try:
            table, _ = phase_table(phase[part], ideal[part])
        except InputError:
            if count == 1:
                raise
            continue  # too few pixels at some phase: the neighbouring tables replace this one
        tables.append(table)
        medians.append(float(np.median(brightness.flat[part])))
    if not tables:
        table, _ = phase_table(phase[order], ideal[order])
        return table[None], (float(np.median(brightness.flat[order])),)
    return np.stack(tables), tuple(medians)
