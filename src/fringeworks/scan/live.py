"""Live measurement: points again and again, in memory that is kept."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.patterns.plan import PatternPlan
from fringeworks.rig.robot.base import base_camera, in_base
from fringeworks.rig.robot.readings import RobotPoses
from fringeworks.scan.frames import Progress, check_plan, pictures_of, seeing_colours, taker_of
from fringeworks.stack.decoder import JUDGE_EVERY, Decoder
from fringeworks.stack.options import DecodeOptions
from fringeworks.types import (
    Delay,
    DeviceProblem,
    FloatMap,
    Frozen,
    InputError,
    PointCloud,
    Reason,
    Rig,
)

RETRY_S = 0.5
"""Time between two attempts to open devices that have failed, s: a camera that is plugged in again
needs a second or two."""


@dataclass(frozen=True, eq=False, repr=False)
class LiveCloud(Frozen):
    """One measurement of a live sequence."""

    points: PointCloud
    """Valid until the next measurement, which is written to the same memory."""
    taking_s: float
    """Time that taking the frames took, s."""
    computing_s: float
    """Time that computing the points took, s."""
    judged: bool
    """Whether these frames were judged (see ``Decoder``), which takes most of the time."""

    @property
    def clouds_per_s(self) -> float:
        """Measurements per second, 1/s."""
        return 1.0 / max(self.taking_s + self.computing_s, 1e-9)

    @property
    def points_per_s(self) -> float:
        """Measured points over the time of the whole measurement, 1/s."""
        count = int(np.sum(self.points.reason == Reason.OK))
        return count * self.clouds_per_s

    def __str__(self) -> str:
        count = int(np.sum(self.points.reason == Reason.OK))
        return (
            f"{count} points, frames {1e3 * self.taking_s:.0f} ms, computing "
            f"{1e3 * self.computing_s:.0f} ms: {self.clouds_per_s:.1f} clouds/s, "
            f"{1e-6 * self.points_per_s:.2f} million points/s"
        )


def live(
    projector: Projector,
    camera: Camera,
    plan: PatternPlan,
    rig: Rig,
    *,
    delay: Delay | None = None,
    judge_every: int = JUDGE_EVERY,
    reopen: Callable[[], tuple[Projector, Camera]] | None = None,
    retry_s: float = RETRY_S,
    progress: Progress = lambda _: None,
    robot_pose: Callable[[], RobotPoses | FloatMap | None] | None = None,
    **options: Unpack[DecodeOptions],
) -> Iterator[LiveCloud]:
    """Measure points again and again, until the caller stops.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    plan : PatternPlan
        With ``colours``, projector and camera must show and see them, as for ``capture``.
    rig : Rig
    delay : Delay, optional
        From ``measure_delay``, for the fast way of taking frames.
    judge_every : int ≥ 1
        Every so many measurements the frames are judged again, see ``Decoder``. With 1, every
        cloud has error bars that contain what a moving scene or changing light adds.
    reopen : callable, optional
        Opens both devices again after one of them has failed, as a camera that was unplugged, with
        its settings. Measuring goes on then, with the frames judged anew. Where it raises a
        DeviceProblem, it is called again after ``retry_s``. By default the first problem ends all.
    retry_s : float ≥ 0
        Time between two attempts to open the devices, s.
    progress : callable
        Called with a sentence when a device has failed, and when measuring goes on.
    robot_pose : callable, optional
        Gives the points in the coordinates of the robot's base. Called after the frames of each
        measurement, while the robot still stands; returns the pose of the flange as ``in_base``
        takes it, None with the camera beside the robot. By default, points are the camera's.
    **options
        Of ``decode``.

    Yields
    ------
    LiveCloud. Its arrays are those of the measurement before, written to again: copy what is kept.

    Raises
    ------
    InputError as ``take_frames``, ``decode`` and ``triangulate``; DeviceProblem where a device
    fails and ``reopen`` is not given.

    Notes
    -----
    The caller closes the devices that it opened, and the generator those of ``reopen``.

    Examples
    --------
    >>> from fringeworks.devices.clock import SimulatedClock
    >>> from fringeworks.devices import virtual_bench, virtual_rig
    >>> from fringeworks.simulate import fringe_plan
    >>> rig = virtual_rig()
    >>> projector, camera = virtual_bench("sphere", clock=SimulatedClock())
    >>> cloud = next(live(projector, camera, fringe_plan(rig, both=False), rig))
    >>> bool((cloud.points.reason == 0).sum() > 3000)
    True
    """
    if not retry_s >= 0.0:
        raise InputError(f"retry_s: expected 0 or more, got {retry_s}")
    if robot_pose is not None:
        # A rig without the robot is refused before the first frame.
        base_camera(rig, robot_pose())
    check_plan(projector, plan, colours=True)
    pictures = list(pictures_of(projector, plan))
    taker = taker_of(projector, camera, delay)
    decoder: Decoder | None = None
    with ExitStack() as opened:
        opened.enter_context(_colours(camera, plan))
        while True:
            started = time.perf_counter()
            try:
                frames = [grab.pixels for _, (grab,) in taker.frames(pictures)]
            except DeviceProblem as problem:
                if reopen is None:
                    raise
                _close(projector, camera)
                projector, camera = _again(reopen, problem, retry_s, progress)
                opened.callback(_close, projector, camera)
                check_plan(projector, plan, colours=True)
                opened.enter_context(_colours(camera, plan))
                pictures = list(pictures_of(projector, plan))
                taker, decoder = taker_of(projector, camera, delay), None
                continue
            taken = time.perf_counter()
            if decoder is None:
                shape, kind = frames[0].shape[:2], frames[0].dtype
                decoder = Decoder(plan, shape, kind, rig=rig, judge_every=judge_every, **options)
            pose = None if robot_pose is None else robot_pose()
            points = decoder.points(frames)
            if robot_pose is not None:
                points = in_base(points, rig, pose)
            computed = time.perf_counter()
            yield LiveCloud(points, taken - started, computed - taken, decoder.judged)


@contextmanager
def _colours(camera: Camera, plan: PatternPlan) -> Iterator[None]:
    """Let a camera deliver colours for a plan with colours, also one that fails meanwhile."""
    with ExitStack() as colours:
        colours.enter_context(seeing_colours(camera, plan))
        opened = colours.pop_all()
    try:
        yield
    finally:
        with suppress(DeviceProblem):
            opened.close()


def _close(projector: Projector, camera: Camera) -> None:
    """Release devices of which one has failed: what it says of that is known already."""
    for device in (camera, projector):
        with suppress(DeviceProblem):
            device.close()


def _again(
    reopen: Callable[[], tuple[Projector, Camera]],
    problem: DeviceProblem,
    retry_s: float,
    progress: Progress,
) -> tuple[Projector, Camera]:
    """Open the devices again, as soon as they are there."""
    said = ""
    while True:
        text = f"{problem}; waiting for the devices"
        if text != said:
            progress(text)
            said = text
        time.sleep(retry_s)
        try:
            found = reopen()
        except DeviceProblem as still:
            problem = still
            continue
        progress("the devices are back; measuring goes on")
        return found
