"""Sequence + rig → points at every moment."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Unpack

from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath
from fringeworks.files.rig import read_rig
from fringeworks.patterns.plan import PatternPlan
from fringeworks.rig.triangulate import Triangulator
from fringeworks.stack.motion import Motion
from fringeworks.stack.sequence import SequenceOptions, decode_sequence
from fringeworks.types import Axis, Frozen, PointCloud, Rig, RigMismatch, found_before


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredMoment(Frozen):
    """The points of a scene at one moment of a sequence."""

    points: PointCloud
    motion: Motion
    """How the scene moves at this moment, in camera and projector px."""
    time_frames: float
    """The moment, in frames from the first one of the sequence: the time of the middle one of its
    frames, or of the later of two."""
    first_frame: int
    """Index in the sequence of the first of its frames, which are as many as the plan's."""


def measure_sequence(
    frames: Iterable[NDArray[Any]],
    rig: Rig | Triangulator | StrPath,
    plan: PatternPlan,
    *,
    axis: Axis | None = None,
    **options: Unpack[SequenceOptions],
) -> Iterator[MeasuredMoment]:
    """Measure the points of a scene that moves, frame by frame.

    Parameters
    ----------
    frames : iterable of (h, w) arrays, counts
        Frame k shows pattern k modulo the plan's number of frames. ``read_sequence`` reads them
        from disk as they are needed.
    rig : Rig, Triangulator or path
    plan : PatternPlan
        With fringes along each of its axes.
    axis : "x" or "y", optional
        Use this axis of the projector only.
    **options
        Of ``decode_sequence``.

    Yields
    ------
    MeasuredMoment, in the order of time.

    Raises
    ------
    RigMismatch for a plan of another projector, and as ``decode_sequence``.
    """
    if not isinstance(rig, Triangulator):
        rig = Triangulator(rig if isinstance(rig, Rig) else read_rig(rig))
    size = rig.rig.projector.width_px, rig.rig.projector.height_px
    if (plan.width_px, plan.height_px) != size:
        raise RigMismatch(
            f"plan: expected one for the rig's projector of {size[0]} × {size[1]} px, got "
            f"{plan.width_px} × {plan.height_px} px"
        )
    for moment in decode_sequence(frames, plan, **options):
        with found_before(moment.decoded.findings):
            points = rig.triangulate(moment.decoded, axis=axis)
        yield MeasuredMoment(points, moment.motion, moment.time_frames, moment.first_frame)
