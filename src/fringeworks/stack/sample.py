"""The sample of a stack that it is judged by: single pixels, lines across the fringes, a patch."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import PatternPlan, PhaseSteps
from fringeworks.stack.fits import SampleFits
from fringeworks.stack.frames import Planes, readable, sample_of, sampled_places
from fringeworks.types import Axis, FloatMap
from fringeworks.types.computed import cached_property

PATCH = 256
"""Side of the patch that spatial noise is measured in, px.

Its 65 000 second differences determine the noise to better than 1 %. An empirical choice.
"""

PATCH_FRAMES = 3
"""Number of frames whose patches are used; more hardly improve the result. Empirical."""

LINE_PIXELS = 16_000
"""Approximate number of pixels in the lines of one axis.

They determine a ripple of the phase to a hundredth of its noise. More lines take time: every line
is read from all frames of its axis. An empirical choice.
"""

MIN_LINES = 24
"""Smallest number of lines of one axis, so that windows of long fringes are found between the edges
of most scenes. Empirical."""

GRID = 48
"""Number of places along the shorter side of the image that tell which way patterns run: 2300 and
more differences in each direction, a hundredth of the sample's pixels."""

LARGEST_COUNT = 1e9
"""Limit of the counts that are summed: more than any camera gives."""

MIN_CLEAR = 200
"""Smallest number of unsaturated pixels that judge a stack without the others, as for noise: a
variance from 200 residuals errs by 10 %."""

Lines = tuple[NDArray[Any], ...]
"""(r, l) arrays, one per frame: r lines across the fringes of an axis."""


@dataclass(frozen=True)
class Sample:
    """Pixels of every frame of a stack."""

    points: tuple[NDArray[Any], ...]
    """(1, n) arrays, one per frame: short stretches of rows, spread evenly over the frame."""
    lines: dict[Axis, Lines]
    """Whole rows or columns, across the fringes of each axis; one array per frame of the plan."""
    patch: tuple[FloatMap, ...]
    """(h, w) arrays: connected pixels of some frames, counts."""
    down: frozenset[Axis] = frozenset({"y"})
    """The axes whose lines are columns."""
    excesses: dict[Any, FloatMap | None] = field(default_factory=dict, init=False, compare=False)
    """What ``saturation.exceeds`` found for sets and a saturation: it is asked twice."""

    @cached_property
    def fits(self) -> SampleFits:
        """Fits of sets of steps to the points."""
        return SampleFits(self.points)

    def below(self, counts: float) -> tuple[NDArray[Any], ...]:
        """The points whose samples are below some counts in all frames; where those are too few
        for a statement, all points."""
        clear = np.logical_and.reduce([plane[0] < counts for plane in self.points])
        few = clear.all() or np.count_nonzero(clear) < MIN_CLEAR
        return self.points if few else tuple(plane[:, clear] for plane in self.points)


def take_sample(planes: Planes, plan: PatternPlan) -> Sample:
    """Take the sample of a stack.

    Parameters
    ----------
    planes : (h, w) arrays in the order of the plan
    plan : PatternPlan

    Returns
    -------
    Sample, with counts of types that the kernels read
    """
    places = sampled_places(planes[0].shape, plan)
    down = frozenset(axis for axis in plan.axes if _runs_down(planes, plan, axis))
    return Sample(
        tuple(sample_of(plane, places) for plane in planes),
        {axis: tuple(_lines(plane, axis in down) for plane in planes) for axis in plan.axes},
        tuple(_patch(planes, plan)),
        down,
    )


def _runs_down(planes: Planes, plan: PatternPlan, axis: Axis) -> bool:
    """Whether the patterns of an axis change down the image rather than along its rows, as columns
    of the projector do for a camera that stands on its side."""
    frames = [
        first + k
        for first, block in plan.placed
        if getattr(block, "axis", None) == axis
        for k in range(block.frames)
    ]
    step = max(1, min(planes[0].shape) // GRID)
    seen = np.stack([np.nan_to_num(planes[k][::step, ::step].astype(np.float32)) for k in frames])
    seen = np.clip(seen, -LARGEST_COUNT, LARGEST_COUNT)  # their sums are finite
    seen -= seen.mean(axis=0)  # what all frames show alike is paint
    down, along = (np.abs(np.diff(seen, axis=k)) for k in (1, 2))
    if not down.size or not along.size:
        return axis == "y"  # a line of pixels
    change = float(np.mean(down)), float(np.mean(along))
    return change[0] > change[1] if change[0] != change[1] else axis == "y"


def _lines(frame: NDArray[Any], down: bool) -> NDArray[Any]:
    """Rows of a frame, or columns, evenly spaced."""
    across = frame.T if down else frame
    count, length = across.shape
    wanted = min(count, max(MIN_LINES, LINE_PIXELS // length))
    rows = ((np.arange(wanted) + 0.5) * count / wanted).astype(np.intp)
    return readable(across[rows])


def _patch(planes: Planes, plan: PatternPlan) -> list[FloatMap]:
    """Patches of the first frames for spatial noise; of phase frames where there are any."""
    phase_frames = [
        k
        for first, b in plan.placed
        if isinstance(b, PhaseSteps)
        for k in range(first, first + b.frames)
    ]
    return [_middle(planes[k]) for k in (phase_frames or range(len(planes)))[:PATCH_FRAMES]]


def _middle(frame: NDArray[Any]) -> FloatMap:
    """The patch in the middle of a frame, counts."""
    h, w = frame.shape
    top, left = max(0, (h - PATCH) // 2), max(0, (w - PATCH) // 2)
    # Single precision holds whole counts exactly, and takes half the time.
    kind = np.float32 if frame.dtype.kind == "u" else np.float64
    return frame[top : top + PATCH, left : left + PATCH].astype(kind)
