"""How late frames are: when they show a picture, relative to the time at which it was shown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types.arrays import FloatMap
from fringeworks.types.frozen import Frozen

MARGIN_SHARE = 0.25
"""Margin on both sides of the measured delays, refresh periods: 4 ms at 60 Hz, more than the
scheduler of a computer that is not overloaded needs."""
SAME_MOMENT_S = 1e-3
"""Differences of time that are ignored, s: where camera and projector keep step, all frames come at
the same few moments, exact to the scheduler's jitter."""


@dataclass(frozen=True, eq=False, repr=False)
class Delay(Frozen):
    """When frames show a picture, relative to the time at which it was shown.

    The moment of a frame is the time at which it arrived.
    """

    appears_s: FloatMap
    """Moments of frames, after the showing of the newest picture that is visible in each, s."""
    absent_s: FloatMap
    """Moments of frames, after the showing of the first picture that is not yet visible, s."""
    alone_s: FloatMap
    """Moments of frames, after the showing of the oldest picture that is visible in each, s."""
    left_s: FloatMap
    """Moments of frames, after the showing of the picture that replaces the oldest one visible in
    each, s."""
    refresh_s: float
    """Refresh period of the projector, s."""
    frame_s: float
    """Time between frames that 95 % of them keep, s."""
    transit_s: tuple[float, float] | None = None
    """Shortest and longest time from a trigger to the arrival of its frame, s; None without
    triggers."""

    @property
    def margin_s(self) -> float:
        """Margin that is kept on both sides, s."""
        return MARGIN_SHARE * self.refresh_s

    @property
    def alone_from_s(self) -> float:
        """Earliest moment, after the last trace of the picture before, at which a frame was seen.

        No moment at which no frame was seen is trusted: camera and projector may keep step while
        the delay is measured, and not later.
        """
        gone_s = float(self.left_s.max()) + self.margin_s
        later = self.alone_s[self.alone_s >= gone_s]
        return float(later.min()) if later.size else gone_s + self.frame_s

    @property
    def absent_until_s(self) -> float:
        """Latest moment, before the first trace of a picture, at which a frame was seen."""
        begins_s = float(self.appears_s.min()) - self.margin_s
        earlier = self.absent_s[self.absent_s <= begins_s]
        return float(earlier.max()) if earlier.size else begins_s - self.frame_s

    @property
    def first_s(self) -> float:
        """Moment from which on a frame shows a picture and not the one before, s after showing."""
        return self.alone_from_s - SAME_MOMENT_S

    @property
    def last_s(self) -> float:
        """Moment until which a frame does not show the picture after, s after showing that."""
        return self.absent_until_s + SAME_MOMENT_S

    @property
    def hold_s(self) -> float:
        """Time for which a picture must be shown so that a frame shows only it, s.

        A whole number of refresh periods. A camera without triggers must find time for a frame
        that begins at any moment.
        """
        shortest_s, longest_s = self.transit_s or (0.0, self.frame_s)
        needed = self.first_s - self.last_s + longest_s - shortest_s
        return float(max(1.0, np.ceil(needed / self.refresh_s)) * self.refresh_s)

    def __str__(self) -> str:
        appears, gone = 1e3 * self.appears_s.min(), 1e3 * self.left_s.max()
        return f"appears after {appears:.0f} ms, complete after {gone:.0f} ms"
