"""The frames of a plan, taken from a projector and a camera."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.patterns.encode import encode
from fringeworks.patterns.plan import PatternPlan
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.delay import Delay
from fringeworks.scan.fast import FastTaker
from fringeworks.types import InputError

Progress = Callable[[str], None]
"""Called with the label of a frame when it was taken."""


def take_frames(
    projector: Projector,
    camera: Camera,
    plan: PatternPlan,
    *,
    delay: Delay | None = None,
    average: int = 1,
    only: Iterable[int] | None = None,
    progress: Progress = lambda _: None,
) -> Iterator[tuple[int, NDArray[Any]]]:
    """Show the pictures of a plan and take a frame of each.

    Parameters
    ----------
    projector : Projector
        Of the size of the plan, or larger: the plan's pictures are shown in the upper left corner
        then, black around them.
    camera : Camera
    plan : PatternPlan
    delay : Delay, optional
        From ``measure_delay``, for the fast way of taking frames. By default every frame is waited
        for until two in a row agree.
    average : int
        Number of frames that are averaged for each picture; 1 to 255.
    only : numbers of pictures, optional
        All by default.
    progress : callable

    Yields
    ------
    Number of the picture in the plan, and its frame (h, w): counts as the camera gives them, or
    the mean, float32, for ``average`` > 1.

    Raises
    ------
    InputError for a plan that the projector cannot show; DeviceProblem where frames do not come.
    """
    check_plan(projector, plan)
    if not 1 <= average <= 255:
        raise InputError(f"average: expected 1 to 255 frames, got {average}")
    if delay is None:
        taker = Agreement(projector, camera)
        yield from taken_by_agreement(
            projector, taker, plan, average=average, only=only, progress=progress
        )
        return
    fast = FastTaker(projector, camera, delay)
    chosen = list(_pictures(projector, plan, only))
    rounds = [fast.take([picture for _, picture in chosen]) for _ in range(average)]
    labels = plan.labels()
    for k, (n, _) in enumerate(chosen):
        progress(labels[n])
        yield n, _mean([grabs[k].pixels for grabs in rounds])


def taken_by_agreement(
    projector: Projector,
    agreement: Agreement,
    plan: PatternPlan,
    *,
    average: int = 1,
    only: Iterable[int] | None = None,
    progress: Progress = lambda _: None,
) -> Iterator[tuple[int, NDArray[Any]]]:
    """Take the frames of a plan in the safe way, with an ``Agreement`` that may have begun already.

    Parameters and yields as ``take_frames``.
    """
    labels = plan.labels()
    for n, picture in _pictures(projector, plan, only):
        grabs = [agreement.take(picture, labels[n]), *agreement.more(average - 1)]
        progress(labels[n])
        yield n, _mean([grab.pixels for grab in grabs])


def _pictures(
    projector: Projector, plan: PatternPlan, only: Iterable[int] | None
) -> Iterator[tuple[int, NDArray[Any]]]:
    """Numbers and pictures of a plan, in the projector's size."""
    wanted = set(range(plan.frames) if only is None else only)
    for n, picture in enumerate(encode(plan)):
        if n in wanted:
            yield n, on_screen(picture, projector)


def check_plan(projector: Projector, plan: PatternPlan) -> None:
    """Refuse a plan that a projector cannot show.

    Raises
    ------
    InputError for a plan that is larger than the projector, or of another depth.
    """
    columns, rows = projector.size_px
    if plan.width_px > columns or plan.height_px > rows:
        raise InputError(
            f"plan: expected {columns} × {rows} px or fewer, the size of the projector "
            f"{projector.name}, got {plan.width_px} × {plan.height_px} px"
        )
    if plan.bits != projector.bits:
        raise InputError(
            f"plan: expected pictures of {projector.bits} bit, as the projector {projector.name} "
            f"shows them, got {plan.bits} bit"
        )


def on_screen(picture: NDArray[Any], projector: Projector) -> NDArray[Any]:
    """Return a picture in the size of the projector, black right of and below it."""
    columns, rows = projector.size_px
    if picture.shape == (rows, columns):
        return picture
    whole = np.zeros((rows, columns), picture.dtype)
    whole[: picture.shape[0], : picture.shape[1]] = picture
    return whole


def _mean(frames: list[NDArray[Any]]) -> NDArray[Any]:
    """The frame, or the mean of several, float32."""
    if len(frames) == 1:
        return frames[0]
    return np.asarray(np.mean(frames, axis=0, dtype=np.float64), np.float32)
