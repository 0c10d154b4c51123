"""Motion of a scene along a sequence: between its cycles, and at any moment."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.frames import Planes
from fringeworks.stack.motion import Motion, moment_of, warped
from fringeworks.stack.motion_evidence import (
    Evidence,
    evidence_of,
    lit_by,
    lit_medians,
    turn_weights,
    whole,
)
from fringeworks.stack.motion_path import MotionPath, observed
from fringeworks.stack.motion_search import MOST_PERIODS, motion_between
from fringeworks.types import Axis, FloatMap, sealed
from fringeworks.types.packages import need_opencv

KEPT = 3
"""Pairs of cycles whose motion is kept. Farther ones say little of a moment."""
IN_SETS = 1.0
"""Time over which a wrong velocity acts while the frames of a set are taken, frames: sets of three
to eight steps have 0.5 to 1.5."""
UNSURE_SUMS = 2
"""Number of sums of places whose standard deviation a moment needs: the coordinate that its sets
tell, and the velocity in the finest set. They are the last two of ``MotionTrack._rows``."""


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
        self._motions: deque[Motion] = deque(maxlen=KEPT)
        self._steady: deque[dict[Axis, FloatMap]] = deque(maxlen=KEPT)
        """Velocity of each pair at the blocks of the image, as if nothing moved across it."""
        self._evidence: deque[tuple[int, dict[Axis, list[Evidence]]]] = deque(maxlen=KEPT)
        self._paths: dict[Axis, MotionPath] = {}
        self.pairs = 0
        """Number of pairs of cycles that were added."""

    def add(self, one: Planes, other: Planes, noise: float) -> None:
        """Find the motion between the last cycle and the next one; see ``motion_between``."""
        plan, shape = self._plan, one[0].shape
        speeding = {}
        if len(self._steady) > 1:
            before, last = self._steady[-2], self._steady[-1]
            speeding = {a: whole((last[a] - before[a]) / plan.frames, shape) for a in plan.axes}
        motion, at_pixels = motion_between(one, other, plan, noise, speeding)
        lit = lit_by(one, plan)
        self._motions.append(motion)
        self._steady.append({axis: lit_medians(v, lit) for axis, v in at_pixels.items()})
        evidence = evidence_of(one, other, plan, motion, at_pixels, noise)
        self._evidence.append((self.pairs * plan.frames, evidence))
        self.pairs += 1
        for axis in plan.axes:
            pairs = [(start, found[axis]) for start, found in self._evidence]
            finest = min(block.period_px for _, block in plan.phase_sets(axis))
            fastest = MOST_PERIODS * finest / plan.frames
            self._paths[axis] = MotionPath(observed(pairs, plan.frames), plan.frames, fastest)

    def at(self, start: int, order: Sequence[int]) -> Motion:
        """Return the motion at the moment of as many frames as the plan's from ``start`` on.

        Parameters
        ----------
        start : int
            Index of a frame in the sequence.
        order : ints
            Index of the frame of each pattern that is decoded.

        Notes
        -----
        The velocity of every pixel is that of the nearest pair. How it changes, and by how much
        that is not sure, is known for blocks of the image; see ``MotionPath``.
        """
        middle = moment_of(start, self._plan.frames)
        first = self.pairs - len(self._motions)
        place = (middle + 0.5) / self._plan.frames - 1.0 - first
        nearest = int(np.clip(np.rint(place), 0, len(self._motions) - 1))
        motion = _moved(self._motions[nearest], (place - nearest) * self._plan.frames)
        shape = next(iter(motion.velocity_px.values())).shape
        velocity: dict[Axis, FloatMap] = {}
        path: dict[Axis, dict[float, FloatMap]] = {}
        sigma: dict[Axis, FloatMap] = {}
        for axis in self._plan.axes:
            count = len(order)
            found, unsure = self._paths[axis].of(*self._rows(axis, order, middle), UNSURE_SUMS)
            own = motion.velocity_px[axis] - whole(self._steady[nearest][axis], shape)
            path[axis] = {
                k - middle: whole(found[i], shape) + np.float32(k - middle) * own
                for i, k in enumerate(order)
            }
            velocity[axis] = whole(found[count], shape) + own
            spread = np.hypot(unsure[0], IN_SETS * unsure[1])
            sigma[axis] = whole(spread, shape)
        return replace(motion, velocity_px=velocity, path_px=path, path_sigma_px=sigma)

    def vibrations(self, axis: Axis) -> dict[float, FloatMap]:
        """Probability of a vibration of each period, frames, at the blocks of the image."""
        return self._paths[axis].vibrations

    def _rows(
        self, axis: Axis, order: Sequence[int], middle: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Sums of places that a moment needs, and their times: each frame from the moment, the
        velocity there, the coordinate that its sets tell, and the velocity in the finest set."""
        count = len(order)
        times = np.array([*order, middle, middle - 0.5, middle + 0.5], float)
        rows = np.zeros((count + 3, count + 3))
        rows[np.arange(count), np.arange(count)] = 1.0
        rows[:count, count] = -1.0
        rows[count, count + 1 :] = -1.0, 1.0
        sets = self._plan.phase_sets(axis)
        total = sum(block.period_px**-2.0 for _, block in sets)
        for first, block in sets:
            part = slice(first, first + block.frames)
            rows[count + 1, part] = block.period_px**-2.0 / total / block.frames
        rows[count + 1, count] = -1.0
        first, finest = min(sets, key=lambda one: one[1].period_px)
        rows[count + 2, first : first + finest.frames] = turn_weights(finest.shifts_rad)[0]
        return rows, times


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
