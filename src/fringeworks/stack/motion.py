"""Motion of a scene between its frames, and frames without it.

A projector repeats the frames of a plan, and the scene moves meanwhile. Two motions matter to a
camera pixel: the surface that it sees gets another projector coordinate, which turns the phases,
and the surface moves across the image, which brings other paint to the pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.order_chain import TURN
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps
from fringeworks.stack.frames import Planes
from fringeworks.types import Axis, BoolMap, FloatMap, Frozen
from fringeworks.types.packages import cv2

CHANGE_WINDOW = 7
"""Side of the window in which changes, residuals and slopes are averaged, px. Empirical."""
FLATTEST = 0.05
"""Smallest change of the projector coordinate from pixel to pixel, projector px, by which patterns
are moved back; usual rigs have 0.5 to 2."""
FARTHEST_PX = 24.0
"""Largest motion of a pattern across the image that is undone, camera px."""
NEAREST_PX = 0.1
"""Smallest one: less than the blur of the borders between cells."""
BRIGHTEST = 3.0
"""Largest |I − A| of a Gray-code pixel, in modulations B of the fringes, that is still taken for a
bit. Blur weakens fringes more than bits, but rarely to a third."""


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Frozen):
    """How a scene moves, at every camera pixel."""

    velocity_px: dict[Axis, FloatMap]
    """Change of the projector coordinate of the surface that the pixel sees, (h, w), projector px
    per frame."""
    flow_px: FloatMap | None = None
    """Motion of the surface across the image, columns and rows, (h, w, 2), camera px per frame;
    None where nothing moves across it."""
    acceleration_px: dict[Axis, FloatMap] = field(default_factory=dict)
    """Change of the velocity, (h, w), projector px per frame²; empty where unknown."""
    path_px: dict[Axis, dict[float, FloatMap]] = field(default_factory=dict)
    """How far the surface is from where it is at the moment, at times from it in frames, (h, w),
    projector px; empty where velocity and acceleration are all that is known."""
    path_sigma_px: dict[Axis, FloatMap] = field(default_factory=dict)
    """Standard deviation of the coordinate by what is not known of the path, (h, w), projector px;
    empty where unknown."""
    brightening: FloatMap | None = None
    """Relative change of the brightness, (h, w), per frame; None where it stays."""

    def moved_px(self, axis: Axis, frames: float) -> FloatMap:
        """Return how far surfaces move along the projector within some frames, (h, w), px."""
        if frames in self.path_px.get(axis, ()):
            return self.path_px[axis][frames]
        moved: FloatMap = np.float32(frames) * self.velocity_px[axis]
        if axis in self.acceleration_px:
            moved = moved + np.float32(0.5 * frames**2) * self.acceleration_px[axis]
        return np.asarray(moved)


def moment_of(first: int, frames: int) -> int:
    """Return the frame at whose time a moment is: the middle one, or the later of two.

    Between frames, vibrations that look alike in all frames are at different places.
    """
    return first + frames // 2


def phase_sets(plan: PatternPlan) -> list[tuple[int, PhaseSteps]]:
    """The sets of steps of a plan, each with the index of its first frame."""
    return [(k, block) for k, block in plan.placed if isinstance(block, PhaseSteps)]


def late_frames(plan: PatternPlan, axis: Axis) -> float:
    """Mean time of the sets along an axis from the middle of a cycle, weighted as in
    ``distance_of``, frames."""
    times = [k - 0.5 * (plan.frames - 1) for k in range(plan.frames)]
    sets = plan.phase_sets(axis)
    weights = [block.period_px**-2.0 for _, block in sets]
    means = [float(np.mean(times[first : first + block.frames])) for first, block in sets]
    return float(np.average(means, weights=weights))


def fit_moving(
    samples: Sequence[FloatMap],
    shifts_rad: Sequence[float],
    turned: Sequence[FloatMap],
    per_unit: float = 1.0,
) -> tuple[FloatMap, FloatMap, FloatMap, FloatMap]:
    """Fit a set of steps whose phase has turned by a known angle in each frame.

    Parameters
    ----------
    samples : N (h, w) float32 arrays, counts
    shifts_rad : N floats
        Shifts δ_n, rad.
    turned : N (h, w) float32 arrays
        Angles θ_n by which the phase has turned, in units of ``per_unit``.
    per_unit : float
        Radians of a unit.

    Returns
    -------
    A, c, s : (h, w) float32 arrays of I_n = A + c cos(δ_n − θ_n) + s sin(δ_n − θ_n), counts;
    NaN where the samples do not determine them.
    square : (h, w) float32 array, sum of the squared residuals, counts²
    """
    return _core.fit_moving(list(samples), _angles(shifts_rad, turned, per_unit))


def _angles(
    shifts_rad: Sequence[float], turned: Sequence[FloatMap], per_unit: float
) -> _core._Angles:
    """The angles of a set for the kernels."""
    return {"turned": list(turned), "per_unit": per_unit, "shifts": list(shifts_rad)}


def warped(frame: NDArray[Any], flow_px: FloatMap | None, time: float) -> FloatMap:
    """Return a map as it would be ``time`` frames earlier: what moves is moved back.

    Where nothing moves, values stay as they are. NaN where they would come from outside, or from
    next to what is not finite.

    Notes
    -----
    Cubic B-splines with their prefilter reproduce fringes of 16 px to 1e-4 (Unser, IEEE Signal
    Processing Magazine 16, 1999). Cubic convolution, as libraries of images have it, moves them by
    up to 0.05 px, in a rhythm with the fraction of a pixel.
    """
    values = frame.astype(np.float32)
    if flow_px is None or time == 0:
        return values
    return _core.warp_by_flow(values, np.ascontiguousarray(flow_px), float(time))


def moved_back(frame: NDArray[Any], motion: Motion, time: float) -> FloatMap:
    """Return a frame as it would be ``time`` frames earlier: without the motion across the image
    and the change of brightness; that along the projector stays."""
    return lit_evenly(warped(frame, motion.flow_px, time), motion, time)


def lit_evenly(still: FloatMap, motion: Motion, time: float) -> FloatMap:
    """Return a frame as it would be ``time`` frames earlier without the change of brightness."""
    if motion.brightening is None or time == 0:
        return still
    return np.asarray(still / (np.float32(1.0) + np.float32(time) * motion.brightening))


def taken_out(
    frames: Planes,
    times: Sequence[float],
    plan: PatternPlan,
    motion: Motion,
    saturation: float,
) -> list[FloatMap]:
    """Return frames as of a scene that stands still.

    Parameters
    ----------
    frames : (h, w) arrays in the order of the plan, counts
    times : one float per frame
        Time of each frame from that at which the scene is asked for, frames.
    plan : PatternPlan
    motion : Motion
        At that time.
    saturation : float
        Counts from which on a sample is not trusted. A pixel with such a sample keeps the samples
        of the set: their fit would be wrong.

    Returns
    -------
    list of (h, w) float32 arrays. The residuals of the fits stay in them, so that noise and errors
    can be judged. NaN where the motion undoes the phase steps. The cells of a Gray code are moved
    back across the image.
    """
    still = [moved_back(f, motion, t) for f, t in zip(frames, times, strict=True)]
    finest: dict[Axis, tuple[float, FloatMap, FloatMap]] = {}
    for first, block in phase_sets(plan):
        part = slice(first, first + block.frames)
        per_px = TURN / block.period_px
        moved = [motion.moved_px(block.axis, t) for t in times[part]]
        background, c, s, _ = fit_moving(still[part], block.shifts_rad, moved, per_px)
        if block.period_px < finest.get(block.axis, (np.inf,))[0]:
            finest[block.axis] = block.period_px, background, c + 1j * s
        lost = _lost(frames[part], still[part], saturation)
        _core.turn_back(still[part], _angles(block.shifts_rad, moved, per_px), c, s, lost)
    for first, code in plan.placed:
        if isinstance(code, GrayCode):
            for k in range(first, first + code.frames):
                away = motion.moved_px(code.axis, times[k])
                still[k] = _code_moved_back(still[k], away, *finest[code.axis])
    return still


def _lost(frames: Planes, still: list[FloatMap], saturation: float) -> BoolMap:
    """Mark pixels with a sample at the sensor's limit, whose samples are set to it."""
    lost = np.zeros(still[0].shape, bool)
    for frame, moved in zip(frames, still, strict=True):
        clipped = (frame >= saturation) | (moved >= saturation)
        moved[clipped] = saturation
        lost |= clipped
    return lost


def _code_moved_back(
    frame: FloatMap, moved_px: FloatMap, period_px: float, background: FloatMap, wave: FloatMap
) -> FloatMap:
    """Move the cells of a Gray code across the image to where they are without motion.

    A pattern at the coordinate u moves by −d ∇u/|∇u|² where the surface moves by d along the
    projector. The gradient is that of the finest fringes, c + i s, whose phase grows by 2π per
    period. Their background and modulation stand for the paint, which does not move with a pattern.
    """
    size = (CHANGE_WINDOW, CHANGE_WINDOW)
    wave = np.nan_to_num(wave)
    power = cv2.blur(np.abs(wave) ** 2, size)
    slopes = [cv2.blur((wave.conj() * np.gradient(wave, axis=k)).imag, size) for k in (1, 0)]
    with np.errstate(invalid="ignore", divide="ignore"):
        gradient = np.stack(slopes, axis=-1) * (period_px / TURN) / power[..., None]
        square = np.sum(gradient**2, axis=-1)
        shift = -moved_px[..., None] * gradient / square[..., None]
        known = (square > FLATTEST**2) & (np.abs(shift) < FARTHEST_PX).all(axis=-1)
        known &= (np.abs(shift) > NEAREST_PX).any(axis=-1)
        light = (frame - background) / np.abs(wave)
        known &= np.abs(light) < BRIGHTEST
    bounded = np.where(known[..., None], shift, 0.0).astype(np.float32)
    there = warped(np.where(known, light, 0.0), bounded, 1.0)
    known &= np.isfinite(there)
    return np.where(known, background + np.abs(wave) * there, frame).astype(np.float32)
