"""Least-squares fits of sets of phase steps to a sample of pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.plan import SINGULAR_CONDITION
from fringeworks.stack.kernel_settings import HARMONICS, PhaseFrames
from fringeworks.types import BoolMap, FloatMap, InputError

DesignRows = tuple[tuple[float, float, float], ...]
"""What every frame of a set shows of A, c and s."""


@lru_cache(maxsize=1024)
def fit_matrices(
    rows: DesignRows, kept: tuple[bool, ...] | None = None
) -> tuple[FloatMap, FloatMap | None]:
    """Design matrix of a set and its pseudo-inverse.

    Parameters
    ----------
    rows : (N, 3) floats
        What every frame shows of A, c and s; as planned, 1, cos δ and sin δ.
    kept : (N,) bools, optional
        Frames that take part; all where not given.

    Returns
    -------
    design : (M, 3) array of the frames that take part
    solver : (3, M) array, or None where these frames do not determine A, c and s
    """
    design = np.array(rows)
    if kept is not None:
        design = design[list(kept)]
    determined = len(design) >= 3 and np.linalg.cond(design) < SINGULAR_CONDITION
    return design, np.ascontiguousarray(np.linalg.pinv(design)) if determined else None


def times(matrix: FloatMap, values: FloatMap) -> FloatMap:
    """Return matrix @ values without BLAS, whose idle threads would slow the kernel down."""
    return np.asarray(np.einsum("ij,jn->in", matrix, values))


def wave_of(
    phases: PhaseFrames, planes: Sequence[NDArray[Any]]
) -> tuple[FloatMap, NDArray[np.complex128]]:
    """Background and complex modulation of a set's frames, both of the shape of a frame; NaN where
    a sample is not finite."""
    data = np.stack([plane.astype(np.float64) for plane in planes])
    data = np.where(np.isfinite(data), data, np.nan)
    solver: Any = fit_matrices(phases.rows)[1]
    a, c, s = times(solver, data.reshape(len(data), -1)).reshape(3, *data.shape[1:])
    return a, c + 1j * s


def gram(rows: FloatMap) -> FloatMap:
    """Return rows @ rows.T without BLAS, for few long rows."""
    return _core.gram(np.ascontiguousarray(rows))


def samples_at(planes: list[NDArray[Any]], pixels: NDArray[np.intp]) -> FloatMap:
    """The samples of some pixels: (frames, n) float array, counts."""
    return np.stack([plane[0, pixels].astype(np.float64) for plane in planes])


def harmonic_parts(fitted: FloatMap) -> FloatMap:
    """Harmonics of fringes of modulation B and phase φ: B cos kφ and B sin kφ, counts.

    Parameters
    ----------
    fitted : (3, …) array of A, c and s, counts

    Returns
    -------
    (2K, …) array, for the orders ``HARMONICS`` one after another
    """
    return parts_of_orders(fitted[1] + 1j * fitted[2], HARMONICS)


def parts_of_orders(wave: NDArray[Any], orders: Sequence[int]) -> FloatMap:
    """B cos kφ and B sin kφ of a wave B e^{iφ}, (2K, …), for rising orders k one after another."""
    modulation = np.abs(wave)
    # Division of complex numbers that are NaN, as of pixels that a moved frame lacks, warns.
    with np.errstate(invalid="ignore"):
        phasor = wave / np.maximum(modulation, np.finfo(modulation.dtype).tiny)
    power, parts = wave, []
    for earlier, order in pairwise((1, *orders)):
        for _ in range(order - earlier):
            power = power * phasor
        parts += [power.real, power.imag]
    return np.stack(parts)


@dataclass(frozen=True)
class SampleFit:
    """Fit of a set of steps at every pixel of a sample, and what its samples are like."""

    rows: FloatMap
    """(8, n): A, c, s, the sum of squared residuals, and the mean, variance, largest and smallest
    value of the samples; counts and counts²."""

    @property
    def fitted(self) -> FloatMap:
        """(3, n) array of A, c and s, counts."""
        return self.rows[:3]

    @property
    def square(self) -> FloatMap:
        """(n,) array: sums of squared residuals, counts²; NaN where a sample is not finite."""
        return np.asarray(self.rows[3])

    @property
    def mean(self) -> FloatMap:
        """(n,) array of the means of the samples, counts."""
        return np.asarray(self.rows[4])

    @property
    def variance(self) -> FloatMap:
        """(n,) array of the variances of the samples, counts²."""
        return np.asarray(self.rows[5])

    @property
    def largest(self) -> FloatMap:
        """(n,) array of the largest samples, counts."""
        return np.asarray(self.rows[6])

    @property
    def smallest(self) -> FloatMap:
        """(n,) array of the smallest samples, counts."""
        return np.asarray(self.rows[7])

    @property
    def power(self) -> FloatMap:
        """(n,) array of the squared modulations, counts²."""
        return np.asarray(self.rows[1] ** 2 + self.rows[2] ** 2)

    @property
    def finite(self) -> BoolMap:
        """(n,) array; marks pixels whose samples are all finite."""
        return np.asarray(np.isfinite(self.rows[3]))

    def at(self, pixels: NDArray[np.intp]) -> SampleFit:
        """The fit at some of the pixels, each of them named once."""
        return self if pixels.size == self.rows.shape[1] else SampleFit(self.rows[:, pixels])


class SampleFits:
    """Fits of the sets of a plan to a sample; each is computed once."""

    def __init__(self, points: Sequence[NDArray[Any]]) -> None:
        self._points = points
        self._found: dict[tuple[Any, ...], SampleFit] = {}

    def planes(self, phases: PhaseFrames) -> list[NDArray[Any]]:
        """The (1, n) samples of the frames of a set."""
        return [self._points[k] for k in phases.frames]

    def of(self, phases: PhaseFrames) -> SampleFit:
        """The fit of a set with its design; its residuals are without the set's harmonics."""
        key = (phases.frames, phases.rows, phases.harmonics)
        if key not in self._found:
            planes = self.planes(phases)
            fit = fit_samples(planes, phases.rows)
            if phases.harmonics:
                fit = _without_harmonics(planes, phases, fit)
            self._found[key] = fit
        return self._found[key]


def _without_harmonics(
    planes: list[NDArray[Any]], phases: PhaseFrames, fit: SampleFit
) -> SampleFit:
    """The fit with residuals that do not contain the harmonics of the set."""
    design, _ = fit_matrices(phases.rows)
    values = np.concatenate(planes).astype(np.float64)
    explained = times(
        np.concatenate((design, np.array(phases.harmonics)), axis=1),
        np.concatenate((fit.fitted, harmonic_parts(fit.fitted))),
    )
    rows = fit.rows.copy()
    rows[3] = np.sum((values - explained) ** 2, axis=0) / harmonic_noise(phases.harmonics)
    return SampleFit(rows)


def harmonic_noise(shares: tuple[tuple[float, ...], ...]) -> float:
    """Variance of residuals without harmonics, over that of the noise.

    The harmonics are computed from a fit that is noisy itself, with a variance of 2/N in B and Bφ.
    Shares h of order k move the residuals by h cos kφ and k h sin kφ of these errors, averaged over
    all phases.
    """
    steps = len(shares)
    power = np.sum(np.array(shares) ** 2, axis=0).reshape(len(HARMONICS), 2).sum(axis=1)
    moved = sum((1.0 + k**2) * p for k, p in zip(HARMONICS, power, strict=True)) / steps
    return 1.0 + float(moved) / (steps - 3)


def fit_samples(planes: list[NDArray[Any]], rows: DesignRows) -> SampleFit:
    """Fit one set of steps at every pixel.

    Parameters
    ----------
    planes : (1, n) arrays of a type that kernels read, counts
    rows : (N, 3) floats
        What every frame shows of A, c and s.

    Raises
    ------
    InputError
        If the frames do not determine A, c and s.
    """
    design, solver = fit_matrices(rows)
    if solver is None:
        degrees = ", ".join(f"{np.degrees(np.arctan2(q, k)):g}" for _, k, q in rows)
        raise InputError(f"shifts: expected at least three that differ modulo 360°, got {degrees}°")
    return SampleFit(_core.fit_samples(planes, design, solver))
