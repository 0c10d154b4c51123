"""Readable twin of the kernel's empirical mode decomposition, with SciPy's splines."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline


def extrema(row):
    """Positions of maxima and of minima; a plateau counts once, in its middle."""
    found = {1: [], -1: []}
    steps = [(i, np.sign(d)) for i, d in enumerate(np.diff(row)) if d != 0]
    for (i, before), (j, after) in pairwise(steps):
        if before != after:
            found[int(before)].append(0.5 * (i + 1 + j))
    return found[1], found[-1]


def knots(row, positions, side):
    """Knots of an envelope: the extrema, and two mirrored ones beyond each end.

    The end itself is a knot if it lies beyond the envelope. ``side`` is 1 for maxima, −1 for minima.
    """
    end = row.size - 1
    x = list(positions)
    y = [row[int(p)] for p in positions]
    if not x or side * (row[0] - y[0]) > 0:
        x, y = [0.0, *x], [row[0], *y]
    if side * (row[-1] - y[-1]) > 0:
        x, y = [*x, float(end)], [*y, row[-1]]
    begin, skip = int(x[0] == 0), int(x[-1] == end)
    front = [(-x[k], y[k]) for k in range(begin, min(begin + 2, len(x)))]
    inner = len(x) - skip
    back = [(2 * end - x[k], y[k]) for k in range(inner - 1, max(inner - 3, -1), -1)]
    pairs = [*reversed(front), *zip(x, y, strict=True), *back]
    return np.array(pairs).T


def envelope(row, positions, side):
    """Natural cubic spline through the extrema."""
    x, y = knots(row, positions, side)
    t = np.arange(row.size)
    return CubicSpline(x, y, bc_type="natural")(t) if x.size > 1 else np.full(row.size, y[0])


def emd(row, flat, max_sifts=100):
    """IMFs and residue of one row, with criterion II ``flat``."""
    residue, imfs = row.astype(float), []
    while True:
        maxima, minima = extrema(residue)
        if len(maxima) + len(minima) <= 2 or np.ptp(residue) <= 1e-13 * np.abs(row).max():
            return imfs, residue
        mode = residue.copy()
        for _ in range(max_sifts):
            mean = 0.5 * (envelope(mode, maxima, 1) + envelope(mode, minima, -1))
            a, b = mode[:-1], mode[1:]
            crossings = np.sum(((a > 0) & (b <= 0)) | ((a < 0) & (b >= 0)))
            even = abs(len(maxima) + len(minima) - crossings) <= 1
            if even and np.sum(mean**2) <= flat**2 * np.sum(mode**2):
                break
            mode = mode - mean
            maxima, minima = extrema(mode)
            if len(maxima) + len(minima) <= 2:
                break
        residue = residue - mode
        imfs.append(mode)
