"""Decoding of frames that arrive one by one."""

from __future__ import annotations

from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps
from fringeworks.stack.decode import check_options, decode
from fringeworks.stack.frames import check_frame, refuse_constant
from fringeworks.stack.options import DecodeOptions
from fringeworks.types import Decoded, FramesContradictPlan, unmasked


class StreamingDecoder:
    """Decode the frames of a plan as they arrive, with the same result as ``decode``.

    Every frame is checked when it arrives, so that a fault is known before the next one is taken.
    The decoder keeps copies of the frames: whether their order and their steps are right can only
    be judged from all of them.

    Parameters
    ----------
    plan : PatternPlan
    **options
        As for ``decode``.

    Raises
    ------
    InputError
        If an option is out of its range, or the plan or the response cannot be used.

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

    def __init__(self, plan: PatternPlan, **options: Unpack[DecodeOptions]) -> None:
        check_options(plan, options)
        self._plan = plan
        self._options = options
        self._labels = plan.labels()
        self._frames: list[NDArray[Any]] = []
        self._spare: list[NDArray[Any]] = []
        self._first: tuple[tuple[int, ...], np.dtype[Any]] | None = None

    @property
    def missing(self) -> list[str]:
        """Labels of the frames that have not arrived yet."""
        return self._labels[len(self._frames) :]

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
        frame = unmasked(frame, "frame")
        index = len(self._frames)
        if index == len(self._labels):
            raise FramesContradictPlan(f"frames: the plan has {len(self._labels)}, got one more")
        shape, kind = self._first or (frame.shape, frame.dtype)
        check_frame(frame, self._labels[index], shape, kind)
        pattern = self._plan.order[index]
        block = next(b for k, b in reversed(self._plan.placed) if k <= pattern)
        if isinstance(block, PhaseSteps | GrayCode):
            refuse_constant(frame, self._labels[index], frame[:1])
        self._first = shape, kind
        # A copy: the caller may use the memory again, as cameras do.
        native = frame.dtype.newbyteorder("=")
        spare = self._spare.pop() if self._spare else None
        if spare is None or spare.shape != frame.shape or spare.dtype != native:
            spare = np.empty(frame.shape, native)
        np.copyto(spare, frame)
        self._frames.append(spare)

    def reset(self) -> None:
        """Forget the frames that have arrived, for the next stack; their memory is used again."""
        self._spare = self._frames[::-1]
        self._frames = []
        self._first = None

    def result(self, *, out: Decoded | None = None) -> Decoded:
        """Decode the frames that have arrived.

        Parameters
        ----------
        out : Decoded, optional
            An earlier result, as for ``decode``.

        Returns
        -------
        Decoded

        Raises
        ------
        InputError
            If frames are missing, or ``decode`` would refuse them.
        """
        if self.missing:
            raise FramesContradictPlan(
                f"frames: the plan has {len(self._labels)}, got {len(self._frames)}; missing: "
                f"{', '.join(self.missing)}"
            )
        return decode(self._frames, self._plan, **self._options, out=out)
