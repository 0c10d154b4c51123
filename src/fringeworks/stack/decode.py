"""Phase shifting and Gray code: from a stack of frames to absolute projector coordinates."""

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
from fringeworks.types import Axis, CameraNoise, CoordinateMap, Decoded, FloatMap, InputError

PATCH = 256
"""Side of the connected patch that texture noise is measured in, px."""


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
    out: Decoded | None = None,
) -> Decoded:
    """Projector coordinate of every camera pixel, with its standard deviation.

    Parameters
    ----------
    frames : (n, h, w) array or sequence of (h, w) arrays
        uint8, uint16, float32 or float64 counts, in the order of the plan; any strides, also
        memory-mapped. Not changed.
    plan : PatternPlan
        What was projected.
    noise : CameraNoise, optional
        Noise of the camera; measured from the frames where left out.
    saturation : float, optional
        Counts from which on a sample is left out of the fit. Where it is not given: for whole
        counts the type's largest value, unless samples only touch it (patterns that fill the range
        exactly); for floats none. A 12-bit camera in 16-bit files has 4095.
    min_modulation : float
        Modulation below which a pixel is not used, counts.
    absolute : bool
        False for coordinates modulo the distance after which the phases repeat, for plans that
        cannot tell more.
    response : Response, optional
        Taken out of the wrapped phases; for plans with equal steps, as many as the response's.
    estimate_steps : bool
        Take the real phase shifts from the frames (``estimate_shifts``).
    keep_phases : bool
        Return wrapped phase and modulation of every set as well.
    out : Decoded, optional
        An earlier result of the same size whose maps are written to again: for live measurement,
        where new memory would take half as long as decoding. It is not valid afterwards.

    Returns
    -------
    Decoded

    Raises
    ------
    InputError for frames that do not fit the plan or contradict it (missing, of mixed size or type,
    constant, swapped), and for a plan whose periods cannot be resolved.

    Notes
    -----
    I_n = A + B cos(φ − δ_n) by least squares at every pixel (Bruning 1974; Greivenkamp 1984),
    orders by the plan's chain (``temporal.order_chain``), the coordinate as the inverse-variance
    mean of all sets. σ comes from the camera's noise, B and the number of steps,
    σ_φ² = (2/N) σ²/B² for equal ones (theory §5, §9); where the sets disagree by more than their
    noise, it is raised by that. A rounding without five standard deviations of room, or sets that
    disagree, make a pixel NaN with ``order_ambiguous``.
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
        own = [planes[k] for k in decoding.frames]
        in_bands(own, results, partial(_run, kernel))
        maps[axis] = _coordinate_map(decoding, results, keep_phases)
    return _decoded(maps, findings)


def _run(kernel: _core.DecodeSettings, planes: Planes, maps: dict[str, Any]) -> None:
    _core.decode_frames(planes, kernel, maps)


class StreamingDecoder:
    """Decodes a plan's frames as they arrive, with the result of ``decode``.

    Sums of each set are kept, its frames are not; frames of a Gray code are kept.

    Parameters
    ----------
    plan, noise, saturation, min_modulation, absolute, response, keep_phases : as for ``decode``

    Examples
    --------
    >>> from fringeworks.patterns import PatternPlan, PhaseSteps, encode, equal_steps
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
    ) -> None:
        self._plan = plan
        self._noise = noise
        self._saturation = saturation
        self._min_modulation = _not_negative(min_modulation)
        self._keep_phases = keep_phases
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
        """Labels of the frames that are still to come."""
        return self._labels[len(self._sample) :]

    def add(self, frame: NDArray[Any]) -> None:
        """Take the next frame of the plan, (h, w).

        Raises
        ------
        InputError for a frame that is not of the size and type of the first, is constant where the
        plan has a pattern, or is one too many.
        """
        frame = np.asarray(frame)
        index = len(self._sample)
        if index == len(self._labels):
            raise InputError(f"frames: the plan has {len(self._labels)}, got one more")
        check_frame(frame, self._labels[index], frame if self._first is None else self._first)
        sampled = sample_of(frame, sampled_places(frame.shape, self._plan))
        block = next(b for k, b in reversed(self._plan.placed) if k <= index)
        if isinstance(block, PhaseSteps | GrayCode):
            refuse_constant(frame, self._labels[index], sampled)
        kind = np.float32 if frame.dtype == np.float64 else frame.dtype
        readable = np.ascontiguousarray(frame, kind)
        if self._first is None:
            # What later frames are compared with: its size and type, without its pixels.
            self._first = np.broadcast_to(frame[:1, :1], frame.shape)
        if isinstance(block, PhaseSteps):
            self._add_phase(readable, index)
        if isinstance(block, PhaseSteps) == self._fringes and len(self._patch) < 3:
            self._patch.append(_middle(frame))
        if any(index in decoding.code_frames for decoding in self._decodings.values()):
            self._kept[index] = readable.copy() if readable is frame else readable
        self._sample.append(sampled)

    def _add_phase(self, frame: NDArray[Any], index: int) -> None:
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
        """Decode what has arrived.

        Raises
        ------
        InputError while frames are missing, and as ``decode``.
        """
        if self.missing or self._first is None:
            raise InputError(
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
            out = empty_maps(first.shape, sets=len(decoding.sets) if self._keep_phases else 0)
            codes = [self._kept[k] for k in decoding.code_frames]
            sums = self._sums.get(axis)
            if sums is None:
                _core.decode_frames(codes, kernel, out)
            else:
                kind = np.float32 if first.dtype == np.float64 else first.dtype
                sums.decode(codes or [np.empty(first.shape, kind)], kernel, out)
            maps[axis] = _coordinate_map(decoding, out, self._keep_phases)
        return _decoded(maps, findings)


def _decodings(
    plan: PatternPlan, absolute: bool, response: Response | None
) -> dict[Axis, Decoding]:
    return {
        axis: decoding_of(plan, axis, absolute=absolute, response=response) for axis in plan.axes
    }


def _limits(dtype: np.dtype[Any], saturation: float | None, min_modulation: float) -> Limits:
    limit = saturation_of(dtype, saturation)
    return Limits(limit, _not_negative(min_modulation), given=saturation is not None)


def _not_negative(min_modulation: float) -> float:
    if not min_modulation >= 0:
        raise InputError(f"min_modulation: expected >= 0 counts, got {min_modulation}")
    return float(min_modulation)


def _middle(frame: NDArray[Any]) -> FloatMap:
    h, w = frame.shape
    top, left = max(0, (h - PATCH) // 2), max(0, (w - PATCH) // 2)
    return frame[top : top + PATCH, left : left + PATCH].astype(np.float64)


def _patch(planes: Planes, plan: PatternPlan) -> list[FloatMap]:
    """The middle of some frames, of fringes where there are any, for texture noise."""
    fringes = [
        k
        for first, b in plan.placed
        if isinstance(b, PhaseSteps)
        for k in range(first, first + b.frames)
    ]
    return [_middle(planes[k]) for k in (fringes or range(len(planes)))[:3]]


def _coordinate_map(decoding: Decoding, out: dict[str, Any], keep_phases: bool) -> CoordinateMap:
    def stacked(name: str) -> FloatMap | None:
        if not (keep_phases and decoding.sets):
            return None
        whole = out[name][0].base
        return np.asarray(whole)

    return CoordinateMap(
        **{field: out[name] for name, field in RESULTS.items()},
        axis=decoding.axis,
        periods_px=tuple(phases.period_px for phases in decoding.sets),
        phase_rad=stacked("phases"),
        modulations=stacked("modulations"),
        repeats_px=None if decoding.absolute else decoding.length_px,
    )


def _decoded(maps: dict[Axis, CoordinateMap], findings: Findings) -> Decoded:
    return Decoded(
        x=maps.get("x"),
        y=maps.get("y"),
        noise=findings.noise,
        notes=findings.notes,
        details=findings.details,
    )
