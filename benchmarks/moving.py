"""Sequences of scenes that move."""

from __future__ import annotations

import numpy as np

from benchmarks.harness import Result, in_turn, work
from fringeworks import PatternPlan
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.rig.pinhole import pose
from fringeworks.simulate import look, standard_rig
from fringeworks.simulate.exposure import photograph_moving
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust
from fringeworks.stack import decode_sequence

CYCLES = 4
"""Cycles of the plan in the sequence."""
SPEED_MM = 0.11
"""How far the bust recedes in a frame, mm: 0.25 px along the projector."""


@work
def sequences() -> list[Result]:
    """A moment of a bust that recedes, 12 frames of 640 × 512 px a cycle, one moment a frame."""
    rig = standard_rig(scale=0.5)
    sets = tuple(PhaseSteps("x", period, equal_steps(4)) for period in (960.0, 160.0, 32.0))
    plan = PatternPlan(rig.projector.width_px, rig.projector.height_px, sets)
    middle = np.array([0.0, 0.0, 500.0])
    views = [
        look(rig, bust(pose(np.eye(3), middle + np.array([0.0, 0.0, SPEED_MM * t]))))
        for t in range(CYCLES * plan.frames)
    ]
    frames = list(photograph_moving(views, plan, Optics(noise=0.5, exposure=0.9, seed=5)))
    (seconds,), (moments,) = in_turn(lambda: list(decode_sequence(frames, plan)), repeats=2)
    name = "one moment of a sequence, 12 frames of 640 x 512 a cycle"
    return [Result(name, "none", "", min(seconds) / len(moments), limit_seconds=0.1)]
