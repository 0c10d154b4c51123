"""Decoding of frames that arrive one by one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import PatternPlan, PhaseSteps, GrayCode
from fringeworks.stack.decode import decode
from fringeworks.stack.frames import check_frame, refuse_constant, sample_of, sampled_places
from fringeworks.stack.options import DecodeOptions
from fringeworks.types import Decoded, FramesContradictPlan

class StreamingDecoder:
    """Decode the frames of a plan as they arrive, with the same result as ``decode``.

    The decoder keeps sums of each set instead of its frames. It keeps the frames of a Gray code.

    Parameters
    ----------
    plan, noise, saturation, min_modulation, absolute, response, keep_phases
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
            maps[axis] = _coordinate_map(decoding, results, self._keep_phases)
        return _decoded(maps, findings)


