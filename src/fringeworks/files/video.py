"""Videos in place of frames, by OpenCV: decoded in a process of its own."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.apart import read_apart
from fringeworks.files.limits import max_bytes, parsing
from fringeworks.types import FramesContradictPlan
from fringeworks.types.packages import need_opencv

VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm")
"""Suffixes of videos."""
CPU_SECONDS = 300
"""Processor time that decoding may take; a minute of Full HD takes about 20 s."""
SAMPLED_PX = 40_000
"""Pixels in which the change from frame to frame is measured: their mean has little noise."""
LEAST_CHANGE = 0.1
"""Smallest mean change from frame to frame that counts, counts: one count at a tenth of the pixels,
as rounding makes it. Where a video repeats frames to the last bit, any change is far above 0."""
SHOWN_NUMBERS = 4
"""Numbers of frames that a note lists."""


def read_video(path: Path) -> NDArray[np.uint8]:
    """All frames of a video in grey, (n, h, w); colour becomes luminance (BT.601).

    Raises
    ------
    FileProblem for a video that cannot be decoded, and one that takes more memory than the limit;
    MissingPackage without OpenCV (the extra "calibration").
    """
    need_opencv("a video")
    with parsing(path, "a readable video"):
        most = max_bytes()
        given = [str(path), str(most)]
        content = read_apart("video_process.py", given, most, CPU_SECONDS, "a readable video")
        head, _, body = content.partition(b"\n")
        height, width = (int(n) for n in head.split())
        return np.frombuffer(body, np.uint8).reshape(-1, height, width)


def frames_of_plan(
    path: Path, frames: NDArray[Any], count: int
) -> tuple[NDArray[Any], tuple[str, ...]]:
    """The frames of a video that a plan needs, and a note about them.

    A video with as many frames as the plan is taken as it is. In a longer one, each pattern must
    stand still for two frames or more: the frame in the middle of each still part is taken.

    Parameters
    ----------
    path : Path
        For messages.
    frames : (n, h, w) array
    count : int
        Number of frames of the plan.

    Raises
    ------
    FramesContradictPlan for another number of still parts than the plan has frames.
    """
    lossy = f"{path.name}: a video in grey; its compression adds errors that are no noise"
    if len(frames) == count:
        return frames, (lossy,)
    parts = still_parts(frames, count)
    if len(parts) != count:
        raise FramesContradictPlan(
            f"{path}: the plan has {count} frames, got a video of {len(frames)} with {len(parts)} "
            f"still parts; expected {count} frames, or every pattern still for two frames or more "
            "and nothing before and after; cut the video, or write its frames as images"
        )
    middle = [(first + last) // 2 for first, last in parts]
    shown = ", ".join(str(number) for number in middle[:SHOWN_NUMBERS])
    return frames[middle], (
        f"{lossy}; of {len(frames)} frames the middle ones of {count} still parts were taken: "
        f"{shown}{' …' if count > SHOWN_NUMBERS else ''}",
    )


def still_parts(frames: NDArray[Any], count: int) -> list[tuple[int, int]]:
    """First and last frame of the parts in which a video stands still.

    The change between frames of different patterns is far above that of a still picture. The limit
    lies at the geometric mean of the usual change and of the one that ``count`` patterns need.
    Where this gives another number of parts, the limit lies in the widest gap between changes: a
    key frame of a compressed video changes a still picture far more than usual.
    """
    changes = _changes(frames)
    if len(changes) < count or count < 2:
        return [(0, len(frames) - 1)]
    usual = max(float(np.median(changes)), 1e-6)
    needed = float(np.sort(changes)[-(count - 1)])
    parts = _parts(changes, np.sqrt(usual * max(needed, usual)))
    ordered = np.maximum(np.sort(changes), max(usual, LEAST_CHANGE))
    widest = int(np.argmax(ordered[1:] / ordered[:-1]))
    by_gap = _parts(changes, np.sqrt(ordered[widest] * ordered[widest + 1]))
    return by_gap if len(parts) != count == len(by_gap) else parts


def _parts(changes: NDArray[np.float64], limit: float) -> list[tuple[int, int]]:
    """First and last frame of the parts within which no change is above a limit."""
    ends = np.concatenate(([-1], np.flatnonzero(changes > limit), [len(changes)]))
    parts = [(int(a) + 1, int(b)) for a, b in pairwise(ends)]
    # A frame between two changes shows one pattern fading into the next.
    return [(first, last) for first, last in parts if last > first]


def _changes(frames: NDArray[Any]) -> NDArray[np.float64]:
    """Mean absolute difference of each frame from the one before, counts."""
    step = max(1, int(np.sqrt(frames[0].size / SAMPLED_PX)))
    few = frames[:, ::step, ::step].astype(np.int16)
    return np.array([np.abs(b - a).mean() for a, b in pairwise(few)])
