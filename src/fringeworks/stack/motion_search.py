"""Motion of a scene between two successive cycles of a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fringeworks.patterns.order_chain import TURN
from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.frames import Planes
from fringeworks.stack.motion import (
    CHANGE_WINDOW,
    Motion,
    fit_moving,
    late_frames,
    lit_evenly,
    phase_sets,
    warped,
)
from fringeworks.stack.motion_code import code_distance, code_of
from fringeworks.types import Axis, BoolMap, FloatMap, FramesContradictPlan
from fringeworks.types.packages import cv2

MOST_PERIODS = 2
"""Periods of the finest fringes that a surface may move along the projector during a cycle."""
PERIOD_PENALTY = 1e-3
"""What a further period of motion costs against the disagreement of the sets, turns². The phase
noise of weak fringes makes 5e-4, and a wrong period at usual plans 1e-2. Empirical."""
VELOCITY_WINDOW = 5
"""Side of the median filter on velocities, px: neighbours move alike, and noise does not."""
PASSES = 2
"""Fits of the phases of each cycle: the first knows no motion and is wrong by a tenth of it, the
second by a hundredth."""
CHANGE_EXCESS = 10.0
"""Mean square of the change in the window, over that of noise, from which on it counts as motion
across the image. Noise alone has a mean of 1 ± 0.2; light that flickers by a count makes less than
10. Empirical."""
SMOOTHED = 0.77
"""Variance of noise after the interpolation that moves a frame, over that before: the mean over all
fractions of a pixel along both directions."""
MUCH_BETTER = 0.7
"""Squared residuals with motion across the image, over those without and the noise's, that show
that it is there: paint and edges do. Noise alone, averaged over the window, scatters by 0.1."""
BETTER = 1.1
"""The same ratio up to which it is taken out around such places, to not leave holes where paint is
even, or where the fringes hide an edge."""
NEAR_CLEAR = 15
"""Side of the area around such places that belongs to them, px."""
MOST_CHANGE = 0.15
"""Largest relative change of the brightness between two cycles that counts as a change in
proportion to time; edges that move make larger ones."""
CLEAR_SIGMAS = 6.0
"""Smallest change of a background that counts as one of brightness, in standard deviations of one
background: 4.2 of the difference of two."""
FLOW_MARGIN = 33
"""Side of the area around changes that belongs to them, px."""
LEAST_MOVING = 1e-3
"""Share of changed pixels below which the image stands still."""
LIT_POWER = 0.1
"""Smallest squared modulation of pixels that are judged, as a share of the 95th percentile."""
UNRELATED = 0.02
"""Median disagreement of the sets about the distance that surfaces have moved, turns², from which
on they saw different scenes. Noise of 0.1 rad makes 0.002, unrelated phases 0.03 and more."""
FULL = 255.0
"""Brightest count of the images that the optical flow is computed from."""
BRIGHT_PERCENTILE = 99.5
"""Percentile of the brightness that becomes ``FULL``: highlights may exceed it."""


def motion_between(
    one: Planes,
    other: Planes,
    plan: PatternPlan,
    noise: float,
    acceleration_px: dict[Axis, FloatMap] | None = None,
) -> tuple[Motion, dict[Axis, FloatMap]]:
    """Find the motion between two successive cycles of a plan, at the middle of both.

    Parameters
    ----------
    one, other : (h, w) arrays in the order of the plan, counts
    plan : PatternPlan
        With fringes.
    noise : float > 0
        Standard deviation of a sample, counts; infinity leaves motion across the image out.
    acceleration_px : (h, w) arrays by axis, optional
        As of the motion before.

    Returns
    -------
    motion : Motion
        Its velocities are those at ``late_frames`` after the middle of both cycles.
    at_pixels : (h, w) arrays by axis
        Change of the coordinate at each pixel, as if nothing moved across the image, projector px
        per frame.

    Raises
    ------
    FramesContradictPlan where the sets tell different motions all over the image.

    Notes
    -----
    Every set of a cycle sees the same phase steps as in the next one, a cycle later. The difference
    of its phases is therefore the distance that the surface has moved along the projector, modulo
    the period. Of the distances of up to two periods, the one on which the sets agree is taken.
    Phases that turn while they are sampled are fitted again with the velocity that was found. The
    motion across the image is the optical flow between the backgrounds of both cycles (dense
    inverse search: Kroeger et al., ECCV 2016), where they differ by more than noise. Brightness
    that changes in proportion, as on surfaces that turn, explains such differences as well; motion
    across the image is taken where it leaves smaller residuals.
    """
    shape = one[0].shape
    across = _Pair(one, other, plan).along(None)
    known = acceleration_px or {}
    straight = Motion({a: np.zeros(shape, np.float32) for a in plan.axes}, None, known)
    for _ in range(PASSES):
        straight = replace(straight, velocity_px=_velocities(across.fits(straight), plan))
    if not np.isfinite(noise):
        return straight, straight.velocity_px
    level_noise = noise / across.samples**0.5
    straight, fits, backgrounds = across.with_light(straight, level_noise)
    flow = _flow(*backgrounds, level_noise)
    if flow is None:
        return straight, straight.velocity_px
    flowing = replace(straight, flow_px=flow / np.float32(plan.frames), brightening=None)
    back = across.along(flowing.flow_px)
    flowing = replace(flowing, velocity_px=_velocities(back.fits(flowing), plan))
    flowing, moved, _ = back.with_light(flowing, level_noise)
    return _chosen(flowing, straight, _better(moved, fits, across.freedom)), straight.velocity_px


def _chosen(flowing: Motion, straight: Motion, better: BoolMap) -> Motion:
    """The motion across the image where it is better, at other pixels that without."""
    assert flowing.flow_px is not None
    velocity = {
        axis: np.where(better, flowing.velocity_px[axis], v)
        for axis, v in straight.velocity_px.items()
    }
    zero = np.zeros(better.shape, np.float32)
    light = [zero if m.brightening is None else m.brightening for m in (flowing, straight)]
    return Motion(
        velocity,
        np.where(better[..., None], flowing.flow_px, np.float32(0.0)),
        brightening=np.where(better, *light),
    )


@dataclass(frozen=True)
class _Fits:
    """Fits of the sets of two successive cycles."""

    turns: list[FloatMap]
    """Difference of the wrapped phases of every set, turns."""
    power: FloatMap
    """Sum of the squared modulations of all fits, (h, w), counts²."""
    backgrounds: tuple[FloatMap, FloatMap]
    """Mean background of each cycle, counts."""
    square: FloatMap
    """Sum of the squared residuals of all fits, counts²."""
    by_code: dict[Axis, FloatMap]
    """Distance by the Gray code of each axis that has one, px."""


@dataclass(frozen=True)
class _Pair:
    """The frames of two successive cycles, without the motion across the image."""

    one: list[FloatMap]
    other: list[FloatMap]
    plan: PatternPlan

    @property
    def samples(self) -> int:
        """Number of samples of the backgrounds of a cycle."""
        return sum(block.frames for _, block in phase_sets(self.plan))

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residuals of both cycles."""
        return 2 * sum(block.frames - 3 for _, block in phase_sets(self.plan))

    def along(self, flow_px: FloatMap | None) -> _Pair:
        """The frames moved back along a flow to the middle of both cycles."""
        count = self.plan.frames
        cycles = [
            [warped(frame, flow_px, start + k - count + 0.5) for k, frame in enumerate(frames)]
            for frames, start in ((self.one, 0), (self.other, count))
        ]
        return replace(self, one=cycles[0], other=cycles[1])

    def with_light(
        self, motion: Motion, noise: float
    ) -> tuple[Motion, _Fits, tuple[FloatMap, FloatMap]]:
        """Add the change of brightness to a motion; its fits, and the backgrounds before."""
        fits = self.fits(motion)
        before, after = fits.backgrounds
        mean, change = 0.5 * (before + after), after - before
        with np.errstate(invalid="ignore", divide="ignore"):
            rate = change / (np.float32(self.plan.frames) * mean)
            clear = (np.abs(change) > CLEAR_SIGMAS * noise) & (np.abs(change) < MOST_CHANGE * mean)
        if clear.any():
            motion = replace(motion, brightening=np.where(clear, rate, np.float32(0.0)))
            fits = self.fits(motion)
        motion = replace(motion, velocity_px=_velocities(fits, self.plan))
        return motion, self.fits(motion), (before, after)

    def fits(self, motion: Motion) -> _Fits:
        """Fit the sets of both cycles, each at its own mean time."""
        count = self.plan.frames
        middle = count - 0.5
        phases: list[FloatMap] = []
        backgrounds: list[FloatMap] = []
        square = np.zeros(self.one[0].shape, np.float32)
        power = np.zeros_like(square)
        for frames, start in ((self.one, 0), (self.other, count)):
            background = np.zeros_like(square)
            for first, block in phase_sets(self.plan):
                part = range(first, first + block.frames)
                samples = [lit_evenly(frames[k], motion, start + k - middle) for k in part]
                # Velocities hold at the time of the sets that they come from.
                late = late_frames(self.plan, block.axis)
                times = [start + k - middle - late for k in part]
                there = motion.moved_px(block.axis, float(np.mean(times)))
                moved = [motion.moved_px(block.axis, t) - there for t in times]
                per_px = TURN / block.period_px
                level, c, s, left = fit_moving(samples, block.shifts_rad, moved, per_px)
                phases.append(np.arctan2(s, c) / np.float32(TURN))
                background += np.float32(block.frames / self.samples) * level
                square += left
                power += c * c + s * s
            backgrounds.append(background)
        half = len(phases) // 2
        turns: list[FloatMap] = [
            after - before for before, after in zip(phases[:half], phases[half:], strict=True)
        ]
        by_code = self._by_code(motion)
        return _Fits(turns, power, (backgrounds[0], backgrounds[1]), square, by_code)

    def _by_code(self, motion: Motion) -> dict[Axis, FloatMap]:
        """Distance by the Gray code of each axis that has one, px."""
        if not any(code_of(self.plan, axis) for axis in self.plan.axes):
            return {}
        count = self.plan.frames
        one, other = (
            [lit_evenly(frame, motion, start + k - count + 0.5) for k, frame in enumerate(frames)]
            for frames, start in ((self.one, 0), (self.other, count))
        )
        found = {axis: code_distance(one, other, self.plan, axis) for axis in self.plan.axes}
        return {axis: distance for axis, distance in found.items() if distance is not None}


def _better(moved: _Fits, still: _Fits, freedom: int) -> BoolMap:
    """Mark pixels whose samples motion across the image explains better than light that changes.

    The flow may be wrong where shading or shadows change. Fits of three steps have no residuals;
    there, the change of the background decides, which the flow was made to undo.
    """
    size = (CHANGE_WINDOW, CHANGE_WINDOW)
    squares: list[FloatMap] = []
    for fits, noise in ((moved, 1.0), (still, SMOOTHED)):
        before, after = fits.backgrounds
        square = fits.square if freedom > 0 else (after - before) ** 2
        squares.append(noise * np.asarray(cv2.blur(np.nan_to_num(square), size)))
    clearly = (squares[0] < MUCH_BETTER * squares[1]).astype(np.uint8)
    around = cv2.dilate(clearly, np.ones((NEAR_CLEAR, NEAR_CLEAR), np.uint8))
    no_worse = np.isfinite(moved.square) & (squares[0] < BETTER * squares[1])
    return np.asarray(no_worse & (around > 0))


def _velocities(fits: _Fits, plan: PatternPlan) -> dict[Axis, FloatMap]:
    velocities: dict[Axis, FloatMap] = {}
    blocks = [block for _, block in phase_sets(plan)]
    for axis in plan.axes:
        along = [k for k, block in enumerate(blocks) if block.axis == axis]
        turns = [fits.turns[k] for k in along]
        periods = [blocks[k].period_px for k in along]
        moved, misfit = distance_of(turns, periods, fits.by_code.get(axis))
        _refuse_unrelated(misfit, fits.power, axis)
        velocity = np.nan_to_num(moved).astype(np.float32) / np.float32(plan.frames)
        velocities[axis] = np.asarray(cv2.medianBlur(velocity, VELOCITY_WINDOW), np.float32)
    return velocities


def _refuse_unrelated(misfit: FloatMap, power: FloatMap, axis: Axis) -> None:
    """Refuse cycles whose sets have moved by different distances at most lit pixels."""
    known = np.isfinite(power)
    lit = known & (power > LIT_POWER * np.percentile(power[known], 95)) if known.any() else known
    if lit.any() and float(np.median(misfit[lit])) > UNRELATED:
        raise FramesContradictPlan(
            f"the sets along {axis} contradict each other about the motion from one cycle to the "
            "next; expected the frames of the plan over and over: a frame was lost, or the scene "
            "was changed"
        )


def distance_of(
    turns: Sequence[FloatMap], periods_px: Sequence[float], near_px: FloatMap | None = None
) -> tuple[FloatMap, FloatMap]:
    """Return the distance that differences of wrapped phases belong to.

    Parameters
    ----------
    turns : M (h, w) arrays
        Difference of the phases of each set, turns; known modulo one.
    periods_px : M floats
    near_px : (h, w) array, optional
        Distance that is likely beforehand, px; 0 by default.

    Returns
    -------
    distance : (h, w) array, px
        Of the distances of up to ``MOST_PERIODS`` of the finest period, that on which the sets
        agree best; of equals, that next to ``near_px``.
    misfit : (h, w) array
        Disagreement of the sets, the sum of their squared differences, turns².
    """
    finest = int(np.argmin(periods_px))
    start = periods_px[finest] * (turns[finest] - np.rint(turns[finest]))
    likely = np.zeros_like(start) if near_px is None else (near_px - start) / periods_px[finest]
    # Farther than it can be, it is wrong.
    likely = np.where(np.abs(likely) > MOST_PERIODS + 0.5, np.float32(0.0), likely)
    best = np.full(start.shape, np.inf, np.float32)
    distance = start
    for period in range(-MOST_PERIODS, MOST_PERIODS + 1):
        trial = start + np.float32(period * periods_px[finest])
        misfit = np.float32(PERIOD_PENALTY) * np.square(period - likely)
        for turn, length in zip(turns, periods_px, strict=True):
            misfit += _fraction(turn - trial / length) ** 2
        better = misfit < best
        best, distance = np.where(better, misfit, best), np.where(better, trial, distance)
    weights = [1.0 / length**2 for length in periods_px]
    off = sum(
        weight * length * _fraction(turn - distance / length)
        for weight, length, turn in zip(weights, periods_px, turns, strict=True)
    )
    return np.asarray(distance + off / sum(weights)), best


def _fraction(turns: FloatMap) -> FloatMap:
    return np.asarray(turns - np.rint(turns))


def _flow(before: FloatMap, after: FloatMap, noise: float) -> FloatMap | None:
    """Motion across the image between two backgrounds of this noise, (h, w, 2), camera px; None
    for none."""
    if not np.isfinite(noise):
        return None
    before, after = np.nan_to_num(before), np.nan_to_num(after)
    size = (CHANGE_WINDOW, CHANGE_WINDOW)
    change = cv2.blur((after - before) ** 2, size) / np.float32(2.0 * noise**2)
    moving = (change > CHANGE_EXCESS).astype(np.uint8)
    if moving.mean() < LEAST_MOVING:
        return None
    around = cv2.dilate(moving, np.ones((FLOW_MARGIN, FLOW_MARGIN), np.uint8))
    brightest = max(float(np.percentile(before, BRIGHT_PERCENTILE)), noise)
    # Highlights beyond the brightest count only lose their texture.
    images = [np.clip(a * (FULL / brightest), 0, FULL).astype(np.uint8) for a in (before, after)]
    search = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)  # type: ignore[attr-defined]
    empty: Any = None
    flow = np.asarray(search.calc(images[0], images[1], empty), np.float32)
    flow[around == 0] = 0.0
    # The flow belongs to pixels of the first image; its middle is that of both.
    back = np.asarray(search.calc(images[1], images[0], empty), np.float32)
    back[around == 0] = 0.0
    return np.asarray(0.5 * (flow - back))
