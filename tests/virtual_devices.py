"""Virtual devices for the tests: a camera that sees a projector's pixels one to one, and a rig."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fringeworks import PatternPlan
from fringeworks.devices.clock import SimulatedClock
from fringeworks.devices.virtual_camera import CameraModel, VirtualCamera
from fringeworks.devices.virtual_projector import ProjectorModel, VirtualProjector
from fringeworks.patterns import PhaseSteps, equal_steps


class Screen:
    """A camera that looks at every second pixel of a projector."""

    def __init__(self, rows=96, columns=128, white=0.6, ambient=0.03):
        self.shape = (rows // 2, columns // 2)
        self.white = white
        self.ambient = np.full(self.shape, ambient)

    def projected(self, light):
        return self.white * light[::2, ::2]


def plan(sets=3, width=128, height=96):
    """Four steps at several periods."""
    periods = (16.0, 18.0, 20.0)[:sets]
    return PatternPlan(width, height, tuple(PhaseSteps("x", p, equal_steps(4)) for p in periods))


@dataclass
class Bench:
    """A projector and a camera before a scene, and what every grabbed frame really shows."""

    projector: VirtualProjector
    camera: VirtualCamera
    pictures: dict = field(default_factory=dict)
    """Bytes of the shown pictures by number."""
    seen: dict = field(default_factory=dict)
    """Numbers of the pictures in every grabbed frame, by the frame's number."""

    @property
    def clock(self):
        return self.projector.clock

    def shows_only(self, grab, picture) -> bool:
        """Whether a frame shows one picture and nothing else."""
        numbers = self.seen[grab.number]
        return {self.pictures.get(n) for n in numbers} == {picture.tobytes()}


def bench(projector=None, camera=None, *, scene=None, seed=0, clock=None) -> Bench:
    """A bench on a simulated clock; ``projector`` and ``camera`` are options of the models."""
    options = {"width_px": 128, "height_px": 96} | (projector or {})
    shows = VirtualProjector(ProjectorModel(**options), clock=clock or SimulatedClock(), seed=seed)
    model = CameraModel(**(camera or {}))
    films = VirtualCamera(scene or Screen(), shows, model, seed=seed + 1)
    made = Bench(shows, films)

    def show(picture, real=shows.show):
        time = real(picture)
        made.pictures[shows.shown[-1].number] = np.asarray(picture).tobytes()
        return time

    def grab(timeout_s=5.0, real=films.grab):
        grabbed = real(timeout_s)
        made.seen[grabbed.number] = films.pictures
        return grabbed

    shows.show, films.grab = show, grab
    return made


class Interrupting:
    """A camera that goes away after some frames, or asks for an interruption."""

    def __init__(self, camera, after, error):
        self._camera, self._left, self._error = camera, after, error

    def __getattr__(self, name):
        return getattr(self._camera, name)

    def grab(self, timeout_s=5.0):
        self._left -= 1
        if self._left < 0:
            raise self._error
        return self._camera.grab(timeout_s)
