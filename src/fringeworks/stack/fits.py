"""Least-squares fits of sets of phase steps to a sample of pixels."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fringeworks.patterns.plan import SINGULAR_CONDITION
from fringeworks.types import FloatMap, InputError

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
    return design, np.linalg.pinv(design) if determined else None


def times(matrix: FloatMap, values: FloatMap) -> FloatMap:
    """Return matrix @ values without BLAS, whose idle threads would slow the kernel down."""
    return np.asarray(np.einsum("ij,jn->in", matrix, values))


def solve(values: FloatMap, rows: DesignRows) -> tuple[FloatMap, FloatMap]:
    """Fit one set of steps at every pixel.

    Parameters
    ----------
    values : (N, n) float array, counts
    rows : (N, 3) floats
        What every frame shows of A, c and s.

    Returns
    -------
    fitted : (3, n) array of A, c and s, counts
    square : (n,) array of the sums of squared residuals, counts²
    """
    design, solver = fit_matrices(rows)
    if solver is None:
        degrees = ", ".join(f"{np.degrees(np.arctan2(q, k)):g}" for _, k, q in rows)
        raise InputError(f"shifts: expected at least three that differ modulo 360°, got {degrees}°")
    fitted = times(solver, values)
    residual = values - times(design, fitted)
    return fitted, np.einsum("ns,ns->s", residual, residual)
