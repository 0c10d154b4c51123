"""Decoding of a stack of frames into projector coordinates, at once or frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps
from fringeworks.signal.response import Response
from fringeworks.stack.examine import Findings, examine
from fringeworks.stack.frames import (
    Planes,
    check_content,
    check_frame,
    check_frames,
    in_bands,
    refuse_constant,
    sample_of,
    sampled_places,
    saturation_of,
)
from fringeworks.stack.kernel_settings import (
    RESULTS,
    Decoding,
    Limits,
    check_reusable,
    decoding_of,
    empty_maps,
    reused_maps,
)
from fringeworks.types import (
    Axis,
    CameraNoise,
    CoordinateMap,
    Decoded,
    FloatMap,
    FramesContradictPlan,
    InputError,
    sealed,
)

PATCH = 256
"""Side of the patch that spatial noise is measured in, px.

Its 65 000 second differences determine the noise to better than 1 %. An empirical choice.
"""

PATCH_FRAMES = 3
"""Number of frames whose patches are used; more hardly improve the result. Empirical."""


def decode(
    frames: NDArray[Any] | Sequence[NDArray[Any]],
    plan: PatternPlan,
    *,
    noise: CameraNoise | None = None,
    saturation: float | None = None,
    min_modulation: float = 0.0,
    absolute: bool = True,
    response: Response | None = None,
    estimate_steps: bool = False,
    keep_phases: bool = False,
    remove_isolated: bool = True,
    out: Decoded | None = None,
) -> Decoded:
    """Decode the projector coordinate of every camera pixel, with its standard deviation.

    Parameters
    ----------
    frames : (n, h, w) array or sequence of (h, w) arrays, counts
        uint8, uint16, float32 or float64 in the order of the plan, with any strides, also
        memory-mapped. They are not changed.
    plan : PatternPlan
        The patterns that were projected.
    noise : CameraNoise, optional
        Noise of the camera; measured from the frames where not given.
    saturation : float > 0, optional
        Counts from which on a sample is left out of the fit. The default for integers is the type's
        largest value, unless samples only touch it, as with patterns that exactly fill the range.
        The default for floats is no limit. A 12-bit camera in 16-bit files has 4095.
    min_modulation : float ≥ 0
        Modulation below which a pixel is not used, counts.
    absolute : bool
        False for coordinates modulo the distance after which the phases repeat, for plans whose
        unambiguous range is shorter than the projector.
    response : Response, optional
        Response that the wrapped phases are corrected for. The plan must have equal steps, as many
        as the response.
    estimate_steps : bool
        Whether to estimate the real phase shifts from the frames (``estimate_shifts``).
    keep_phases : bool
        Whether to return wrapped phase and modulation of every set.
    remove_isolated : bool
        Whether to set pixels to NaN, with ``ISOLATED``, whose coordinate fits no surface through
        their neighbours. Most of them see two depths, at an edge.
    out : Decoded, optional
        An earlier result of the same size. Its maps are overwritten and returned, which saves the
        time for new memory in live measurement.

    Returns
    -------
    Decoded
        Maps of shape (h, w) for each axis of the plan, and the noise.

    Raises
    ------
    InputError
        If frames are missing, differ in size or type, are constant or contradict the plan, for
        example because two are swapped; or if the plan does not determine the fringe orders.

    Notes
    -----
    Every pixel is a least-squares fit of I_n = A + B cos(φ − δ_n) (Bruning et al., Applied Optics
    13, 1974; Greivenkamp, Optical Engineering 23, 1984). The plan's chain of roundings resolves the
    fringe orders (``patterns.order_chain``). The coordinate is the inverse-variance mean of all
    sets. Its σ follows from the camera's noise and the modulation, σ_φ² = (2/N) σ²/B² for equal
    steps (theory §5, §9). If the sets disagree by more than their noise, σ is raised by that
    factor. A pixel is NaN with ``ORDER_AMBIGUOUS`` where a rounding has a margin of less than five
    standard deviations or its sets disagree. It is NaN with ``ISOLATED`` where fewer than three of
    its eight neighbours share its surface, as in pixels that see two depths.

    Examples
    --------
    >>> from fringeworks.patterns.encode import encode
    >>> from fringeworks.patterns.plan import equal_steps
    >>> plan = PatternPlan(64, 40, (PhaseSteps("x", 64.0, equal_steps(4)),))
    >>> decoded = decode(list(encode(plan)), plan)
    >>> round(float(decoded.x.coordinate_px[10, 20]), 1)
    20.0
    """
    planes = check_frames(frames, plan)
    if out is not None:
        check_reusable(out, plan.axes, planes[0].shape, keep_phases)
    places = sampled_places(planes[0].shape, plan)
    sample = [sample_of(plane, places) for plane in planes]
    check_content(planes, plan, sample)
    limits = _limits(planes[0].dtype, saturation, min_modulation)
    findings = examine(
        plan,
        sample,
        _decodings(plan, absolute, response),
        limits,
        noise=noise,
        patch=_patch(planes, plan),
        estimate_steps=estimate_steps,
    )
    maps = {}
    for axis, decoding in findings.decodings.items():
        kernel = decoding.kernel(findings.noise, findings.limits)
        sets = len(decoding.sets) if keep_phases else 0
        results = empty_maps(planes[0].shape, sets=sets) if out is None else reused_maps(out, axis)
        axis_planes = [planes[k] for k in decoding.frames]
        in_bands(axis_planes, results, partial(_run, kernel))
        maps[axis] = _coordinate_map(decoding, results, keep_phases, remove_isolated)
    return _decoded(maps, findings)


def _run(kernel: _core.DecodeSettings, planes: Planes, maps: dict[str, Any]) -> None:
    """Call the kernel with the arguments in the order that ``in_bands`` needs."""
    _core.decode_frames(planes, kernel, maps)


class StreamingDecoder:
    """Decode the frames of a plan as they arrive, with the same result as ``decode``.

    The decoder keeps sums of each set instead of its frames. It keeps the frames of a Gray code.

    Parameters
    ----------
    plan, noise, saturation, min_modulation, absolute, response, keep_phases, remove_isolated
        As for ``decode``.

    Raises
    ------
    InputError
        If ``min_modulation`` is negative, or the plan or the response cannot be used.

    Examples
    --------
    >>> from fringeworks.patterns.encode import encode
    >>> from fringeworks.patterns.plan import equal_steps
    >>> plan = PatternPlan(64, 40, (PhaseSteps("x", 64.0, equal_steps(4)),))
    >>> stream = StreamingDecoder(plan)
    >>> for picture in encode(plan):
    ...     stream.add(picture)
    >>> round(float(stream.result().x.coordinate_px[10, 20]), 1)
    20.0
    """

    def __init__(
        self,
        plan: PatternPlan,
        *,
        noise: CameraNoise | None = None,
        saturation: float | None = None,
        min_modulation: float = 0.0,
        absolute: bool = True,
        response: Response | None = None,
        keep_phases: bool = False,
        remove_isolated: bool = True,
    ) -> None:
        self._plan = plan
        self._noise = noise
        self._saturation = saturation
        self._min_modulation = _not_negative(min_modulation)
        self._keep_phases = keep_phases
        self._remove_isolated = remove_isolated
        self._decodings = _decodings(plan, absolute, response)
        self._labels = plan.labels()
        self._fringes = any(isinstance(block, PhaseSteps) for block in plan.blocks)
        self._sums: dict[Axis, _core.StreamSums] = {}
        self._first: NDArray[Any] | None = None
        self._kept: dict[int, NDArray[Any]] = {}
        self._sample: list[NDArray[Any]] = []
        self._patch: list[FloatMap] = []

    @property
    def missing(self) -> list[str]:
        """Labels of the frames that have not arrived yet."""
        return self._labels[len(self._sample) :]

    def add(self, frame: NDArray[Any]) -> None:
        """Add the next frame of the plan.

        Parameters
        ----------
        frame : (h, w) array of uint8, uint16, float32 or float64, counts

        Raises
        ------
        InputError
            If all frames have arrived, or the frame differs from the first in size or type, or is
            constant where the plan has fringes or Gray code.
        """
        frame = np.asarray(frame)
        index = len(self._sample)
        if index == len(self._labels):
            raise FramesContradictPlan(f"frames: the plan has {len(self._labels)}, got one more")
        check_frame(frame, self._labels[index], frame if self._first is None else self._first)
        sampled = sample_of(frame, sampled_places(frame.shape, self._plan))
        block = next(b for k, b in reversed(self._plan.placed) if k <= index)
        if isinstance(block, PhaseSteps | GrayCode):
            refuse_constant(frame, self._labels[index], sampled)
        kind = np.float32 if frame.dtype == np.float64 else frame.dtype
        readable = np.ascontiguousarray(frame, kind)
        if self._first is None:
            # Later frames are compared with its size and type, which need no memory for its pixels.
            self._first = np.broadcast_to(frame[:1, :1], frame.shape)
        if isinstance(block, PhaseSteps):
            self._add_phase(readable, index)
        if isinstance(block, PhaseSteps) == self._fringes and len(self._patch) < PATCH_FRAMES:
            self._patch.append(_middle(frame))
        if any(index in decoding.gray_frames for decoding in self._decodings.values()):
            self._kept[index] = readable.copy() if readable is frame else readable
        self._sample.append(sampled)

    def _add_phase(self, frame: NDArray[Any], index: int) -> None:
        """Add a phase frame to the sums of its set."""
        limits = _limits(frame.dtype, self._saturation, self._min_modulation)
        for axis, decoding in self._decodings.items():
            for k, phases in enumerate(decoding.sets):
                if index in phases.frames:
                    sums = self._sums.setdefault(
                        axis,
                        _core.StreamSums(
                            sets=len(decoding.sets),
                            pixels=frame.size,
                            saturation=limits.threshold,
                        ),
                    )
                    step = phases.frames.index(index)
                    sums.add([frame], k, step, phases.shifts_rad[step])

    def result(self) -> Decoded:
        """Decode the frames that have arrived.

        Returns
        -------
        Decoded

        Raises
        ------
        InputError
            If frames are missing, or ``decode`` would refuse them.
        """
        if self.missing or self._first is None:
            raise FramesContradictPlan(
                f"frames: the plan has {len(self._labels)}, got {len(self._sample)}; missing: "
                f"{', '.join(self.missing)}"
            )
        first = self._first
        limits = _limits(first.dtype, self._saturation, self._min_modulation)
        findings = examine(
            self._plan,
            self._sample,
            self._decodings,
            limits,
            noise=self._noise,
            patch=self._patch,
            estimate_steps=False,
        )
        maps = {}
        for axis, decoding in findings.decodings.items():
            kernel = decoding.kernel(findings.noise, findings.limits, streamed=True)
            results = empty_maps(first.shape, sets=len(decoding.sets) if self._keep_phases else 0)
            gray_planes = [self._kept[k] for k in decoding.gray_frames]
            sums = self._sums.get(axis)
            if sums is None:
                _core.decode_frames(gray_planes, kernel, results)
            else:
                # Without a Gray code the kernel still takes the type of the counts from a frame.
                kind = np.float32 if first.dtype == np.float64 else first.dtype
                sums.decode(gray_planes or [np.empty(first.shape, kind)], kernel, results)
            maps[axis] = _coordinate_map(
                decoding, results, self._keep_phases, self._remove_isolated
            )
        return _decoded(maps, findings)


def _decodings(
    plan: PatternPlan, absolute: bool, response: Response | None
) -> dict[Axis, Decoding]:
    """The nominal decoding of each axis of a plan."""
    return {
        axis: decoding_of(plan, axis, absolute=absolute, response=response) for axis in plan.axes
    }


def _limits(dtype: np.dtype[Any], saturation: float | None, min_modulation: float) -> Limits:
    counts = saturation_of(dtype, saturation)
    return Limits(counts, _not_negative(min_modulation), given=saturation is not None)


def _not_negative(min_modulation: float) -> float:
    if not min_modulation >= 0:
        raise InputError(f"min_modulation: expected >= 0 counts, got {min_modulation}")
    return float(min_modulation)


def _middle(frame: NDArray[Any]) -> FloatMap:
    """The patch in the middle of a frame, counts."""
    h, w = frame.shape
    top, left = max(0, (h - PATCH) // 2), max(0, (w - PATCH) // 2)
    return frame[top : top + PATCH, left : left + PATCH].astype(np.float64)


def _patch(planes: Planes, plan: PatternPlan) -> list[FloatMap]:
    """Patches of the first frames for spatial noise; of phase frames where there are any."""
    phase_frames = [
        k
        for first, b in plan.placed
        if isinstance(b, PhaseSteps)
        for k in range(first, first + b.frames)
    ]
    return [_middle(planes[k]) for k in (phase_frames or range(len(planes)))[:PATCH_FRAMES]]


def _coordinate_map(
    decoding: Decoding, results: dict[str, Any], keep_phases: bool, remove_isolated: bool
) -> CoordinateMap:
    """The kernel's results for one axis as a ``CoordinateMap``, without isolated pixels."""
    repeats_px = None if decoding.absolute else decoding.length_px
    if remove_isolated:
        _core.mark_isolated(
            *(results[name] for name in ("coordinate", "sigma", "reason")),
            repeats=np.inf if repeats_px is None else repeats_px,
        )

    def stacked(name: str) -> FloatMap | None:
        if not (keep_phases and decoding.sets):
            return None
        return sealed(np.asarray(results[name][0].base))

    return CoordinateMap(
        **{field: sealed(results[name]) for name, field in RESULTS.items()},
        axis=decoding.axis,
        periods_px=tuple(phases.period_px for phases in decoding.sets),
        phase_rad=stacked("phases"),
        modulations=stacked("modulations"),
        repeats_px=repeats_px,
    )


def _decoded(maps: dict[Axis, CoordinateMap], findings: Findings) -> Decoded:
    return Decoded(
        x=maps.get("x"),
        y=maps.get("y"),
        noise=findings.noise,
        notes=findings.notes,
        details=findings.details,
    )
