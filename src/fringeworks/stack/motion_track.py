"""Motion of a scene along a sequence: between its cycles, and at any moment."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.frames import Planes
from fringeworks.stack.motion import Motion, late_frames, warped
from fringeworks.stack.motion_search import motion_between
from fringeworks.types import Axis, FloatMap, sealed
from fringeworks.types.packages import cv2, need_opencv

KEPT = 3
"""Pairs of cycles whose motion is kept: three determine a parabola in time."""
SURELY_UNKNOWN = 0.125
"""Smallest standard deviation of a velocity, as a share of its second difference (of the difference
for two pairs): the mean over a cycle hides when in it the velocity has changed."""
UNRESOLVED = 1.5
"""Bend of the velocity over three pairs of cycles, over the largest velocity, from which on it
changes faster than cycles can follow: a vibration of four cycles has 1.4, of three 2."""
BLOCK = 12
"""Side of the blocks whose median change of velocity is used, px. Changes of single pixels would
carry noise and edges on to other moments. Empirical."""


class MotionTrack:
    """The motion between successive cycles of a sequence.

    Parameters
    ----------
    plan : PatternPlan
        With fringes.
    """

    def __init__(self, plan: PatternPlan) -> None:
        need_opencv("a sequence")
        self._plan = plan
        self._late = {axis: late_frames(plan, axis) / plan.frames for axis in plan.axes}
        self._motions: deque[Motion] = deque(maxlen=KEPT)
        self._at_pixels: deque[dict[Axis, FloatMap]] = deque(maxlen=KEPT)
        self._sizes: deque[dict[Axis, FloatMap]] = deque(maxlen=KEPT)
        """Of the velocity of each pair, without its sign, smooth over the image."""
        self._changes: deque[dict[Axis, FloatMap]] = deque(maxlen=KEPT - 1)
        """Of the velocity from each pair to the next, smooth."""
        self._bend: dict[Axis, FloatMap] = {}
        """Difference of the changes over three pairs, smooth; empty for fewer."""
        self.pairs = 0
        """Number of pairs of cycles that were added."""

    def add(self, one: Planes, other: Planes, noise: float) -> None:
        """Find the motion between the last cycle and the next one; see ``motion_between``."""
        speeding = {}
        if self._changes:
            frames = np.float32(self._plan.frames)
            speeding = {axis: change / frames for axis, change in self._changes[-1].items()}
        motion, at_pixels = motion_between(one, other, self._plan, noise, speeding)
        self._motions.append(motion)
        self._at_pixels.append(at_pixels)
        self._sizes.append({axis: np.abs(_smooth(v)) for axis, v in at_pixels.items()})
        self.pairs += 1
        kept = self._at_pixels
        axes = self._plan.axes
        if len(kept) > 1:
            self._changes.append({axis: _smooth(kept[-1][axis] - kept[-2][axis]) for axis in axes})
        if len(kept) == KEPT:
            self._bend = {
                axis: _smooth((kept[2][axis] - kept[1][axis]) - (kept[1][axis] - kept[0][axis]))
                for axis in axes
            }

    def at(self, start: float) -> Motion:
        """Return the motion at the middle of as many frames as the plan's from ``start`` on.

        Parameters
        ----------
        start : float
            Index of a frame in the sequence.

        Notes
        -----
        The velocity of the nearest pair is moved to the moment by the line through two pairs and,
        where there are three, by the parabola. What the parabola adds to the line, or an eighth of
        how it bends, counts as the standard deviation of the velocity.
        """
        first = self.pairs - len(self._motions)
        # The velocity of pair k is that at k, in cycles, and a little later.
        place = start / self._plan.frames - 0.5 - first
        nearest = int(np.clip(np.rint(place), 0, len(self._motions) - 1))
        velocity: dict[Axis, FloatMap] = {}
        acceleration: dict[Axis, FloatMap] = {}
        sigma: dict[Axis, FloatMap] = {}
        for axis in self._plan.axes:
            step, slope, doubt = self._changed(axis, nearest, place - self._late[axis])
            velocity[axis] = self._motions[nearest].velocity_px[axis] + step
            acceleration[axis] = slope / np.float32(self._plan.frames)
            sigma[axis] = doubt
        motion = replace(
            self._motions[nearest],
            velocity_px=velocity,
            acceleration_px=acceleration,
            velocity_sigma_px=sigma,
        )
        return _moved(motion, (place - nearest) * self._plan.frames)

    def _changed(
        self, axis: Axis, nearest: int, place: float
    ) -> tuple[FloatMap, FloatMap, FloatMap]:
        """Change of the velocity from a pair to a place, slope there per cycle, and how sure."""
        count = len(self._motions)
        if count == 1:
            unknown = np.zeros_like(self._motions[0].velocity_px[axis])
            return unknown, unknown, unknown
        low = int(np.clip(np.floor(place), 0, count - 2))
        line = self._changes[low][axis]
        between = np.float32((place - low) * (place - low - 1.0))
        if count == 2:
            return (
                np.float32(place - nearest) * line,
                line,
                max(abs(0.5 * between), SURELY_UNKNOWN) * np.abs(line),
            )
        bend = self._bend[axis]
        away = np.float32(0.5 * (nearest - low) * (nearest - low - 1.0))
        # A velocity between two cycles is the mean over a cycle, not that at its middle.
        step = np.float32(place - nearest) * line + (0.5 * between - away - 1.0 / 24.0) * bend
        slope = line + np.float32(place - low - 0.5) * bend
        largest = np.max([sizes[axis] for sizes in self._sizes], axis=0)
        unresolved = np.abs(bend) > UNRESOLVED * largest
        doubt = max(abs(0.5 * between), SURELY_UNKNOWN) * np.abs(bend)
        return step, slope, np.where(unresolved, largest, doubt).astype(np.float32)


def _smooth(change: FloatMap) -> FloatMap:
    """A map of medians of blocks, linear between them: edges of what moves do not count."""
    height, width = change.shape
    rows, columns = -(-height // BLOCK), -(-width // BLOCK)
    padded = np.pad(change, ((0, rows * BLOCK - height), (0, columns * BLOCK - width)), mode="edge")
    blocks = padded.reshape(rows, BLOCK, columns, BLOCK).swapaxes(1, 2).reshape(rows, columns, -1)
    medians = cv2.medianBlur(np.median(blocks, axis=-1).astype(np.float32), 3)
    whole = cv2.resize(medians, (columns * BLOCK, rows * BLOCK), interpolation=cv2.INTER_LINEAR)
    return np.asarray(whole[:height, :width])


def _moved(motion: Motion, frames: float) -> Motion:
    """The motion some frames later: what moves across the image takes its velocity along."""
    if motion.flow_px is None:
        return motion
    flow = motion.flow_px

    def along(values: FloatMap) -> FloatMap:
        moved = warped(values, flow, -frames)
        return np.where(np.isnan(moved), values, moved)

    velocity = {axis: along(v) for axis, v in motion.velocity_px.items()}
    parts = [along(flow[..., k]) for k in (0, 1)]
    light = None if motion.brightening is None else along(motion.brightening)
    flow = sealed(np.stack(parts, axis=-1))
    return replace(motion, velocity_px=velocity, flow_px=flow, brightening=light)
