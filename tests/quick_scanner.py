"""A small virtual scanner for the service's tests, as a plug-in: frames of 192 × 154 px, at once."""

from __future__ import annotations

import time

import fringeworks as fw
from fringeworks.devices.bench import MODEL, SCENES
from fringeworks.devices.clock import SimulatedClock
from fringeworks.devices.virtual_camera import VirtualCamera
from fringeworks.devices.virtual_projector import ProjectorModel, VirtualProjector
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.simulate.standard import standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import DeviceProblem

SCALE = 0.15
"""Of the standard rig; ``tests/service_running.py`` has the same."""
SLOW_S = 0.1
"""Time of a frame of the slow camera, s."""


class Slow(VirtualCamera):
    """A camera that takes its time, or fails."""

    wait_s = 0.0
    fails = False

    def grab(self, *given, **named):
        time.sleep(self.wait_s)
        if self.fails:
            raise DeviceProblem("quick camera: it was unplugged")
        return super().grab(*given, **named)


@fw.devices.scanner_kind("quick")
def open_quick(scene):
    """``quick``, ``quick:slow`` or ``quick:broken``."""
    model = standard_rig(scale=SCALE)
    projector = VirtualProjector(
        ProjectorModel(model.projector.width_px, model.projector.height_px), clock=SimulatedClock()
    )
    camera = Slow(RigScene(look(model, SCENES["plane"]())), projector, MODEL)
    camera.wait_s = SLOW_S if scene == "slow" else 0.0
    camera.fails = scene == "broken"
    return projector, camera
