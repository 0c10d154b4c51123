"""Decoding of the same plan again and again, for live measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.plan import COLOURS, PatternPlan, repeats
from fringeworks.rig.depth_range import DepthRange, depth_range_of
from fringeworks.rig.epipolar import calibration_share
from fringeworks.rig.range_evidence import range_findings
from fringeworks.rig.triangulate import Triangulator, measured_points
from fringeworks.stack.colour_steps import unmix
from fringeworks.stack.decode import (
    checked_count_step,
    decodings_of,
    judge,
    kernels_of,
    limits_of,
    measured,
)
from fringeworks.stack.examine import Judgement
from fringeworks.stack.frames import Planes, check_frames, readable
from fringeworks.stack.gray_light import plan_with_light, with_light
from fringeworks.stack.options import DecodeOptions
from fringeworks.stack.order_words import in_words_of
from fringeworks.stack.refusal import causes_first, leave_out, without_lacking_axes
from fringeworks.types import (
    MOST_PX,
    Axis,
    ByteMap,
    CameraNoise,
    Decoded,
    Finding,
    FloatMap,
    FramesContradictPlan,
    InputError,
    PointCloud,
    Reason,
    Rig,
    RigMismatch,
    whole,
)
from fringeworks.types.finding import LEFT_OUT

JUDGE_EVERY = 25
"""Every so many stacks the frames are judged again: about once a second in live measurement."""
MORE_AMBIGUOUS = 1.5, 0.02
"""Factor and share: a stack is judged before its turn if its pixels with an ambiguous order exceed
the factor times those of the last judged stack, plus this share of all pixels. A scene that moves
between its frames has ambiguous orders everywhere. Empirical."""
UNMIXED_TOP = 1e5
"""Count of saturated samples in frames without crosstalk, whose noise is 1: no lit pixel has a
hundred thousand times its noise."""


class Decoder:
    """Decodes stacks of one plan, one size and one type, again and again.

    Tables and memory are kept. The frames of a stack are judged (their order, noise, real steps)
    on the first call and on every ``judge_every``-th after it; the stacks between are decoded with
    what was found, and σ of points is raised where neighbours scattered then. A stack in which many
    more fringe orders are ambiguous than in the last judged one, as when the scene moves between
    its frames, is judged at once.

    Parameters
    ----------
    plan : PatternPlan
    shape : (h, w), camera px
    dtype : type of the frames; any that ``decode`` takes
    rig : Rig, optional
        What ``points`` triangulates with.
    depth_mm : (near, far) or DepthRange, optional
        Smallest and largest z of the points, mm, as for ``measure``; with a rig. It resolves the
        fringe orders of plans that repeat.
    judge_every : int ≥ 1
    **options
        As for ``decode``. With ``colours``, the saturation is that of the photographs.

    Raises
    ------
    InputError
        If an option is out of its range, the plan or the response cannot be used, or a depth range
        comes without a rig.
    RigMismatch
        If the rig belongs to frames of another size.

    Examples
    --------
    >>> from fringeworks.patterns.encode import encode
    >>> from fringeworks.patterns.plan import PhaseSteps, equal_steps
    >>> plan = PatternPlan(64, 40, (PhaseSteps("x", 64.0, equal_steps(4)),))
    >>> decoder = Decoder(plan, (40, 64))
    >>> round(float(decoder.decode(list(encode(plan))).x.coordinate_px[10, 20]), 1)
    20.0
    """

    def __init__(
        self,
        plan: PatternPlan,
        shape: tuple[int, int],
        dtype: Any = np.uint8,
        *,
        rig: Rig | None = None,
        depth_mm: DepthRange | Sequence[float] | None = None,
        judge_every: int = JUDGE_EVERY,
        **options: Unpack[DecodeOptions],
    ) -> None:
        if len(shape) != 2 or not all(whole(n, 1, MOST_PX) for n in shape):
            raise InputError(f"shape: expected rows and columns, got {shape}")
        if judge_every < 1:
            raise InputError(f"judge_every: expected 1 or more, got {judge_every}")
        if options.get("estimate_response") and options.get("response") is not None:
            raise InputError("estimate_response: expected no response beside it, got one")
        if rig is not None and rig.camera.shape != tuple(shape):
            raise RigMismatch(f"rig: it is for frames of {rig.camera.shape}, got {tuple(shape)}")
        if rig is None and depth_mm is not None:
            raise InputError("depth_mm: expected together with a rig, got none")
        self._depth = None if rig is None else depth_range_of(depth_mm, rig)
        if self._depth is not None:
            options.setdefault("absolute", not repeats(plan))
        self._plan, self._shape, self._dtype = plan, (shape[0], shape[1]), np.dtype(dtype)
        self._photographs: float | None = options.get("saturation")
        """Saturation of the photographs of a plan with colours; the type's where None."""
        self._options = options = _of_frames(plan, options)
        self._judge_every, self._since = judge_every, 0
        self._nominal = decodings_of(
            plan_with_light(plan), options.get("absolute", True), options.get("response")
        )
        self._limits = limits_of(
            np.dtype(np.float32) if plan.colours else self._dtype,
            options.get("saturation"),
            options.get("min_modulation", 0.0),
        )
        checked_count_step(options.get("count_step"))
        self._triangulator = None if rig is None else Triangulator(rig)
        self._found: Judgement | None = None
        self._judged, self._ambiguous = False, 0
        self._raised: dict[Axis, FloatMap] = {}
        self._windows: dict[Axis, bool] = {}  # whether they vote, by the last judged stack
        self._left_out: set[Axis | None] = set()
        """Axes of which hardly a pixel can be measured."""
        self._kernels: dict[Axis, _core.DecodeSettings] = {}
        self._typical_px: dict[Axis, float] = {}
        self._epipolar_px = 0.0
        self._factors: FloatMap | None = None
        self._decoded: Decoded | None = None
        self._cloud: PointCloud | None = None

    _of_range: tuple[Finding, ...] = ()
    """What the points of the last judged stack say of the depth range's periods."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the last judgement found; empty before the first stack."""
        return () if self._found is None else (*self._found.findings, *self._of_range)

    @property
    def epipolar_px(self) -> float:
        """Standard deviation of the epipolar error that the rig causes, px, by the last judgement
        of frames along both axes; 0 along one."""
        return self._epipolar_px

    @property
    def judged(self) -> bool:
        """Whether the last stack was judged."""
        return self._judged

    def judge_next(self) -> None:
        """Have the next stack judged, for example because the scene or the light has changed."""
        self._since = 0

    def decode(self, frames: NDArray[Any] | Sequence[NDArray[Any]]) -> Decoded:
        """Decode one stack.

        Parameters
        ----------
        frames : (n, h, w) array or sequence of (h, w) arrays, counts
            In the order of the plan. Photographs (h, w, 3) for a plan with ``colours``, as for
            ``unmix``.

        Returns
        -------
        Decoded
            In memory of the decoder: valid until its next call. With a depth range, coordinates
            are absolute, and those outside of it are NaN.

        Raises
        ------
        InputError
            If frames are missing or differ from the decoder's size or type; where a stack is
            judged, also if ``decode`` would refuse it.
        """
        planes = self._checked(frames)
        decoded = self._coordinates(planes)
        if self._suspects(*(found.reason for found in decoded.maps.values())):
            self.judge_next()
            decoded = self._coordinates(planes)
        return decoded

    def points(self, frames: NDArray[Any] | Sequence[NDArray[Any]]) -> PointCloud:
        """Measure the points of one stack.

        Frames become points in one pass. The result is that of ``decode`` and of triangulation with
        this decoder's ``epipolar_px``, to the bit, but for σ where neighbours scatter: between
        judged stacks, it is raised as in the last judged one, pixel by pixel.

        Parameters
        ----------
        frames : as for ``decode``

        Returns
        -------
        PointCloud in camera coordinates, in memory of the decoder: valid until its next call.

        Raises
        ------
        InputError as for ``decode``, and for a decoder without a rig; RigMismatch as for
        ``triangulate``.
        """
        if self._triangulator is None:
            raise InputError("rig: expected one for points, got none")
        planes = self._checked(frames)
        cloud = self._points(planes, self._triangulator)
        if self._suspects(cloud.reason):
            self.judge_next()
            cloud = self._points(planes, self._triangulator)
        if self._judged:
            # Triangulation gives each pixel one reason of its two axes: clouds compare with clouds.
            self._ambiguous = _ambiguous([cloud.reason])
        return cloud

    def _points(self, planes: Planes, triangulator: Triangulator) -> PointCloud:
        """Measure the points of checked frames."""
        found = self._found
        whole = found is not None and _in_one_pass(found) and not self._left_out
        if self._since == 0 or self._depth or not whole:
            judged = self._since == 0
            decoded = self._coordinates(planes, steady=True)
            self._cloud = triangulator.triangulate(
                decoded, epipolar_px=self._epipolar_px, out=self._cloud
            )
            if judged:
                self._factors = self._scatter(planes, triangulator, self._cloud)
                assert self._decoded is not None
                self._of_range = range_findings(self._cloud, decoded, self._decoded, self._depth)
            if self._of_range:
                told = (*self._cloud.findings, *self._of_range)
                return replace(self._cloud, findings=told)
        else:
            self._count(judged=False)
            self._cloud = self._one_pass(planes, triangulator, self._cloud, self._factors)
        return self._cloud

    def _one_pass(
        self,
        planes: Planes,
        triangulator: Triangulator,
        out: PointCloud | None,
        factors: FloatMap | None,
    ) -> PointCloud:
        """Measure the points of checked frames by what was found, without maps of coordinates."""
        assert self._found is not None
        removes = self._options.get("remove_isolated", True)
        return measured_points(
            triangulator,
            {
                axis: ([readable(planes[k]) for k in a.decoding.frames], self._kernels[axis])
                for axis, a in self._found.axes.items()
            },
            typical_px=self._typical_px if removes else None,
            epipolar_px=self._epipolar_px,
            findings=self.findings,
            out=out,
            factors=factors,
        )

    def _scatter(
        self, planes: Planes, triangulator: Triangulator, judged: PointCloud
    ) -> FloatMap | None:
        """By how much neighbours raise the noise of every pixel of a judged stack, (h, w); None
        where they do not, or where points are not measured in one pass."""
        found = self._found
        if found is None or self._depth or self._left_out or not _in_one_pass(found):
            return None
        raising = (
            a.scatters or a.edges or a.blurred or a.pull_px or a.most_blur_px2
            for a in found.axes.values()
        )
        if not any(raising):
            return None
        plain = self._one_pass(planes, triangulator, None, None)
        with np.errstate(invalid="ignore", divide="ignore"):
            factors = np.maximum(judged.noise_mm / plain.noise_mm, np.float32(1.0))
        known = np.isfinite(factors)
        if not known.any():
            return None
        # Pixels that were not measured then: as much as the others in the mean square.
        factors[~known] = np.sqrt(np.mean(factors[known].astype(np.float64) ** 2))
        return factors

    def _suspects(self, *reasons: ByteMap) -> bool:
        """Whether a stack that was not judged has many more ambiguous orders than the last one that
        was."""
        if self._judged:
            return False
        factor, share = MORE_AMBIGUOUS
        return _ambiguous(reasons) > factor * self._ambiguous + share * reasons[0].size

    def _checked(self, frames: NDArray[Any] | Sequence[NDArray[Any]]) -> Planes:
        colours = self._plan.colours
        planes = list(frames) if colours else check_frames(frames, self._plan)
        shape = (*self._shape, COLOURS) if colours else self._shape
        if planes and (planes[0].shape != shape or planes[0].dtype.name != self._dtype.name):
            raise FramesContradictPlan(
                f"frames: the decoder is for {self._dtype} {shape}, got {planes[0].dtype} "
                f"{planes[0].shape}"
            )
        return with_light(self._unmixed(planes) if colours else planes, self._plan)[0]

    def _unmixed(self, photographs: Sequence[NDArray[Any]]) -> Planes:
        """Frames without crosstalk, saturated where a photograph is."""
        stack = unmix(photographs, self._plan, saturation=self._photographs)
        assert stack.saturation is not None
        top = np.float32(UNMIXED_TOP)
        return [np.where(frame < stack.saturation, frame, top) for frame in stack.frames]

    def _coordinates(self, planes: Planes, *, steady: bool = False) -> Decoded:
        """Decode checked frames, and judge them where it is time to. ``steady``: between judged
        stacks σ is raised where neighbours scattered in the last judged one."""
        if self._since == 0:
            self._judge(planes)
            self._raised, self._windows = {}, {}
        assert self._found is not None
        options = self._options
        keeps_phases = options.get("keep_phases", False)
        self._decoded = measured(
            planes,
            self._found,
            self._kernels,
            self._typical_px,
            keep_phases=keeps_phases,
            remove_isolated=options.get("remove_isolated", True),
            keep_blur=options.get("keep_blur", False),
            raised=self._raised if steady else None,
            windows=self._windows,
            out=None if keeps_phases else self._decoded,
        )
        judged = self._since == 0
        if judged:
            with causes_first(self._found.findings):
                self._decoded = without_lacking_axes(self._decoded, self._found.axes)
            left_out = {f.axis for f in self._decoded.findings if f.kind == LEFT_OUT}
            if left_out != self._left_out:
                self._left_out, self._cloud = left_out, None  # points of other axes
        for axis in self._left_out:
            if not judged and axis is not None:
                leave_out(self._decoded.maps[axis])
        decoded = self._decoded if self._depth is None else self._depth.resolve(self._decoded)
        if judged:
            maps = decoded.maps
            if self._triangulator is not None and len(maps) == 2 and not self._left_out:
                self._epipolar_px = calibration_share(self._triangulator.rig, maps)
            self._ambiguous = _ambiguous([found.reason for found in maps.values()])
        self._count(judged=judged)
        return decoded

    def _count(self, *, judged: bool) -> None:
        """Count a stack that was measured."""
        self._judged = judged
        self._since = (self._since + 1) % self._judge_every

    def _judge(self, planes: Planes) -> None:
        """Judge a stack and keep what was found."""
        options = self._options
        with in_words_of(self._plan):
            self._found = judge(
                planes,
                plan_with_light(self._plan),
                self._nominal,
                self._limits,
                noise=options.get("noise"),
                count_step=options.get("count_step"),
                estimate_steps=options.get("estimate_steps", True),
                estimate_response=options.get("estimate_response", False),
            )
        self._kernels = kernels_of(self._found)
        self._typical_px = {}


def _of_frames(plan: PatternPlan, options: DecodeOptions) -> DecodeOptions:
    """Options for the frames of a plan: those without crosstalk have a noise of 1 count, whatever
    that of the photographs."""
    if not plan.colours:
        return options
    return {"noise": CameraNoise(1.0), **options, "saturation": UNMIXED_TOP}


def _ambiguous(reasons: Sequence[ByteMap]) -> int:
    """Number of pixels whose fringe order is ambiguous along any axis."""
    ambiguous = reasons[0] == Reason.ORDER_AMBIGUOUS
    for reason in reasons[1:]:
        ambiguous |= reason == Reason.ORDER_AMBIGUOUS
    return int(np.count_nonzero(ambiguous))


def _in_one_pass(found: Judgement) -> bool:
    """Whether no step between decoding and triangulation changes coordinates or reasons by whole
    maps. What neighbours show of the scatter only raises σ."""
    return not any(axis.uneven or axis.votes or axis.blurred for axis in found.axes.values())
