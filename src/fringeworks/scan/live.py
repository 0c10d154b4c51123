"""Live measurement: points again and again, in memory that is kept."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.patterns.plan import PatternPlan
from fringeworks.scan.frames import check_plan, pictures_of, taker_of
from fringeworks.stack.decoder import JUDGE_EVERY, Decoder
from fringeworks.stack.options import DecodeOptions
from fringeworks.types import Delay, Frozen, PointCloud, Reason, Rig


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
    **options: Unpack[DecodeOptions],
) -> Iterator[LiveCloud]:
    """Measure points again and again, until the caller stops.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    plan : PatternPlan
    rig : Rig
    delay : Delay, optional
        From ``measure_delay``, for the fast way of taking frames.
    judge_every : int ≥ 1
        Every so many measurements the frames are judged again, see ``Decoder``. With 1, every
        cloud has error bars that contain what a moving scene or changing light adds.
    **options
        Of ``decode``.

    Yields
    ------
    LiveCloud. Its arrays are those of the measurement before, written to again: copy what is kept.

    Raises
    ------
    InputError as ``take_frames``, ``decode`` and ``triangulate``.

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
    check_plan(projector, plan)
    pictures = list(pictures_of(projector, plan))
    taker = taker_of(projector, camera, delay)
    decoder: Decoder | None = None
    while True:
        started = time.perf_counter()
        frames = [grab.pixels for _, (grab,) in taker.frames(pictures)]
        taken = time.perf_counter()
        if decoder is None:
            shape, kind = frames[0].shape, frames[0].dtype
            decoder = Decoder(plan, shape, kind, rig=rig, judge_every=judge_every, **options)
        points = decoder.points(frames)
        computed = time.perf_counter()
        yield LiveCloud(points, taken - started, computed - taken, decoder.judged)
