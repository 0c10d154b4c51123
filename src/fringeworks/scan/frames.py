"""The frames of a plan, taken from a projector and a camera."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.memory_projector import MemoryProjector
from fringeworks.devices.protocols import Camera, ColourCamera, ColourProjector, Grab, Projector
from fringeworks.devices.sequencer import SequenceProjector
from fringeworks.patterns.encode import encode, grey_pictures, refuse_colours
from fringeworks.patterns.plan import PatternPlan, check_is_plan
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.fast import FastTaker
from fringeworks.scan.pulses import PulseTaker
from fringeworks.scan.rhythm import check_steady
from fringeworks.scan.saturation import MOST_SATURATED, SaturationGuard
from fringeworks.scan.sequence import SequenceTaker
from fringeworks.scan.taking import Picture, Taker
from fringeworks.types import Delay, InputError

Progress = Callable[[str], None]
"""Called with the label of a frame when it was taken."""
Grabbed = Callable[[int, list[Grab]], None]
"""Called with the number of a picture and the camera's frames of it, which have their times."""
MOST_AVERAGED = 255
"""Largest number of frames that are averaged for a picture: a sixteenth of the noise of one frame.
More would average the drift of the lamp."""


def take_frames(
    projector: Projector,
    camera: Camera,
    plan: PatternPlan,
    *,
    delay: Delay | None = None,
    average: int = 1,
    only: Iterable[int] | None = None,
    most_saturated: float = MOST_SATURATED,
    progress: Progress = lambda _: None,
    grabbed: Grabbed = lambda *_: None,
) -> Iterator[tuple[int, NDArray[Any]]]:
    """Show the pictures of a plan and take a frame of each.

    Parameters
    ----------
    projector : Projector
        Of the size of the plan, or larger: the plan's pictures are shown in the upper left corner
        then, black around them. A ``MemoryProjector`` plays its own plan, which must be this one. A
        ``SequenceProjector`` plays at its own pace; its pulses expose the camera, and pictures
        whose pulse got no frame are taken again, which ``progress`` is told with their label.
    camera : Camera
    plan : PatternPlan
    delay : Delay, optional
        From ``measure_delay``, for the fast way of taking frames. By default every frame is waited
        for until two in a row agree.
    average : int
        Number of frames that are averaged for each picture; 1 to 255.
    only : numbers of pictures, optional
        All by default.
    most_saturated : float
        Largest share of the lit pixels that may be saturated, 0…1. With more, the frames are
        refused: a shorter exposure is needed.
    progress : callable
    grabbed : callable
        Called with the number of every picture and the frames as the camera gave them, such as for
        their times.

    Yields
    ------
    Number of the picture in the plan, and its frame (h, w): counts as the camera gives them, or
    the mean, float32, for ``average`` > 1. Frames of a plan with ``colours`` are (h, w, 3).

    Raises
    ------
    InputError for a plan that the projector cannot show, or whose colours the camera cannot see;
    DeviceProblem where frames do not come, too many pixels are saturated, or an exposure of no
    whole refresh periods sees another part of the projector's light in every frame.
    """
    check_plan(projector, plan, colours=True)
    if not 1 <= average <= MOST_AVERAGED:
        raise InputError(f"average: expected 1 to {MOST_AVERAGED} frames, got {average}")
    with seeing_colours(camera, plan):
        told = progress, grabbed
        yield from _taken(projector, camera, plan, delay, average, only, most_saturated, told)


def _taken(
    projector: Projector,
    camera: Camera,
    plan: PatternPlan,
    delay: Delay | None,
    average: int,
    only: Iterable[int] | None,
    most_saturated: float,
    told: tuple[Progress, Grabbed],
) -> Iterator[tuple[int, NDArray[Any]]]:
    """The frames of a camera that delivers what the plan needs; see ``take_frames``."""
    progress, grabbed = told
    taker = taker_of(projector, camera, delay)
    labels = plan.picture_labels()
    if not isinstance(projector, MemoryProjector | SequenceProjector):
        check_steady(projector, camera)
    guard = SaturationGuard(camera, most_saturated)
    for number, grabs in taker.frames(pictures_of(projector, plan, only), average, guard):
        note = taker.notes.get(number, "") if isinstance(taker, PulseTaker) else ""
        progress(labels[number] + note)
        grabbed(number, grabs)
        yield number, _mean([grab.pixels for grab in grabs])


def taker_of(projector: Projector, camera: Camera, delay: Delay | None = None) -> Taker:
    """Return the way to take frames: by agreement, at a pace, or in a projector's own sequence.

    Raises
    ------
    InputError for a delay together with a ``MemoryProjector`` or a ``SequenceProjector``, whose
    frames are triggered one by one, and for such a projector with a camera without trigger.
    """
    if isinstance(projector, MemoryProjector | SequenceProjector):
        if delay is not None:
            raise InputError(
                "delay: expected none for a projector that plays from its memory: every frame is "
                "triggered"
            )
        if isinstance(projector, SequenceProjector):
            return PulseTaker(projector, camera)
        return SequenceTaker(projector, camera)
    if delay is not None:
        return FastTaker(projector, camera, delay)
    return Agreement(projector, camera)


def pictures_of(
    projector: Projector, plan: PatternPlan, only: Iterable[int] | None = None
) -> Iterator[Picture]:
    """Draw the pictures of a plan in the projector's size, those of some numbers or all."""
    wanted = set(range(plan.pictures) if only is None else only)
    labels = plan.picture_labels()
    # The light of a projector without colours is set at the projector itself.
    pictures = encode(plan) if plan.colours or _shows_colours(projector) else grey_pictures(plan)
    for n, counts in enumerate(pictures):
        if n in wanted:
            yield Picture(n, labels[n], on_screen(counts, projector))


@contextmanager
def seeing_colours(camera: Camera, plan: PatternPlan) -> Iterator[None]:
    """Let a camera deliver colours for a plan with colours or a channel, and grey frames again
    afterwards.

    Raises
    ------
    InputError for a plan with colours and a camera that delivers none.
    """
    if not plan.colours and (plan.channel is None or not _sees_colours(camera)):
        yield
        return
    if not isinstance(camera, ColourCamera):
        raise InputError(
            f"plan: expected grey pictures, because the camera {camera.name} delivers grey frames, "
            "got colours"
        )
    camera.deliver_colours(True)
    try:
        yield
    finally:
        camera.deliver_colours(False)


def mosaic_seen(camera: Camera, plan: PatternPlan) -> str | None:
    """The filters of a camera that delivers raw frames, as "rggb"; None for others.

    Raises
    ------
    InputError for a plan without a channel, whose pixels would be measured.
    """
    mosaic: str | None = getattr(camera, "mosaic", None)
    if mosaic is not None and plan.channel is None:
        raise InputError(
            f'plan: expected one with a channel, as channel = "blue", because the camera '
            f"{camera.name} delivers raw frames; got white light"
        )
    return mosaic


def _shows_colours(projector: Projector) -> bool:
    return isinstance(projector, ColourProjector) and projector.shows_colours


def _sees_colours(camera: Camera) -> bool:
    """Whether a camera delivers colours in the format that it is set to."""
    return isinstance(camera, ColourCamera) and getattr(camera, "sees_colours", True)


def _check_light(projector: Projector, channel: str) -> None:
    """Refuse a projector that shows no light of one colour."""
    light = getattr(getattr(projector, "settings", None), "colour", None)
    if not _shows_colours(projector) and light != channel:
        raise InputError(
            f"plan: expected a projector that shows {channel} pictures, or one whose light is set "
            f"to {channel}, as dlpc900:colour={channel}; got {projector.name}"
        )


def check_plan(projector: Projector, plan: PatternPlan, *, colours: bool = False) -> None:
    """Refuse a plan that a projector cannot show; one with colours, unless the caller takes them.

    Raises
    ------
    InputError for a plan that is larger than the projector, of another depth, or another one than
    that in a ``MemoryProjector``.
    """
    check_is_plan(plan)
    if not hasattr(projector, "size_px"):
        raise InputError(
            f"projector: expected a Projector, as open_devices returns, got {projector!r}"
        )
    if not colours:
        refuse_colours(plan)
    if plan.channel is not None:
        _check_light(projector, plan.channel)
    if plan.colours and not _shows_colours(projector):
        raise InputError(
            f"plan: expected grey pictures, because the projector {projector.name} shows no "
            "pictures in colour, got colours"
        )
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
    if isinstance(projector, MemoryProjector) and plan != projector.plan:
        raise InputError(
            f"plan: expected the plan whose pictures the projector {projector.name} holds, got "
            "another one"
        )


def on_screen(picture: NDArray[Any], projector: Projector) -> NDArray[Any]:
    """Return a picture in the size of the projector, black right of and below it."""
    columns, rows = projector.size_px
    if picture.shape[:2] == (rows, columns):
        return picture
    whole = np.zeros((rows, columns, *picture.shape[2:]), picture.dtype)
    whole[: picture.shape[0], : picture.shape[1]] = picture
    return whole


def _mean(frames: list[NDArray[Any]]) -> NDArray[Any]:
    """The frame, or the mean of several, float32."""
    if len(frames) == 1:
        return frames[0]
    return np.asarray(np.mean(frames, axis=0, dtype=np.float64), np.float32)
