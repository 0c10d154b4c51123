"""Stacks of frames: their type, the checks against their plan, and the sample of their pixels."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.other_cells import cells_for_count
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, check_is_plan
from fringeworks.signal.bands import row_bands
from fringeworks.types import (
    CameraNoise,
    FloatMap,
    FramesContradictPlan,
    Frozen,
    InputError,
    Plotted,
    Region,
    Source,
    positive,
    unmasked,
)

FRAME_TYPES = ("uint8", "uint16", "float32", "float64")
"""Types of the counts that frames may have."""
SHORT_TYPES = tuple(np.dtype(name).str[1:] for name in FRAME_TYPES)
"""Their short forms without the byte order."""

SAMPLE_PIXELS = 5_000
"""Smallest number of pixels in the sample that a whole stack is judged by.

The median χ² of 5000 pixels scatters by 2 to 3 %, well below the limits of ``stack.examine``.
"""

SAMPLE_RESIDUALS = 24_000
"""Approximate number of residuals that the sample should provide for measuring the noise.

24 000 Gaussian residuals determine a standard deviation to 0.5 %.
"""

STRETCH = 64
"""Number of neighbouring pixels of a row that the sample takes together.

They lie in one or two cache lines of 8-bit or 16-bit frames, which makes sampling fast; many short
stretches do not miss a small object.
"""

GOLDEN = 0.6180339887498949
"""Golden ratio of a cycle. Starts that shift by it from row to row cover all columns evenly."""

Planes = list[NDArray[Any]]
"""Frames as (h, w) arrays of one size and type, in the order of the plan."""


@dataclass(frozen=True, eq=False, repr=False)
class Stack(Plotted, Frozen):
    """Frames with the plan that they follow."""

    frames: Sequence[NDArray[Any]]
    """(h, w) arrays in the order of the plan, counts; those of a TIFF stack stay on disk. Of
    colours (h, w, 3), the channel of a plan that has one is kept."""
    plan: PatternPlan
    saturation: float | None = None
    """Counts from which on a sample is not trusted; None where the capture does not say. For frames
    that were converted from colour, the largest count of their files."""
    camera: str | None = None
    """Name of the camera."""
    projector: str | None = None
    """Name of the projector."""
    notes: tuple[str, ...] = ()
    """What was done to the frames on reading, such as colour turned to grey."""
    sources: tuple[Source, ...] = ()
    """The files that the frames and the plan were read from."""
    count_step: float | None = None
    """Smallest difference between two counts of the source, before any conversion; 1 for whole
    counts, None where unknown."""
    lossy: bool = False
    """Whether the frames come from lossily compressed files, such as JPEG."""
    region: Region | None = None
    """Part of the camera's sensor that they show; None where the capture does not say."""
    colour: FloatMap | None = None
    """The scene under even light in red, green and blue, (h, w, 3), counts; None where unknown."""
    white_balance: tuple[float, float, float] | None = None
    """Gains of red, green and blue that ``measure`` applies to the colour of the points, as
    ``fringeworks.stack.white_balance`` measures them; None for none."""

    noise: CameraNoise | None = None
    """Noise of the frames, where it is known, as of those that ``unmix`` makes."""
    colour_noise: tuple[CameraNoise, ...] | None = None
    """Noise of the red, green and blue of ``colour``, where it is known."""

    def __post_init__(self) -> None:
        check_is_plan(self.plan)
        frames = (self.plan.seen(unmasked(frame, "frames")) for frame in self.frames)
        object.__setattr__(self, "frames", tuple(frames))
        super().__post_init__()


def check_frames(frames: NDArray[Any] | Sequence[NDArray[Any]], plan: PatternPlan) -> Planes:
    """Check the number, size and type of frames, and return them as a list of (h, w) arrays.

    Raises
    ------
    InputError
        If the number of frames is not the plan's, or a frame differs in size or type. The message
        names the frame.
    """
    check_is_plan(plan)
    coloured = plan.channel is not None
    if isinstance(frames, np.ndarray) and frames.ndim != 3 + coloured * (frames.ndim == 4):
        raise InputError(f"frames: expected shape (n, h, w), got {frames.shape}")
    if isinstance(frames, (str, os.PathLike)):
        raise InputError(f"frames: expected arrays, got the path {frames}; read_stack reads it")
    planes = [plan.seen(unmasked(frame, "frames")) for frame in frames]
    labels = plan.labels()
    if len(planes) != len(labels):
        count, more = len(planes), len(planes) - len(labels)
        why = f": {more} too many" if more > 0 else f"; missing: {', '.join(labels[count:])}"
        raise FramesContradictPlan(
            f"frames: the plan has {len(labels)}, got {count}{why}{cells_for_count(plan, count)}"
        )
    first = planes[0]
    for label, plane in zip(labels, planes, strict=True):
        check_frame(plane, label, first.shape, first.dtype)
    return planes


def check_frame(
    frame: NDArray[Any], label: str, shape: tuple[int, ...], kind: np.dtype[Any]
) -> None:
    """Refuse a frame that is not two-dimensional or has another size or type than the first.

    The byte order does not count.
    """
    if frame.ndim != 2 or frame.size == 0:
        raise InputError(f"frame {label}: expected shape (h, w), got {frame.shape}")
    # NumPy computes a type's name anew each time; its short form without byte order is at hand.
    short = frame.dtype.str[1:]
    if short not in SHORT_TYPES:
        raise InputError(
            f"frame {label}: expected {', '.join(FRAME_TYPES)}, got {frame.dtype}; "
            "frame.astype(np.float32) converts it"
        )
    if frame.shape != shape:
        raise FramesContradictPlan(
            f"frame {label}: expected the size of the first, {shape}, got {frame.shape}"
        )
    if short != kind.str[1:]:
        raise FramesContradictPlan(
            f"frame {label}: expected the type of the first, {kind.name}, got {frame.dtype.name}"
        )


def step_of(kind: np.dtype[Any]) -> float | None:
    """Smallest difference between two counts of a type: 1 for integers, unknown for floats."""
    return 1.0 if kind.kind in "ui" else None


def kernel_type(kind: np.dtype[Any]) -> np.dtype[Any]:
    """The type that kernels read counts of a type in: native byte order, no double precision."""
    return np.dtype(np.float32) if kind.str[1:] == "f8" else kind.newbyteorder("=")


def readable(frame: NDArray[Any]) -> NDArray[Any]:
    """The frame itself where kernels can read its memory, otherwise a copy that they can read."""
    return np.require(frame, kernel_type(frame.dtype), ["C", "A"])


def refuse_constant(frame: NDArray[Any], label: str, sampled: NDArray[Any]) -> None:
    """Refuse a frame that has one value everywhere; ``sampled`` holds some of its pixels."""
    if sampled.size and np.all(sampled == sampled.flat[0]):
        value = frame.flat[0]
        if np.all(frame == value):
            if value == saturation_of(frame.dtype, None):
                raise FramesContradictPlan(
                    f"saturated: frame {label}: expected a pattern, got {value} everywhere, the "
                    "largest count; shorten the exposure"
                )
            raise FramesContradictPlan(f"frame {label}: expected a pattern, got {value} everywhere")


def check_content(planes: Planes, plan: PatternPlan, sampled: Sequence[NDArray[Any]]) -> None:
    """Refuse constant frames where the plan has fringes or Gray code."""
    labels = plan.labels()
    for first, block in plan.placed:
        if isinstance(block, PhaseSteps | GrayCode):
            for k in range(first, first + block.frames):
                refuse_constant(planes[k], labels[k], sampled[k])


Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns of some pixels."""


def sampled_places(shape: tuple[int, int], plan: PatternPlan) -> Places:
    """Choose the pixels of the sample: short stretches of rows, spread evenly over the frame.

    Parameters
    ----------
    shape : (h, w)
    plan : PatternPlan
        It determines how many pixels the sample needs.

    Returns
    -------
    rows, columns : (n,) integer arrays
    """
    height, width = shape
    sets = [block for block in plan.blocks if isinstance(block, PhaseSteps)]
    # Residuals per pixel: those of its fits, or else the differences of its sets' backgrounds.
    freedom = max(sum(block.frames - 3 for block in sets), len(sets) - 1, 1)
    wanted = max(SAMPLE_PIXELS, SAMPLE_RESIDUALS // freedom)
    length = min(STRETCH, width)
    count = -(-wanted // length)
    if count * length >= height * width:
        rows, columns = np.divmod(np.arange(height * width), width)
        return rows, columns
    # Stretches shift from row to row by about the golden section, so that the starts of all rows
    # together are equally spaced and every column and phase is sampled equally often.
    down = int(min(height, max(1, round(np.sqrt(count * length * height / width)))))
    across = min(-(-count // down), width // length)
    while down * across < count and down < height:
        down += 1
    rows = ((np.arange(down) + 0.5) * height / down).astype(np.intp)
    step = next(m for m in range(round(GOLDEN * down), 2 * down + 2) if math.gcd(m, down) == 1)
    turn = (np.arange(down)[:, None] * step % down / down + np.arange(across)) / across
    start = (turn * width).astype(np.intp)
    columns = (start[:, :, None] + np.arange(length)) % width
    return np.repeat(rows, across * length), columns.reshape(-1)


def sample_of(frame: NDArray[Any], places: Places) -> NDArray[Any]:
    """Pixels of a frame as one row, (1, n), of a type that the kernels read."""
    return readable(frame[places][None])


def saturation_of(dtype: np.dtype[Any], given: float | None) -> float:
    """Saturation: the given one, the largest count of an integer type, or infinity for floats."""
    if given is not None:
        if not (positive(given) or given == np.inf):
            raise InputError(f"saturation: expected > 0 counts, got {given}")
        return float(given)
    return float(np.iinfo(dtype).max) if dtype.kind == "u" else float("inf")


def in_bands(
    planes: Planes,
    maps: dict[str, Any],
    run: Callable[[Planes, dict[str, Any]], None],
) -> None:
    """Call a kernel on frames and maps, in bands of rows where the frames must be copied for it.

    Parameters
    ----------
    planes : frames, (h, w) arrays
    maps : arrays that the kernel writes to, by name; (h, w), lists of such arrays, or None
    run : function that calls the kernel on frames and maps of equal height
    """
    if all(_is_readable(plane) for plane in planes):
        run(planes, maps)
        return
    bytes_per_px = len(planes) * kernel_type(planes[0].dtype).itemsize
    for band in row_bands(planes[0].shape, bytes_per_px):
        run(
            [readable(plane[band.rows]) for plane in planes],
            {name: _cut(value, band.rows) for name, value in maps.items()},
        )


def _is_readable(plane: NDArray[Any]) -> bool:
    """Whether kernels can read a frame without a copy."""
    fits = plane.dtype == kernel_type(plane.dtype)
    return bool(fits and plane.flags.c_contiguous and plane.flags.aligned)


def _cut(value: Any, part: slice) -> Any:
    """The rows of an array, of every array in a list, or None."""
    if value is None:
        return None
    return [item[part] for item in value] if isinstance(value, list) else value[part]
