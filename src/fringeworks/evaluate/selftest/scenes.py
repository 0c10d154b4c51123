"""Scenes of the self-test: a plane, two bodies before a wall, and what disturbs their frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate.bodies import Albedo, Body, Box, Plane, Sphere
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import standard_rig
from fringeworks.simulate.virtual_rig import View, look
from fringeworks.types import FloatMap, Pinhole, Rig

STACK_SCALE = 0.5
"""Size of frames of stacks, as a share of 1280 × 1024 px: a case takes a second, and has 300 000
points."""
PAIR_SCALE = 0.35
"""Size of frames of pairs, as a share of 1280 × 1024 px: a case takes a second, and has 27
fringes."""
WALL_MM = 520.0
"""Distance of the wall, which is the reference plane of pairs, mm."""
TILT_RAD = (0.03, 0.05)
"""Tilt of the plane about x and y, rad. It displaces the fringes of a pair by less than half a
period at the frame's rim, so that their order is certain without a part that stays in place."""
PAIR_BASELINE_MM = 280.0
"""Distance of the two pupils of the rig of pairs, mm: that of the standard rig."""
CHECK_MM = 12.0
"""Side of the painted squares, mm: about two fringes of a pair."""
PAINT = (0.8, 0.25)
"""Albedos of the painted squares, 0…1: cardboard, and paint with a third of its light."""

BODIES = ("plane", "sphere", "step")
"""Names of the bodies, the smooth ones first."""


@dataclass(frozen=True)
class Disturbance:
    """What disturbs frames beside the noise that all have."""

    optics: dict[str, Any] = field(default_factory=dict)
    """Fields of ``Optics``."""
    painted: bool = False
    """Whether the body is painted in squares."""
    decode: dict[str, Any] = field(default_factory=dict)
    """Options of ``measure`` for stacks."""


DISTURBANCES: dict[str, Disturbance] = {
    "noise": Disturbance(),
    "strong noise": Disturbance({"noise": 4.0}),
    "shot noise": Disturbance({"gain": 0.1}),
    "gamma": Disturbance({"gamma": 2.2}),
    "defocus": Disturbance({"defocus_px": 2.0}),
    "albedo": Disturbance(painted=True),
    "jpeg": Disturbance({"jpeg": 90}),
}
"""Disturbances by name. All frames have 8 bit and a read noise of 2 counts, also where nothing else
disturbs: ``Optics``."""


def optics_of(disturbance: Disturbance, seed: int) -> Optics:
    """Optics of a disturbance."""
    return Optics(seed=seed, **disturbance.optics)


def _squares(x: FloatMap, y: FloatMap) -> FloatMap:
    """Albedo of painted squares."""
    dark = (np.floor(x / CHECK_MM) + np.floor(y / CHECK_MM)) % 2
    return np.where(dark > 0, PAINT[1], PAINT[0])


def _at(x: float, y: float, z: float, tilt: tuple[float, float] = (0.0, 0.0)) -> FloatMap:
    return pose(rotation(np.array([*tilt, 0.0])), np.array([x, y, z]))


def stack_rig() -> Rig:
    """Return the rig of stacks: the standard rig, with the distortion of its lenses."""
    return standard_rig(scale=STACK_SCALE)


def pair_rig() -> Rig:
    """Return the rig of pairs: pupils at equal distance from the wall, lenses without distortion.

    Methods for two frames take the fringes on the reference plane to have one period (theory §3).
    Parallel axes and a shifted projector lens make it so.
    """
    devices = standard_rig(scale=PAIR_SCALE)
    camera, projector = (
        Pinhole(device.width_px, device.height_px, device.focal_px, device.principal_px)
        for device in (devices.camera, devices.projector)
    )
    shift = projector.focal_px[0] * PAIR_BASELINE_MM / WALL_MM
    x, y = projector.principal_px
    shifted = replace(projector, principal_px=(x + shift, y))
    return Rig(camera, shifted, pose(np.eye(3), np.array([-PAIR_BASELINE_MM, 0.0, 0.0])))


@lru_cache(maxsize=16)
def view_of(body: str, way: Literal["stack", "pair"], painted: bool) -> View:
    """Return what the camera sees of a body before the wall.

    Parameters
    ----------
    body : str
        One of ``BODIES``, or "wall" for the wall alone.
    way : "stack" or "pair"
        Whose rig it is.
    painted : bool
        Whether the body is painted in squares.
    """
    albedo: Albedo = _squares if painted else 0.8
    wall = Body(Plane(), _at(0.0, 0.0, WALL_MM))
    bodies = {
        "wall": [wall],
        "plane": [Body(Plane(), _at(0.0, 0.0, WALL_MM, TILT_RAD), albedo)],
        "sphere": [Body(Sphere(60.0), _at(5.0, 3.0, WALL_MM + 50.0), albedo), wall],
        "step": [Body(Box((60.0, 60.0, 4.0)), _at(0.0, 0.0, WALL_MM - 2.0), albedo), wall],
    }
    return look(stack_rig() if way == "stack" else pair_rig(), bodies[body])
