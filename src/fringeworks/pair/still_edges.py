"""Edges of paint and rims of holes that both frames show at the same pixels (theory §4, "Paint").

A print or a hole stays where it is when the fringes move. The reference at the matching point x − u
then shows other paint than the object at x wherever such an edge lies between the two, and a window
that uses these pixels takes the edge for a displacement of 0.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.reference_phase import phase_nodes, polynomial_phase
from fringeworks.signal.filters import smooth, widened
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import BoolMap, FloatMap

PHASES = 32
"""Parts of a period in which the waveform is read: a sinusoid changes by 10 % of its amplitude
within half of one, which interpolation follows to 0.5 %."""
BLUR_PX = 2
"""Distance over which a lens spreads an edge, px: a blur of 1 px leaves 2 % of it there."""
NOISE_SIGMAS = 6.0
"""Change of the paint across an edge, in standard deviations of its noise: by chance, one of ten
million pixels of a frame has more."""
MIN_STEP = 0.1
"""Smallest change of the paint that is an edge, as a share of the brightness. Less moves a window
of half a period by less than a hundredth of a period."""
GOES_ON_PERIODS = 0.5
"""Distance from certain edges up to which others are edges, too, periods: half of a fringe, whose
other half shows them."""
ALONG_PERIODS = 4.0
"""Length over which a median along the fringes is taken, periods: holes of up to two periods cover
less than a half."""
SAMPLES_PER_PERIOD = 4.0
"""Samples per period of that median."""
LEAST_SHARE = 0.02
"""Least brightness of a place, as a share of the frame's: the floor of a hole stays finite."""
GAP_PERIODS = 0.25
"""Longest gap of an edge that is closed, periods: dark fringes hide it."""


def still_edges(prepared: PreparedPair) -> BoolMap:
    """Find hard edges of paint, and rims, in the reference frame.

    Parameters
    ----------
    prepared : PreparedPair

    Returns
    -------
    (h, w) bool array; nowhere True where the reference's fringes are on no smooth surface.

    Notes
    -----
    The phase of the fringes is a polynomial. Their waveform W is the median of every part of a
    period, of the brightness over its mean within about a period, and the paint is that ratio over
    W. An edge is a change of the paint over twice the reach of the blur, beyond its noise.
    """
    counts = prepared.reference.astype(np.float64)
    width = (prepared.period, prepared.period)
    around = np.maximum(smooth(counts, width), LEAST_SHARE * prepared.mean_brightness)
    frame = counts / around
    nodes = phase_nodes(prepared)
    found = None if nodes is None else polynomial_phase(prepared, nodes)
    if nodes is None or found is None:
        return np.zeros(frame.shape, bool)
    h, w = frame.shape
    fx, fy = prepared.frequency
    columns = np.broadcast_to(np.arange(w, dtype=np.float64), frame.shape)
    phase = fx * columns + fy * np.arange(h)[:, None] + found.at(columns) / (2.0 * np.pi)
    light, slope = _waveform(frame, phase)
    dark = light < MIN_STEP * float(light.max())
    bright = np.where(dark, 1.0, light)
    paint = frame / bright
    # A polynomial misses the phase by what it leaves of the nodes.
    off = float(np.median(np.abs(found.left(nodes)))) / NORMAL_MEDIAN / (2.0 * np.pi)
    sigma = np.hypot(np.sqrt(prepared.noise[0]) / around, off * slope * paint) / bright
    edges, certain = (np.zeros(frame.shape, bool) for _ in range(2))
    for axis in (0, 1):
        ahead, behind = (np.roll(paint, k, axis) for k in (-BLUR_PX, BLUR_PX))
        unsure, spread = (
            np.roll(v, -BLUR_PX, axis) + np.roll(v, BLUR_PX, axis) for v in (dark, sigma)
        )
        change = np.abs(ahead - behind)
        usual = _usual(change, prepared.period)
        step = (change > np.maximum(NOISE_SIGMAS * spread, MIN_STEP)) & ~unsure.astype(bool)
        border = [slice(None), slice(None)]
        for end in (slice(0, BLUR_PX), slice(-BLUR_PX, None)):
            border[axis] = end
            step[tuple(border)] = False
        edges |= step
        certain |= step & (change > NOISE_SIGMAS * usual)
    # An edge goes on where the waveform's errors could hide it.
    edges &= widened(certain, round(GOES_ON_PERIODS * prepared.period))
    reach = max(1, round(0.5 * GAP_PERIODS * prepared.period))
    closed = scipy.ndimage.binary_closing(edges, np.ones((2 * reach + 1,) * 2), border_value=0)
    return np.asarray(edges | closed)


def _usual(change: FloatMap, period_px: float) -> FloatMap:
    """What the waveform misses around every pixel, (h, w), as a standard deviation.

    Its errors go on along the fringes, and fill places where the polynomial fails. Rims do neither:
    the medians along and around do not see them.
    """
    step = max(1, round(period_px / SAMPLES_PER_PERIOD))
    side = round(ALONG_PERIODS * period_px / step) | 1
    rows = np.minimum(np.arange(change.shape[0]) // step, -(-change.shape[0] // step) - 1)
    columns = np.minimum(np.arange(change.shape[1]) // step, -(-change.shape[1] // step) - 1)
    along = scipy.ndimage.median_filter(change[::step], (side, 1), mode="reflect")[rows]
    around = scipy.ndimage.median_filter(change[::step, ::step], side, mode="reflect")
    return np.asarray(np.maximum(along, around[np.ix_(rows, columns)]) / NORMAL_MEDIAN)


def _waveform(frame: FloatMap, phase: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Median brightness of the fringes by their phase, and its slope per period, (h, w)."""
    place = (phase - np.floor(phase)) * PHASES
    part = np.minimum(place.astype(np.intp), PHASES - 1)
    labels = np.arange(PHASES)
    wave = scipy.ndimage.median(frame, part, labels)
    at = np.concatenate(([labels[-1] - PHASES], labels, [PHASES])) + 0.5
    level = np.concatenate(([wave[-1]], wave, [wave[0]]))
    slope = PHASES * np.gradient(level)
    return np.interp(place, at, level), np.abs(np.interp(place, at, slope))


def mixed_paint(edges: BoolMap, displacement_px: FloatMap) -> BoolMap:
    """Pixels whose matching point lies beyond an edge, or beside one, (h, w).

    Parameters
    ----------
    edges : (h, w) bool array
        Of ``still_edges``.
    displacement_px : (h, w) array
        Finite, px.
    """
    w = edges.shape[1]
    wide = widened(edges, 1)
    count: NDArray[np.int64] = np.zeros((edges.shape[0], w + 1), np.int64)
    np.cumsum(wide, axis=1, out=count[:, 1:])
    here = np.arange(w)
    there = np.clip(np.rint(here - displacement_px), 0, w - 1).astype(np.intp)
    first, last = np.minimum(here, there), np.maximum(here, there)
    inside = np.take_along_axis(count, last + 1, axis=1) - np.take_along_axis(count, first, axis=1)
    return np.asarray(inside > 0)
