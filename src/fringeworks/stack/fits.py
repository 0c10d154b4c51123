"""Least-squares fits of sets of phase steps to a sample of pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.plan import SINGULAR_CONDITION
from fringeworks.stack.kernel_settings import PhaseFrames
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
        self._found: dict[tuple[tuple[int, ...], DesignRows], SampleFit] = {}

    def planes(self, phases: PhaseFrames) -> list[NDArray[Any]]:
        """The (1, n) samples of the frames of a set."""
        return [self._points[k] for k in phases.frames]

    def of(self, phases: PhaseFrames) -> SampleFit:
        """The fit of a set with its design."""
        key = (phases.frames, phases.rows)
        if key not in self._found:
            self._found[key] = fit_samples(self.planes(phases), phases.rows)
        return self._found[key]


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
