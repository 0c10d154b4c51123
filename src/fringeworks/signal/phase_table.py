"""Phase errors as tables over the phase, one for each level of brightness."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import FloatMap, InputError

BINS = 256
"""Entries of a phase table."""
HARMONICS = 12
"""Harmonics of φ that a table holds; faster changes are noise."""
MIN_PER_BIN = 20
"""Pixels that every entry of a table needs."""
PIXELS_PER_LEVEL = 40_000
"""Pixels behind each level of brightness; fewer make fewer levels."""
MAX_LEVELS = 8
"""Levels of brightness that a table is split into."""


def phase_table(phase_rad: FloatMap, ideal_rad: FloatMap) -> tuple[NDArray[np.float64], float]:
    """Phase error as a function of the phase: Zhang & Huang's look-up table.

    Parameters
    ----------
    phase_rad : (h, w) float array
        Wrapped phase of N steps on a white plane; NaN where not valid.
    ideal_rad : (h, w) float array
        What it should be, modulo 2π; NaN where unknown.

    Returns
    -------
    table : (256,) float array, rad
        φ − ideal at the middles of equal bins from −π on, less its mean.
    residual : float
        Root mean square of what the table leaves, rad.

    Raises
    ------
    InputError where a bin of the phase holds fewer than 20 pixels.

    Notes
    -----
    Zhang & Huang, Optical Engineering 46(6):063601, 2007; theory §6. Medians per bin, then the
    first twelve harmonics.
    """
    known = np.isfinite(phase_rad) & np.isfinite(ideal_rad)
    phase = phase_rad[known].astype(np.float64)
    error = np.angle(np.exp(1j * (phase - ideal_rad[known])))
    at = np.floor((phase + np.pi) * (BINS / (2.0 * np.pi))).astype(np.intp) % BINS
    order = np.argsort(at, kind="stable")
    count = np.bincount(at, minlength=BINS)
    if count.min() < MIN_PER_BIN:
        raise InputError(
            f"phase table: expected {MIN_PER_BIN} pixels or more at every phase, got "
            f"{count.min()}: the frames must hold whole fringes"
        )
    parts = np.split(error[order], np.cumsum(count)[:-1])
    spectrum = np.fft.rfft([float(np.median(part)) for part in parts])
    spectrum[0] = 0.0
    spectrum[HARMONICS + 1 :] = 0.0
    table = np.fft.irfft(spectrum, BINS)
    left = error - _look_up(table, phase)
    return table, float(np.std(left))


def places(phase_rad: FloatMap) -> tuple[NDArray[np.intp], FloatMap]:
    """Entry of a periodic table to the left of each phase, and the share of the next one."""
    finite = np.where(np.isfinite(phase_rad), phase_rad, 0.0)
    at = (finite + np.pi) * (BINS / (2.0 * np.pi)) - 0.5
    left = np.floor(at).astype(np.intp)
    return left, at - left


def _look_up(table: FloatMap, phase_rad: FloatMap) -> FloatMap:
    """Linear interpolation in a periodic table whose entries are the middles of its bins."""
    left, share = places(phase_rad)
    n = table.size
    return np.asarray(table[left % n] * (1.0 - share) + table[(left + 1) % n] * share)


def tables_by_brightness(
    phase_rad: FloatMap, ideal_rad: FloatMap, brightness: FloatMap
) -> tuple[NDArray[np.float64], tuple[float, ...]]:
    """A table for each level of brightness that has pixels enough at every phase."""
    known = np.flatnonzero(np.isfinite(phase_rad) & np.isfinite(ideal_rad))
    order = known[np.argsort(brightness.flat[known], kind="stable")]
    count = int(np.clip(known.size // PIXELS_PER_LEVEL, 1, MAX_LEVELS))
    phase, ideal = phase_rad.ravel(), ideal_rad.ravel()
    tables, levels = [], []
    for part in np.array_split(order, count):
        try:
            table, _ = phase_table(phase[part], ideal[part])
        except InputError:
            if count == 1:
                raise
            continue  # too few phases at this brightness: its neighbours stand in
        tables.append(table)
        levels.append(float(np.median(brightness.flat[part])))
    if not tables:
        table, _ = phase_table(phase[order], ideal[order])
        return table[None], (float(np.median(brightness.flat[order])),)
    return np.stack(tables), tuple(levels)
