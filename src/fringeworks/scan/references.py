"""Known pictures among those of a fast scan: they prove which picture a frame shows."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.scan.delay import SHARE_SIGMAS, VISIBLE_SHARE
from fringeworks.scan.differences import compared
from fringeworks.statistics.quantiles import NORMAL_MEDIAN

ROW_BANDS = 8
"""Bands of rows that are judged by themselves, because a rolling shutter exposes rows at different
times, and liquid crystals change from the top to the bottom."""
PROOF_LEVELS = (0.0, 1.0, 0.0, 0.0, 1.0)
"""Known pictures before a scan: black after white, black after black, and white after black. Frames
that are late by a part of a picture's time, or by one or more pictures, differ from this order."""

CLEAR = 6.0
"""Smallest difference of two pictures at a pixel that is compared, over the noise of a difference:
the noise of ``wanted``, which is in both sides, then changes a share by 1.4 %."""
TOLD_APART = 40.0
"""Smallest mean square by which the change between two pictures differs from a multiple of the
first one, over what noise makes of it, with which a share is told from a gain. Noise then adds 1/80
to a share at most, a quarter of ``VISIBLE_SHARE``."""
FEWEST = 30
"""Smallest number of such pixels of a band that is judged."""


class Trace(NamedTuple):
    """What a band of rows shows beside the picture that it should show."""

    share: float
    """Share of the picture before; 0 for none."""
    rows: tuple[int, int]
    """First row, and the one after the last."""
    height: int
    """Rows of the frame."""

    def __str__(self) -> str:
        return (
            f"{self.share:.0%} of the light of the picture before in rows {self.rows[0]} to "
            f"{self.rows[1] - 1} of {self.height}"
        )


def trace_of(
    frame: NDArray[Any], wanted: NDArray[Any], before: NDArray[Any], *, gain: bool = True
) -> Trace | None:
    """Find what a frame shows of the picture before it.

    Parameters
    ----------
    frame : (h, w) array of counts
    wanted : (h, w) array of counts
        An earlier frame of the picture that the frame should show.
    before : (h, w) array of counts
        A frame of the picture that was shown before.
    gain : bool
        Whether the light may have changed by a factor since then. It must not where both pictures
        are uniform, because a factor then looks like a share.

    Returns
    -------
    The largest trace in a band of rows; None where all are below ``VISIBLE_SHARE`` or noise.

    Notes
    -----
    Where the light of the room makes both pictures proportional to each other, as under white and
    black, a share and a gain look alike; the gain is then taken to be 1.

    Least squares of ``frame`` = g ``wanted`` + c (``before`` − ``wanted``) in each band, over the
    pixels at which the pictures differ by far more than noise. Where they do not, as beside a body
    in the dark, the noise of ``wanted`` alone would look like a share of one half.
    """
    one, known, old = (compared(pixels).astype(np.float64) for pixels in (frame, wanted, before))
    stride = -(-frame.shape[0] // one.shape[0])
    edges = np.linspace(0, one.shape[0], min(ROW_BANDS, one.shape[0]) + 1).astype(int)
    found: Trace | None = None
    off = np.diff(one - known, axis=1)
    noise = np.median(np.abs(off)) / NORMAL_MEDIAN / 2.0**0.5
    clear = np.abs(old - known) > CLEAR * noise
    for first, last in pairwise(edges.tolist()):
        used = clear[first:last]
        if np.count_nonzero(used) < FEWEST:
            continue
        T, change = known[first:last][used], (old - known)[first:last][used]
        share, sigma = _share_of(one[first:last][used], T, change, gain=gain)
        if abs(share) < max(VISIBLE_SHARE, SHARE_SIGMAS * sigma):
            continue
        if found is None or abs(share) > abs(found.share):
            rows = first * stride, min(last * stride, frame.shape[0])
            found = Trace(share, rows, frame.shape[0])
    return found


def _share_of(
    values: NDArray[np.float64],
    T: NDArray[np.float64],
    change: NDArray[np.float64],
    *,
    gain: bool,
) -> tuple[float, float]:
    """The share of ``change`` in ``values`` beside ``T``, and its standard deviation.

    With b, the slope of ``change`` on ``T``, and S, the sum of squares of what is left of
    ``change``: noise σ in each of the n samples of both pictures makes n (1 + (1 + b)²) σ² of S,
    and adds n (1 + b) σ² / S to the share, because that of ``T`` is in ``change`` as well.
    """
    if gain and T.any():
        slope = float(change @ T) / float(T @ T)
        left = change - slope * T
        design = np.column_stack((change, T))
        share, sigma, variance = _share(design, values)
        # Residuals have the noise of two frames.
        noise = 0.5 * variance * T.size * (1.0 + (1.0 + slope) ** 2)
        if float(left @ left) > TOLD_APART * noise:
            return share, sigma
    return _share(change[:, None], values - T)[:2]


def _share(design: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float, float]:
    """The first coefficient of least squares, its standard deviation by the residuals, and the
    variance of these."""
    normal = design.T @ design
    if np.linalg.cond(normal) > 1.0 / np.finfo(np.float64).eps:
        return 0.0, np.inf, np.inf  # a band without light or without a change
    inverse = np.linalg.inv(normal)
    found = inverse @ (design.T @ values)
    rest = values - design @ found
    variance = float(rest @ rest) / max(values.size - found.size, 1)
    return float(found[0]), float(np.sqrt(variance * inverse[0, 0])), variance


def proof_trace(frames: Sequence[NDArray[Any]]) -> Trace | None:
    """Find a trace in frames of ``PROOF_LEVELS``; None where each shows its picture alone.

    Frames of one level must not differ by a share of the other, and white must be brighter.
    """
    black, white = np.mean(compared(frames[3])), np.mean(compared(frames[4]))
    if not white > black:
        return Trace(1.0, (0, frames[0].shape[0]), frames[0].shape[0])
    compared_with = ((2, 3, 1), (0, 3, 1), (1, 4, 3))
    found = [trace_of(frames[k], frames[j], frames[b], gain=False) for k, j, b in compared_with]
    seen = [trace for trace in found if trace is not None]
    return max(seen, key=lambda trace: abs(trace.share), default=None)
