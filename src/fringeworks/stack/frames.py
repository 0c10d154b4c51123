"""Stacks of frames: checked against their plan, and a sample of their pixels."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps
from fringeworks.types import Frozen, InputError, Source

KINDS = ("uint8", "uint16", "float32", "float64")
SAMPLE = (5_000, 24_000)
"""Pixels, at least, and residuals, about, from which noise and the order of frames are judged."""
BAND_BYTES = 4 << 20
"""Copies of frames that the kernels cannot read as they are, at a time."""
STRETCH = 64
"""Pixels of a row that a sample takes together."""
GOLDEN = 0.6180339887498949
"""Steps near this share of a cycle leave no two neighbours close together."""

Planes = list[NDArray[Any]]


@dataclass(frozen=True, eq=False, repr=False)
class Stack(Frozen):
    """Frames with the plan that they follow."""

    frames: Sequence[NDArray[Any]]
    """(h, w) arrays in the order of the plan, counts as stored; a TIFF stack stays on disk."""
    plan: PatternPlan
    saturation: float | None = None
    """Counts from which on a sample is not trusted; None where the capture does not say."""
    camera: str | None = None
    """Name of the camera."""
    projector: str | None = None
    """Name of the projector."""
    notes: tuple[str, ...] = ()
    """What was done to the frames on reading, such as colour turned to grey."""
    sources: tuple[Source, ...] = ()
    """The files that the frames and the plan were read from."""

    def __post_init__(self) -> None:
        frames = self.frames
        object.__setattr__(self, "frames", tuple(np.asarray(frame) for frame in frames))
        super().__post_init__()


def check_frames(frames: NDArray[Any] | Sequence[NDArray[Any]], plan: PatternPlan) -> Planes:
    """The frames as a list of (h, w) arrays that fits the plan.

    Raises
    ------
    InputError for a number, size or type that does not fit, naming the frames.
    """
    if isinstance(frames, np.ndarray) and frames.ndim != 3:
        raise InputError(f"frames: expected shape (n, h, w), got {frames.shape}")
    planes = [np.asarray(frame) for frame in frames]
    labels = plan.labels()
    if len(planes) < len(labels):
        missing = ", ".join(labels[len(planes) :])
        raise InputError(
            f"frames: the plan has {len(labels)}, got {len(planes)}; missing: {missing}"
        )
    if len(planes) > len(labels):
        raise InputError(
            f"frames: the plan has {len(labels)}, got {len(planes)}: {len(planes) - len(labels)} "
            "too many"
        )
    for label, plane in zip(labels, planes, strict=True):
        check_frame(plane, label, planes[0])
    return planes


def check_frame(frame: NDArray[Any], label: str, first: NDArray[Any]) -> None:
    """Refuse a frame that is no grey frame of the size and type of the first."""
    if frame.ndim != 2 or frame.size == 0:
        raise InputError(f"frame {label}: expected shape (h, w), got {frame.shape}")
    if frame.dtype.name not in KINDS:
        raise InputError(f"frame {label}: expected {', '.join(KINDS)}, got {frame.dtype}")
    if frame.shape != first.shape:
        raise InputError(
            f"frame {label}: expected the size of the first, {first.shape}, got {frame.shape}"
        )
    if frame.dtype != first.dtype:
        raise InputError(
            f"frame {label}: expected the type of the first, {first.dtype}, got {frame.dtype}"
        )


def refuse_constant(frame: NDArray[Any], label: str, sampled: NDArray[Any]) -> None:
    """Refuse a frame of fringes or of a code that has one value everywhere."""
    if sampled.size and np.all(sampled == sampled.flat[0]):
        value = frame.flat[0]
        if np.all(frame == value):
            raise InputError(f"frame {label}: expected a pattern, got {value} everywhere")


def check_content(planes: Planes, plan: PatternPlan, sampled: Sequence[NDArray[Any]]) -> None:
    """Refuse constant frames where the plan has patterns."""
    labels = plan.labels()
    for first, block in plan.placed:
        if isinstance(block, PhaseSteps | GrayCode):
            for k in range(first, first + block.frames):
                refuse_constant(planes[k], labels[k], sampled[k])


Places = tuple[NDArray[np.intp], NDArray[np.intp]]


def sampled_places(shape: tuple[int, int], plan: PatternPlan) -> Places:
    """Rows and columns of as many pixels as a sample needs: short stretches, all over the frame.

    Stretches keep to a few cache lines; there are enough of them not to miss a small object.
    """
    height, width = shape
    sets = [block for block in plan.blocks if isinstance(block, PhaseSteps)]
    # What a pixel tells of the noise: residuals of its fits, else how backgrounds differ.
    freedom = max(sum(block.frames - 3 for block in sets), len(sets) - 1, 1)
    least, residuals = SAMPLE
    wanted = max(least, residuals // freedom)
    length = min(STRETCH, width)
    count = -(-wanted // length)
    if count * length >= height * width:
        rows, columns = np.divmod(np.arange(height * width), width)
        return rows, columns
    # Every row its share of stretches, shifted from row to row by about the golden section so
    # that together they start at equal distances: all columns, and all phases, come alike.
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
    """The pixels at some places as one row, of a type that the kernels read."""
    some = np.ascontiguousarray(frame[places])[None]
    return some.astype(np.float32) if some.dtype == np.float64 else some


def saturation_of(dtype: np.dtype[Any], given: float | None) -> float:
    """Counts from which on a sample is not trusted: the type's largest, for whole counts."""
    if given is not None:
        if not given > 0:
            raise InputError(f"saturation: expected > 0 counts, got {given}")
        return float(given)
    return float(np.iinfo(dtype).max) if dtype.kind == "u" else float("inf")


def in_bands(
    planes: Planes,
    maps: dict[str, Any],
    run: Callable[[Planes, dict[str, Any]], None],
) -> None:
    """Call a kernel on frames and maps, by bands of rows where frames must be copied for it."""
    if all(plane.flags.c_contiguous and plane.dtype != np.float64 for plane in planes):
        run(planes, maps)
        return
    height, width = planes[0].shape
    kind = np.float32 if planes[0].dtype == np.float64 else planes[0].dtype
    per_row = max(1, len(planes) * width * np.dtype(kind).itemsize)
    rows = max(1, BAND_BYTES // per_row)
    for start in range(0, height, rows):
        part = slice(start, start + rows)
        copies = [np.ascontiguousarray(plane[part], kind) for plane in planes]
        run(copies, {name: _cut(value, part) for name, value in maps.items()})


def _cut(value: Any, part: slice) -> Any:
    if value is None:
        return None
    return [item[part] for item in value] if isinstance(value, list) else value[part]
