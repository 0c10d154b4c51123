"""Decoding of sequences: a coordinate map for every frame of a scene that moves."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.decode import (
    checked_count_step,
    compare_neighbours,
    coordinate_map,
    decodings_of,
    limits_of,
    measure_axis,
    typical_step,
)
from fringeworks.stack.examine import Judgement, examine
from fringeworks.stack.frames import Planes, check_frame, refuse_constant, step_of
from fringeworks.stack.gray_light import plan_with_light, with_light
from fringeworks.stack.kernel_settings import Limits, empty_maps
from fringeworks.stack.motion import Motion, moment_of, taken_out
from fringeworks.stack.motion_search import motion_between
from fringeworks.stack.motion_track import MotionTrack
from fringeworks.stack.motion_words import of_motion, unsteady
from fringeworks.stack.order_tracking import expected_later, track_orders
from fringeworks.stack.sample import take_sample
from fringeworks.types import (
    Axis,
    CameraNoise,
    CoordinateMap,
    Decoded,
    Finding,
    FloatMap,
    FramesContradictPlan,
    Frozen,
    InputError,
    Reason,
    explained,
    unmasked,
)

MOST_CONTRADICTING = 2
"""Cycles of the plan during which frames may contradict it, as when a hand crosses the scene:
nothing is measured then."""
FEWEST_CYCLES = 2
"""Cycles of the plan that a sequence needs: motion shows between two of them."""
JUDGED_CYCLES = 0.5
"""Distance of the moments whose frames are judged anew, cycles of the plan. Two such moments have
all frames of those between, which need no judgement of their own where both agree with the plan."""

REMEMBERED = 6
"""Judgements that are remembered: those of three cycles, two in each."""


@dataclass(frozen=True, eq=False, repr=False)
class Moment(Frozen):
    """A scene at one moment of a sequence."""

    decoded: Decoded
    """Coordinates at this moment, of the frames around it."""
    motion: Motion
    """How the scene moves at this moment; velocities are NaN where nothing was measured."""
    time_frames: float
    """The moment, in frames from the first one of the sequence: the time of the middle one of its
    frames, or of the later of two."""
    first_frame: int
    """Index in the sequence of the first of its frames, which are as many as the plan's."""


class SequenceOptions(TypedDict, total=False):
    """Keyword options of ``decode_sequence``; each is explained there."""

    noise: CameraNoise | None
    saturation: float | None
    count_step: float | None
    min_modulation: float
    every: int


def decode_sequence(
    frames: Iterable[NDArray[Any]], plan: PatternPlan, **options: Unpack[SequenceOptions]
) -> Iterator[Moment]:
    """Decode a scene that moves while the frames of a plan are projected over and over.

    Parameters
    ----------
    frames : iterable of (h, w) arrays, counts
        uint8, uint16, float32 or float64. Frame k shows pattern k modulo the plan's number of
        frames. They are read as they are needed.
    plan : PatternPlan
        With fringes along each of its axes.
    noise : CameraNoise, optional
        Noise of the camera; measured from the first cycle where not given.
    saturation, count_step, min_modulation
        As for ``decode``.
    every : int ≥ 1
        Moments are this many frames apart. By default there is one for each frame: every block of
        the plan, such as a set of steps, is replaced by the next one when that is nearer.

    Yields
    ------
    Moment, in the order of time. Those of the last two cycles come when the frames end.

    Raises
    ------
    InputError
        If there are fewer than two cycles of frames, or a frame differs in size or type from the
        first, or they contradict the plan.

    Notes
    -----
    Motion is found between successive cycles (see ``motion_between``) and within the sets of four
    steps or more. How surfaces move between is a random function of time, whose spectrum these
    observations determine at each part of the image (see ``MotionPath``). What they do not
    determine is part of the standard deviations, and is named by a finding. Frames are moved back
    across the image, and the phases of what approaches or recedes are turned back, by as much as
    the surface has moved between the frame and the moment. Sets whose frames then still disagree
    have larger standard deviations there. Binomial weights of successive phases (image-sequential
    binomial self-compensation) suppress the same ripple, but need equal steps without other frames
    between them; this works for every plan.

    Orders that the plan alone leaves ambiguous come from the moment before, and orders that
    contradict it need neighbours on their surface.

    Examples
    --------
    >>> from fringeworks.patterns.encode import encode
    >>> from fringeworks.patterns.plan import PhaseSteps, equal_steps
    >>> plan = PatternPlan(64, 40, (PhaseSteps("x", 64.0, equal_steps(4)),))
    >>> moments = list(decode_sequence([*encode(plan), *encode(plan)], plan))
    >>> [moment.time_frames for moment in moments]
    [2.0, 3.0, 4.0, 5.0, 6.0]
    """
    decoder = SequenceDecoder(plan, **options)
    for frame in frames:
        yield from decoder.add(frame)
    yield from decoder.finish()


@dataclass(frozen=True)
class _Still:
    """The frames of a moment as of a scene that stands still."""

    planes: Planes
    lit: PatternPlan
    """The plan whose frames they are."""
    motion: Motion
    """What was taken out."""


def check_every(every: int) -> None:
    """Refuse distances of moments that are no whole number of frames."""
    if isinstance(every, bool) or not isinstance(every, int | np.integer) or every < 1:
        raise InputError(f"every: expected a whole number of 1 or more frames, got {every!r}")


class SequenceDecoder:
    """Decode a sequence whose frames arrive one by one; see ``decode_sequence``.

    Parameters
    ----------
    plan : PatternPlan
    **options
        As for ``decode_sequence``.

    Raises
    ------
    InputError for a plan without fringes along one of its axes, and options out of range;
    ``saturation`` and ``min_modulation`` are checked with the first two cycles.
    """

    def __init__(
        self,
        plan: PatternPlan,
        *,
        noise: CameraNoise | None = None,
        saturation: float | None = None,
        count_step: float | None = None,
        min_modulation: float = 0.0,
        every: int = 1,
    ) -> None:
        for axis in plan.axes:
            if not plan.phase_sets(axis):
                raise InputError(f"sequence: expected fringes along {axis}, got Gray code only")
        if plan.order != tuple(range(plan.frames)):
            raise InputError(
                "sequence: expected a plan without least_first, inverses_last and bits_in_turn, "
                "whose bits come from the most significant one on, got one with another order"
            )
        check_every(every)
        self._plan, self._labels = plan, plan.labels()
        lit = plan_with_light(plan)
        self._decodings, self._lit_labels = decodings_of(lit, True, None), lit.labels()
        self._noise, self._every = noise, int(every)
        self._saturation, self._min_modulation = saturation, min_modulation
        self._count_step = checked_count_step(count_step)
        self._frames: deque[NDArray[Any]] = deque()
        self._base = 0
        """Index of the first frame that is kept."""
        self._next = 0
        """First frame of the next moment."""
        self._track = MotionTrack(plan)
        self._tracked: dict[Axis, tuple[int, FloatMap]] = {}
        """The last coordinates, and the first frame of their moment."""
        self._judgement: tuple[int, Judgement] | None = None
        """The last one that agreed with the plan, and the first frame of its moment."""
        self._between = (-1, -1)
        """First frames of two moments that are judged; those between take the nearer judgement."""
        self._ends: dict[int, Judgement | None] = {}
        """The judgements of both; None where the frames contradict the plan."""
        self._judged_at: deque[tuple[int, Judgement]] = deque(maxlen=REMEMBERED)
        """The last judgements, with the first frames of their moments."""
        self._ready: dict[int, _Still] = {}
        """Frames of moments to come that were judged."""

    @property
    def _count(self) -> int:
        return self._base + len(self._frames)

    def add(self, frame: NDArray[Any]) -> Iterator[Moment]:
        """Add the next frame; yield the moments that can be decoded with it.

        A generator: the frame is added when it is iterated, as in ``for moment in add(frame)``.

        Raises
        ------
        InputError for frames of another size or type, constant ones, and contradictions to the
        plan.
        """
        cycle = self._plan.frames
        frame = unmasked(frame, "frame")
        label = f"{self._count} ({self._labels[self._count % cycle]})"
        like = self._frames[0] if self._frames else frame
        check_frame(frame, label, like.shape, like.dtype)
        refuse_constant(frame, label, frame[:1])
        own = np.array(frame, frame.dtype.newbyteorder("="), order="C")
        if own.dtype.kind == "f":
            own[np.isinf(own)] = np.nan
        self._frames.append(own)
        if self._count % cycle == 0 and self._count >= FEWEST_CYCLES * cycle:
            try:
                self._add_pair()
            except FramesContradictPlan as error:
                first = self._count - FEWEST_CYCLES * cycle
                # The earlier moments need no later cycle. Those of the last two cycles may
                # contain what is wrong.
                if self._track.pairs:
                    yield from self._moments(first)
                raise error.at(f"frames {first} to {self._count - 1}") from error
            # A moment lies between the middles of two pairs of cycles.
            if self._track.pairs > 1:
                yield from self._moments((self._track.pairs - 1) * cycle + cycle // 2)

    def finish(self) -> Iterator[Moment]:
        """Yield the moments that are left, when no more frames come.

        Raises
        ------
        FramesContradictPlan for fewer than two cycles of frames.
        """
        cycle = self._plan.frames
        if not self._track.pairs:
            raise FramesContradictPlan(
                f"sequence: expected {FEWEST_CYCLES} cycles of {cycle} frames or more, "
                f"got {self._count} frames"
            )
        yield from self._moments(self._count - cycle)

    def _add_pair(self) -> None:
        cycle = self._plan.frames
        start = self._count - FEWEST_CYCLES * cycle
        one, other = self._cut(start), self._cut(start + cycle)
        if self._noise is None:
            # Motion across the image is told from noise, which is measured where the other motion
            # is taken out.
            along, _ = motion_between(one, other, self._plan, np.inf)
            times = [k + 0.5 - cycle for k in range(cycle)]
            still = taken_out(one, times, self._plan, along, self._limits.saturation)
            self._noise = self._judged(*with_light(still, self._plan)).noise
        level = float(np.mean([frame.mean() for frame in one]))
        noise = float(self._noise.variance(level)) ** 0.5
        self._track.add(one, other, noise)

    def _cut(self, start: int) -> Planes:
        """The frames of one cycle from a frame on, in the order of the sequence."""
        at = start - self._base
        return [self._frames[at + k] for k in range(self._plan.frames)]

    @property
    def _limits(self) -> Limits:
        return limits_of(self._frames[0].dtype, self._saturation, self._min_modulation)

    def _moments(self, last: int) -> Iterator[Moment]:
        """Decode the moments up to that whose first frame is ``last``; forget what is done."""
        while self._next <= last:
            yield self._moment(self._next, last)
            self._next += self._every
        cycle = self._plan.frames
        # The next pair of cycles begins with the last whole one.
        keep = min(self._next - cycle, (self._count // cycle - 1) * cycle)
        while self._base < keep:
            self._frames.popleft()
            self._base += 1

    def _moment(self, start: int, last: int) -> Moment:
        judged, agrees = self._judgement_of(start, last)
        still = self._still(start)
        del self._ready[start]
        motion = still.motion
        maps = {
            axis: self._map(axis, still.planes, judged, motion if agrees else None)
            for axis in self._plan.axes
        }
        velocity = {
            axis: np.where(np.isfinite(found.coordinate_px), motion.velocity_px[axis], np.nan)
            for axis, found in maps.items()
        }
        decoded = Decoded(
            x=maps.get("x"),
            y=maps.get("y"),
            noise=judged.noise,
            findings=(*self._findings(judged), *self._unsteady(maps, motion)),
            details=judged.details,
        )
        time = float(moment_of(start, self._plan.frames))
        return Moment(decoded, replace(motion, velocity_px=velocity), time, start)

    def _still(self, start: int) -> _Still:
        """The frames of a moment without their motion; kept until its map is made."""
        if start not in self._ready:
            middle = moment_of(start, self._plan.frames)
            order = self._nearest(start + 0.5 * (self._plan.frames - 1))
            motion = self._track.at(start, order)
            planes = [self._frames[k - self._base] for k in order]
            times = [k - middle for k in order]
            planes = taken_out(planes, times, self._plan, motion, self._limits.saturation)
            self._ready[start] = _Still(*with_light(planes, self._plan), motion)
        return self._ready[start]

    def _unsteady(self, maps: dict[Axis, CoordinateMap], motion: Motion) -> list[Finding]:
        """Findings about motion that the frames do not tell."""
        found = [
            unsteady(maps[axis], sigma, self._track.vibrations(axis), self._plan.frames)
            for axis, sigma in motion.path_sigma_px.items()
        ]
        return [finding for finding in found if finding is not None]

    def _nearest(self, middle: float) -> list[int]:
        """Frames of the plan's patterns, those of a block together, nearest to a time.

        Between the frames of one block that are a cycle apart, motion could undo the steps.
        """
        cycle = self._plan.frames
        order = []
        for first, block in self._plan.placed:
            away = middle - first - 0.5 * (block.frames - 1)
            latest = (self._count - first - block.frames) // cycle
            turn = min(max(int(np.ceil(away / cycle - 0.5)), 0), latest)
            order += [turn * cycle + first + k for k in range(block.frames)]
        return order

    def _judgement_of(self, start: int, last: int) -> tuple[Judgement, bool]:
        """The judgement of a moment, and whether its frames agree with the plan.

        ``last`` is the first frame of the last moment whose motion is known.
        """
        if start > self._between[1]:
            first = self._between[1] if start - self._every == self._between[1] else start
            reach = max(int(JUDGED_CYCLES * self._plan.frames) // self._every, 1) * self._every
            ahead = (last - first) // self._every * self._every
            self._between = first, first + min(reach, ahead)
            self._ends = {k: found for k, found in self._ends.items() if k == first}
        for end in self._between:
            if end not in self._ends:
                self._ends[end] = self._quietly(end)
        found = [self._ends[end] for end in self._between]
        first, after = self._between
        nearer = found[start - first > after - start]
        if None in (found if first < start < after else [nearer]):
            return self._beside(start, last) or self._latest(start)
        assert nearer is not None
        self._judgement = start, nearer
        return nearer, True

    def _quietly(self, start: int) -> Judgement | None:
        """The judgement of a moment; None where its frames contradict the plan."""
        try:
            still = self._still(start)
            judged = self._judged(still.planes, still.lit)
        except FramesContradictPlan:
            return None
        self._judged_at.append((start, judged))
        return judged

    def _findings(self, judged: Judgement) -> tuple[Finding, ...]:
        """The findings of a judgement; those on steps also by the judgements of other cycles."""
        starts = [start for start, one in self._judged_at if one is judged]
        if not starts:
            return judged.findings
        cycle = self._plan.frames
        others = [one for start, one in self._judged_at if abs(start - starts[0]) >= cycle]
        return of_motion(judged, others, self._lit_labels)

    def _beside(self, start: int, last: int) -> tuple[Judgement, bool] | None:
        """The judgement of the moment before, if one after it agrees with the plan too and both
        hold all frames of this one: motion alone makes its frames contradict each other."""
        before = self._judgement
        if before is None or before[0] < start - self._every:
            return None
        # Moments whose motion is not known well yet serve as well.
        farthest = min(self._count - self._plan.frames, before[0] + self._plan.frames)
        for later in range(start + self._every, farthest + 1, self._every):
            agrees = self._quietly(later) is not None
            if later > last:
                self._ready.pop(later, None)
            if agrees:
                self._judgement = start, before[1]
                return before[1], True
        return None

    def _latest(self, start: int) -> tuple[Judgement, bool]:
        """The own judgement of a moment, and whether its frames agree with the plan.

        Where they do not, as when something crosses the scene, it is the last one. Frames that
        contradict the plan for longer are others than those expected: one was lost.
        """
        try:
            still = self._still(start)
            judged = self._judged(still.planes, still.lit)
        except FramesContradictPlan as error:
            longest = MOST_CONTRADICTING * self._plan.frames
            if self._judgement is None or start - self._judgement[0] > longest:
                last = start + self._plan.frames - 1
                before = () if self._judgement is None else self._judgement[1].findings
                raise explained(error.at(f"frames {start} to {last}"), before) from error
            return self._judgement[1], False
        self._judgement = start, judged
        return judged, True

    def _judged(self, planes: Planes, lit: PatternPlan) -> Judgement:
        """Judge the frames of a moment by a sample."""
        step = self._count_step
        return examine(
            lit,
            take_sample(planes, lit),
            self._decodings,
            self._limits,
            noise=self._noise,
            count_step=step_of(self._frames[0].dtype) if step is None else step,
            estimate_steps=True,
            estimate_response=False,
            moves=True,
        )

    def _map(
        self,
        axis: Axis,
        planes: Planes,
        judged: Judgement,
        motion: Motion | None,
    ) -> CoordinateMap:
        """Decode an axis; nothing of it where the motion is not known."""
        found = judged.axes[axis]
        # Errors of a scene that moves differ from place to place: each place is judged by its own.
        decoding = replace(found.decoding, order_errors=(), largest_remainders=())
        found = replace(found, decoding=decoding, uneven=True, scatters=True)
        results = empty_maps(planes[0].shape, sets=len(decoding.sets))
        measure_axis([planes[k] for k in decoding.frames], found, judged, results)
        if motion is None:
            results["coordinate"][...] = results["sigma"][...] = np.nan
            results["reason"][results["reason"] == Reason.OK] = Reason.ORDER_AMBIGUOUS
            return coordinate_map(decoding, results, False)
        expected = None
        if axis in self._tracked:
            before, coordinate = self._tracked[axis]
            expected = expected_later(coordinate, motion, axis, self._next - before)
        track_orders(results, decoding, judged.noise, expected, motion.flow_px)
        compare_neighbours(found, results, typical_px=typical_step(found, results))
        if axis in motion.path_sigma_px:
            # The coordinate is moved from the times of its sets to the moment.
            results["sigma"][...] = np.hypot(results["sigma"], motion.path_sigma_px[axis])
        self._tracked[axis] = self._next, results["coordinate"]
        # Frames are moved back, so that some pixels would be seen beyond the border.
        if motion.flow_px is not None:
            gone = (results["reason"] == Reason.MASKED) & np.isnan(np.sum(planes, axis=0))
            results["reason"][gone & motion.flow_px.any(axis=-1)] = Reason.OUTSIDE
        return coordinate_map(decoding, results, False)
