"""A glossy ball before the virtual rig, with an albedo from 0.02 to 1 and a highlight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fringeworks import PatternPlan
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.rig.pinhole import pose
from fringeworks.simulate.bodies import Body, Sphere
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import standard_rig
from fringeworks.simulate.virtual_rig import highlight, look
from tests.virtual_devices import bench

RIG = standard_rig(scale=0.2)
"""256 × 205 px, and 384 × 240 px of the projector."""
CAMERA = {"bits": 12, "noise": 0.3}
"""Options of the camera's model."""


def glossy_view(seed):
    """The view of a large ball, with soft stripes of dark and bright paint."""
    ball = Body(Sphere(250.0), pose(np.eye(3), np.array([0.0, 0.0, 750.0])))
    view = look(RIG, [ball])
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: view.albedo.shape[0], : view.albedo.shape[1]]
    bend = np.sin(u / 40.0 + rng.uniform(0, 6))
    # A sine of a phase that grows: most of the paint is nearly black or nearly white.
    return replace(view, albedo=0.02 ** (0.5 + 0.5 * np.sin(v / 16.0 + bend + rng.uniform(0, 6))))


def hdr_bench(view, *, seed, exposure=0.2, strength=4.0, camera=None):
    """Devices before the view; a highlight is ``strength`` times as bright as white paint.

    The camera has 12 bit, read noise of 15 electrons and a full well of 12 750.
    """
    lobe = highlight(view, strength=strength, shininess=400.0)
    scene = RigScene(view, Optics(exposure=exposure), highlight=lobe)
    projector = {"width_px": 384, "height_px": 240, "black": 0.005}
    return bench(projector, CAMERA | (camera or {}), scene=scene, seed=seed)


def hdr_plan(steps=4):
    """Three sets of fringes along x: one, 5.2 and 27 periods across the projector."""
    periods = [384 / n for n in (27, 5.2, 1)]
    return PatternPlan(384, 240, tuple(PhaseSteps("x", p, equal_steps(steps)) for p in periods))
