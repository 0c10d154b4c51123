"""Small virtual rigs of several cameras: numbers of corners, coordinates and calibrations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fringeworks import PatternPlan, decode
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.cameras import multi_rig_of
from fringeworks.rig.calibration.leave_out import leave_poses_out
from fringeworks.rig.calibration.parameters import FurtherCamera, further_change, parameter_change
from fringeworks.rig.camera_points import camera_points
from fringeworks.rig.device_pairs import camera_pair
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.rig.stereo_match import CoordinateField
from fringeworks.rig.triangulate import triangulate
from fringeworks.simulate.bodies import Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_poses, standard_cameras
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import CameraNoise, CoordinateMap, Decoded, MultiRig, Reason
from tests.rigs import ahead, sighting
from tests.rigs import board as board_of

BOARD = "chessboard:11x8:12"
FACING = -np.radians(20.0)
"""Turn about y by which a surface before the first camera faces the projector, rad."""


def facing_poses(count: int, seed: int):
    """Poses of a board that both cameras of ``standard_cameras`` see."""
    middle = pose(np.eye(3), np.array([0.0, 0.0, 500.0]))
    turn = (
        middle @ pose(rotation(np.array([0.0, FACING, 0.0])), np.zeros(3)) @ np.linalg.inv(middle)
    )
    return [turn @ T for T in board_poses(board_of(BOARD), count, seed=seed)]


def sightings(rig: MultiRig, places, rng, **errors):
    """The corners that every camera of a rig sees in every pose."""
    return [
        replace(
            sighting(
                camera_pair(rig, k), board_of(BOARD), rig.T_camera_first[k] @ T, rng, **errors
            ),
            camera=k,
            pose=p,
        )
        for k in range(len(rig.cameras))
        for p, T in enumerate(places)
    ]


def further(rig: MultiRig):
    """The cameras after the first."""
    pairs = zip(rig.cameras[1:], rig.T_camera_first[1:], strict=True)
    return [FurtherCamera(camera, T) for camera, T in pairs]


def adjusted(rig: MultiRig, seed: int, *, count: int = 8, **errors):
    """Bundle adjustment of numerical corners; the sightings too."""
    rng = np.random.default_rng(seed)
    places = facing_poses(count, seed)
    seen = sightings(rig, places, rng, **errors)
    return adjust(seen, camera_pair(rig, 0), places, further=further(rig)), seen


def calibrated(rig: MultiRig, seed: int, **errors) -> MultiRig:
    """A calibration from numerical corners, with poses left out as ``calibrate_cameras`` does."""
    found, seen = adjusted(rig, seed, **errors)
    free = np.ones(len(found.devices_covariance), bool)
    return multi_rig_of(found, leave_poses_out(seen, found, free=free).inflation)


def rig_errors(found: MultiRig, truth: MultiRig) -> np.ndarray:
    """Estimated minus true parameters, in the order of ``multi_rig_parameters``."""
    return np.concatenate(
        (
            parameter_change(camera_pair(found, 0), camera_pair(truth, 0)),
            further_change(further(found), further(truth)),
        )
    )


def surfaces(seed: int):
    """A plane that faces the projector, a tilted one and a sphere, at depths of their own."""
    rng = np.random.default_rng(1000 + seed)
    z = rng.uniform(450.0, 550.0, 3)
    tilt = rng.uniform(-0.3, 0.3, 2)
    return {
        "plane": ahead(Plane(220, 170), z=z[0], turn=(0.0, FACING, 0.0)),
        "tilted": ahead(Plane(220, 170), z=z[1], turn=(tilt[0], tilt[1] + FACING, 0.0)),
        "sphere": ahead(Sphere(45.0), *rng.uniform(-25, 25, 2), z=z[2] + 30.0),
    }


def views_of(rig: MultiRig, bodies):
    """What every camera looks at, in its own coordinates."""
    return [
        look(camera_pair(rig, k), bodies, T_camera_world=rig.T_camera_first[k])
        for k in range(len(rig.cameras))
    ]


def numeric(view, rng, *, noise_px: float = 0.01) -> Decoded:
    """Coordinates with noise, without photographs."""
    maps = {}
    for k, axis in enumerate("xy"):
        q = np.where(view.lit, view.projector_px[..., k], np.nan)
        q = (q + rng.normal(0.0, noise_px, q.shape)).astype(np.float32)
        sigma = np.where(np.isfinite(q), noise_px, np.nan).astype(np.float32)
        reason = np.where(np.isfinite(q), Reason.OK, Reason.SHADOW).astype(np.uint8)
        light = np.full(q.shape, 100.0, np.float32)
        maps[axis] = CoordinateMap(q, sigma, light, light, reason, axis, (15.0,))
    return Decoded(maps["x"], maps["y"], CameraNoise(1.0, 0.0))


def gray_plan(rig: MultiRig, *, period_px: float, steps: int, axes: str = "x") -> PatternPlan:
    """Fringes whose orders Gray code tells: a strong ripple cannot make wrong ones."""
    size = {"x": rig.projector.width_px, "y": rig.projector.height_px}
    blocks: list[Any] = [Uniform("white"), Uniform("black")]
    for axis in axes:
        blocks += [
            PhaseSteps(axis, period_px, equal_steps(steps)),
            GrayCode(axis, 0.5 * period_px, size[axis]),
        ]
    return PatternPlan(size["x"], size["y"], tuple(blocks))


def photographed(views, plan: PatternPlan, optics: Optics):
    """Coordinates decoded from photographs of every camera."""
    return [
        decode(
            list(photograph(view, plan, replace(optics, seed=10 * optics.seed + k))),
            plan,
            remove_isolated=False,
        )
        for k, view in enumerate(views)
    ]


def measured(rig: MultiRig, decoded, camera: int = 0, axes=("x", "y")):
    """The points of one camera."""
    alone = triangulate(decoded[camera], camera_pair(rig, camera))
    others = {k: CoordinateField.of(d, axes) for k, d in enumerate(decoded) if k != camera}
    return camera_points(rig, camera, decoded[camera], alone, others, axes)


def small_rig(scale: float = 0.2, cameras: int = 2) -> MultiRig:
    """A rig of few pixels."""
    return standard_cameras(scale=scale, cameras=cameras)
