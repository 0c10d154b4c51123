"""When frames would have arrived without being late: by the camera's clock, its counter, or both
the arrivals of later frames and a steady period."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.devices.protocols import Grab
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import FloatMap
from fringeworks.types.delay import SAME_MOMENT_S

MIN_DATED = 4
"""Smallest number of frames whose times are compared: with fewer, no period is known."""
CLOCK_TOLERANCE = 0.2
"""Largest difference between the period of a camera's own clock and that of the arrivals, relative.
Clocks differ by less than 0.001, and frames that arrive in bunches move a median by less than this.
A clock that counts in another unit is off by a factor."""
COMPARED_FRAMES = 32
"""Later frames whose arrival tells that a frame was late. Half a second at 60 frames per second is
longer than networks and drivers usually hold frames back."""
PERIOD_TOLERANCE = 2e-3
"""Relative error of a period that is the median of the times between frames which arrive without
jitter: clocks of computers step by microseconds to 1 ms."""
PERIOD_FRAMES = 64
"""Largest number of frames that the error of a period is taken from: as many as a fast scan keeps.
With all frames of a longer film, its dates would be tighter than those of the scan."""
PERIOD_SIGMAS = 2.0
"""Standard errors by which the period is taken shorter than the median. A period that is too long
dates frames before they were exposed: with a jitter of 15 ms, 64 frames at 51 Hz tell it to 5 %,
and 32 frames ahead that is one and a half periods."""
COPY_SHARE = 0.5
"""Share of a period within which an equal frame is a copy of the one before, delivered twice."""


def moments_s(grabs: Sequence[Grab], *, triggered: bool = False) -> FloatMap:
    """Return the times at which frames would have arrived without being late.

    Parameters
    ----------
    grabs : sequence of Grab
        In the order of their arrival.
    triggered : bool
        Whether frames were triggered, so that they have no period.

    Returns
    -------
    (n,) array of times on the clock of ``time.monotonic``, s: upper bounds, never later than the
    arrivals.

    Notes
    -----
    With a clock of its own, a camera dates its frames up to a constant. The constant is the
    smallest difference between arrival and date, that of a frame that was not late.

    Without a clock, the exposures of frames i < j are (n_j − n_i) periods P apart or more, where n
    is the camera's counter, or the number of frames that arrived. A frame that has arrived at h_i
    would have been due at h_j − (n_j − n_i) P or earlier, for every later frame j: frames that were
    held back arrive in a bunch, and the last of the bunch dates the others.
    """
    arrived = np.array([grab.host_s for grab in grabs], np.float64)
    if arrived.size < MIN_DATED:
        return arrived
    dated = _by_clock(grabs, arrived)
    if dated is None and not triggered:
        dated = _by_period(grabs, arrived)
    if dated is None:
        return arrived
    late = arrived - dated
    return np.asarray(np.where(late > SAME_MOMENT_S, dated, arrived))


def _by_clock(grabs: Sequence[Grab], arrived: FloatMap) -> FloatMap | None:
    """Times by the camera's own clock; None where it has none, or none that can be used."""
    dates = [grab.device_s for grab in grabs if grab.device_s is not None]
    if len(dates) < len(grabs):
        return None
    own = np.array(dates, np.float64)
    gaps = np.diff(own)
    new = gaps > 0.0
    if (gaps < 0.0).any() or np.count_nonzero(new) < MIN_DATED - 1:
        return None
    ratio = float(np.median(gaps[new])) / max(float(np.median(np.diff(arrived)[new])), 1e-9)
    if abs(ratio - 1.0) > CLOCK_TOLERANCE:
        return None
    return np.asarray(own + float(np.min(arrived - own)))


def _by_period(grabs: Sequence[Grab], arrived: FloatMap) -> FloatMap | None:
    """Times by the period of the frames, and their counter where there is one."""
    numbers = [grab.number for grab in grabs if grab.number is not None]
    gaps = np.diff(arrived)
    if len(numbers) == len(grabs):
        count = np.array(numbers, np.float64)
        steps = np.diff(count)
        if (steps < 0.0).any():
            return None
    else:
        usual = float(np.median(gaps))
        steps = np.ones(gaps.size)
        for k in np.flatnonzero(gaps < COPY_SHARE * usual).tolist():
            steps[k] = not np.array_equal(grabs[k].pixels, grabs[k + 1].pixels)
        count = np.concatenate(([0.0], np.cumsum(steps)))
    new = steps > 0.0
    if not new.any():
        return None
    period_s = _shortest_period(gaps[new] / steps[new])
    dated = arrived.copy()
    for ahead in range(1, min(COMPARED_FRAMES, len(grabs) - 1) + 1):
        due = arrived[ahead:] - (count[ahead:] - count[:-ahead]) * period_s
        dated[:-ahead] = np.minimum(dated[:-ahead], due)
    # A copy shows what its original showed.
    for k in np.flatnonzero(steps == 0.0).tolist():
        dated[k + 1] = min(dated[k + 1], dated[k])
    return dated


def _shortest_period(gaps_s: FloatMap) -> float:
    """The shortest period that the times between frames, s, do not contradict.

    The median of N normal values has a standard error of σ √(π / 2 N).
    """
    usual = float(np.median(gaps_s))
    sigma = float(np.median(np.abs(gaps_s - usual))) / NORMAL_MEDIAN
    error = sigma * float(np.sqrt(0.5 * np.pi / min(gaps_s.size, PERIOD_FRAMES)))
    return max(usual - max(PERIOD_SIGMAS * error, PERIOD_TOLERANCE * usual), 0.0)
