"""Standard deviation of the windowed inversion: its noise and its bias (theory §4, "Error bar")."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.pair.methods.window_start import Start
from fringeworks.pair.smoothed_away import MEAN_TO_SIGMA, without
from fringeworks.pair.windows import Fitted
from fringeworks.signal.filters import smooth_known, widened
from fringeworks.types import BoolMap, FloatMap

SURFACE_EXPONENT = 7.0
"""Power of the frequency by which the spectrum of surfaces falls along a line.

Creases have 4, steps of the curvature 6, smoother surfaces more. With 6, 90 % of the errors of
waves at 100 counts lie within 1 σ, which is too many; with 8, 93 % of those of creases at 5 counts
lie within 2 σ, which is the least that is promised.
"""
EVEN_PERIODS = (0.25, 0.35)
"""Widths of the Gaussians over which the variance is averaged, periods; the larger mean counts.

Where neighbours keep windows of different widths, their variances differ by a factor of four and
more, but either may keep the other's. At a tip that the camera's blur rounds off, 0.25 leaves
errors beyond 5 σ, and 0.35 none; where channels are clipped, 0.35 leaves more.
"""
SPREAD_PERIODS = 0.3
"""Width of the Gaussian over which the magnitude of a predicted bias is averaged, periods.

It is near that of the kernel which the bias comes of.
"""
MARGIN_WIDTHS = 3.0
"""Width of the border by which the displacement is continued, widths of the start's kernel."""
CUT_OFF = 3.0
"""Largest frequency of the spectra, rad over the smallest width; exp(−9) is left there."""
FREQUENCIES = 400
"""Frequencies at which they are summed."""
SHARES_KEPT = np.linspace(0.0, 1.0, 5)
"""Shares of the start's details at which the responses are computed; those between are
interpolated."""
LEAST_SEEN = 1e-12
"""Lower bound on the energy that a filter sees of a surface, so that the quotient is finite."""


class _Scale(NamedTuple):
    """The pixels that keep the windows of one scale, and responses at ``SHARES_KEPT``."""

    q: NDArray[np.float64]
    """Frequencies, rad/px."""
    lost: NDArray[np.float64]
    """(n, frequencies); share of a surface that is not in the result."""
    windows: NDArray[np.float64]
    """Response of the windows alone: the noise that they state has passed it."""
    noise: FloatMap
    """Variance that the windows state, px²; of each pixel."""
    kept: FloatMap
    """Share of the start's details that were kept, 0…1; of each pixel."""

    def behind(self, response: NDArray[np.float64]) -> FloatMap:
        """Variance of the noise behind a response, px²; of each pixel."""
        ratio = np.sum(self.q * response**2, axis=-1) / np.sum(self.q * self.windows**2)
        return np.asarray(self.noise * np.interp(self.kept, SHARES_KEPT, ratio))

    def bias(self, seen: FloatMap, response: NDArray[np.float64]) -> FloatMap:
        """Mean square of the bias, from that of what is seen behind a response with noise, px²."""
        surface = self.q**-SURFACE_EXPONENT
        found = np.maximum(np.sum(surface * response**2, axis=-1), LEAST_SEEN)
        ratio = np.sum(surface * self.lost**2, axis=-1) / found
        more = np.maximum(seen - self.behind(response), 0.0)
        return np.asarray(more * np.interp(self.kept, SHARES_KEPT, ratio))


def window_sigma(
    start: Start,
    found: Fitted,
    walls: BoolMap | None,
    widths: Sequence[float],
    iterations: int,
    period_px: float,
) -> FloatMap:
    """Standard deviation of the displacement that the windows found, (h, w), px.

    Parameters
    ----------
    start : Start
        What they started from.
    found : Fitted
    walls : (h, w) bool array, optional
        Cliffs that the windows do not cross.
    widths : sequence of float
        Widths σ of the windows, from coarse to fine, px.
    iterations : int
        Gauss–Newton steps per scale.
    period_px : float

    Notes
    -----
    A step of the windows S about a field leaves (1 − S) of its error. From the kernel K of the
    start, the scales 0 … k leave P = (1 − K) Π (1 − S_j) of a surface t, and the result is
    (1 − P)(t + n) with white noise n. The noise that the windows state has passed S_k only; that of
    the result is its integral over 1 − P. The bias is P t. The next finer windows show P S_{k+1} t
    more, and noise of the same response. The mean square of that difference without its noise,
    times the ratio of P² to (P S_{k+1})² over the spectrum of surfaces, is the mean square of the
    bias. Where no finer windows determine the displacement, P u stands for the difference.
    The variance is averaged over ``EVEN_PERIODS``, as the choice between two widths is by chance.
    """
    u, stated = found.displacement_px, found.sigma_px
    known = np.isfinite(u) & np.isfinite(stated)
    q = np.linspace(0.0, CUT_OFF / min(start.fine_px, widths[-1]), FREQUENCIES + 1)[1:]
    fine, wide = (_gaussian(q, width) for width in (start.fine_px, start.wide_px))
    lost = 1.0 - wide - SHARES_KEPT[:, None] * (fine - wide)
    left = [(1.0 - _gaussian(q, width)) ** iterations for width in widths]
    variance = np.full(u.shape, np.nan, np.float32)
    for k in range(len(widths)):
        lost = lost * left[k]
        chosen = known & (found.scale == k)
        if not chosen.any():
            continue
        scale = _Scale(q, lost, 1.0 - left[k], stated[chosen] ** 2, start.kept[chosen])
        seen = found.unlike_finer[chosen]
        finer = 1.0 - left[k + 1] if k + 1 < len(widths) else 0.0 * q
        bias = scale.bias(seen, lost * finer)
        if not seen.all():
            steps = [width for width in widths[: k + 1] for _ in range(iterations)]
            own = _lost_of_result(start, u, known, walls, steps, SPREAD_PERIODS * period_px)
            bias = np.where(seen > 0, bias, scale.bias(own[chosen], lost * (1.0 - lost)))
        variance[chosen] = scale.behind(1.0 - lost) + bias
    spreads = [(share * period_px,) * 2 for share in EVEN_PERIODS]
    narrow, wide_mean = (smooth_known(variance, known, spread) for spread in spreads)
    even: FloatMap = np.maximum(narrow, wide_mean)
    variance = even + found.model_variance
    return np.sqrt(np.where(known, variance, np.nan), dtype=np.float32)


def _lost_of_result(
    start: Start,
    u: FloatMap,
    known: BoolMap,
    walls: BoolMap | None,
    steps: Sequence[float],
    spread_px: float,
) -> FloatMap:
    """Mean square of what start and windows would leave of their own result, (h, w), px²; 0 beside
    walls, where windows start from either side."""
    clear = known if walls is None else known & ~widened(walls, round(2.0 * start.fine_px))
    values = np.where(known, u, start.displacement_px)
    margin = [(min(int(MARGIN_WIDTHS * start.wide_px) + 1, n - 1),) * 2 for n in values.shape]
    padded = np.pad(values, margin, mode="reflect", reflect_type="odd")
    where, kept = np.pad(clear, margin, mode="reflect"), np.pad(start.kept, margin, mode="reflect")
    wide, fine = (without(padded, where, (w, w)) for w in (start.wide_px, start.fine_px))
    left: FloatMap = wide + kept * (fine - wide)
    for width in steps:
        left = without(left, where, (width, width))
    inner = tuple(slice(m[0], -m[0]) for m in margin)
    size = smooth_known(np.abs(left[inner]), clear, (spread_px, spread_px))
    return np.where(clear, (MEAN_TO_SIGMA * size) ** 2, 0.0)


def _gaussian(q: NDArray[np.float64], width_px: float) -> NDArray[np.float64]:
    """Response of a Gaussian."""
    return np.exp(-0.5 * (width_px * q) ** 2)
