"""Small virtual rigs for the tests, with boards and captures; each is computed once in a run."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from fringeworks import decode
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.rig.calibration.calibrate import calibrate, observe
from fringeworks.rig.calibration.parameters import parameter_change
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.rig.pinhole import pose, project_with_derivatives, rotation, transform
from fringeworks.simulate.bodies import Body, Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body, board_poses, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.stack.even_light import texture
from fringeworks.types import Pinhole, Rig
from tests.shared import shared

SCALE = 0.5
"""Frame sizes over those of the standard rig: a quarter of the pixels keeps the tests quick."""
BOARD = "chessboard:11x8:12"
"""A board that fills the field of 200 mm, with one odd and one even count."""


@lru_cache
def rig() -> Rig:
    """The standard rig with half the resolution."""
    return standard_rig(scale=SCALE)


@lru_cache
def board(text: str = BOARD) -> Board:
    return parse_board(text)


@lru_cache
def poses(count: int = 8, seed: int = 0, text: str = BOARD):
    """T_camera_board of a board in several poses."""
    return tuple(board_poses(board(text), count, seed=seed))


def shoot(bodies, optics: Optics | None = None, *, both: bool = True, plan=None):
    """View, plan and frames of bodies before the rig."""
    view = look(rig(), bodies)
    plan = plan or fringe_plan(rig(), both=both)
    return view, plan, list(photograph(view, plan, optics or Optics()))


def see(T, name: str, *, text: str = BOARD, optics: Optics | None = None, plan=None, damage=None):
    """Observation of a board in a pose; ``damage`` changes what was decoded."""
    _, plan, frames = shoot([board_body(board(text), T)], optics, plan=plan)
    decoded = decode(frames, plan)
    if damage is not None:
        decoded = damage(decoded)
    size = (plan.width_px, plan.height_px)
    return observe(texture(frames, plan), decoded, board(text), projector_size=size, name=name)


@shared
def observation(k: int):
    """Observation of the board in one of the eight poses; a test that needs two makes no others."""
    return see(poses()[k], f"pose{k}", optics=Optics(seed=k))


def observations(first: int = 8):
    """Observations of the board in the first of the eight poses."""
    return tuple(observation(k) for k in range(first))


@shared
def calibrated(first: int = 8):
    """Calibration from the first of the eight poses."""
    return calibrate(observations(first), board())


def rig_errors(found: Rig, truth: Rig) -> np.ndarray:
    """Estimated minus true parameters, (24,), in the order of RIG_PARAMETERS."""
    return parameter_change(found, truth)


def sighting(
    truth: Rig, target: Board, T, rng, *, corner=0.01, phase=0.004, real_mm=None
) -> Sighting:
    """Corners as they would be measured; ``real_mm`` is where the board's points really are.

    The corner is off by noise, and the projector coordinate is read where the corner was seen.
    """
    points = transform(T, target.points_mm if real_mm is None else real_mm)
    R = truth.T_projector_camera[:3, :3]
    c, c_by, _ = project_with_derivatives(truth.camera, points)
    q, q_by, _ = project_with_derivatives(
        truth.projector, transform(truth.T_projector_camera, points)
    )
    by_pixel = (q_by @ R @ T[:3, :2]) @ np.linalg.inv(c_by @ T[:3, :2])
    error = rng.normal(0, corner, c.shape)
    read = q + np.einsum("nij,nj->ni", by_pixel, error) + rng.normal(0, phase, q.shape)
    index = np.arange(len(target.points_mm))
    return Sighting(target.points_mm, c + error, read, by_pixel, index)


def ahead(body, x=0.0, y=0.0, z=500.0, turn=None, albedo=0.8) -> Body:
    """A shape in front of the camera; ``turn`` is a rotation vector in rad."""
    R = np.eye(3) if turn is None else rotation(np.array(turn, float))
    return Body(body, pose(R, np.array([x, y, z])), albedo)


@lru_cache
def scene(name: str, seed: int = 50, both: bool = False):
    """A sphere or plane before the rig: view, and what was decoded."""
    body = (
        ahead(Sphere(25.0), 5, 3)
        if name == "sphere"
        else ahead(Plane(140, 100), turn=(0.2, 0.15, 0))
    )
    view, plan, frames = shoot([body], Optics(seed=seed), both=both)
    return view, decode(frames, plan)


def with_gross_errors(decoded, share: float, seed: int = 0):
    """Coordinates of which a share is wrong by about a period or more."""
    rng = np.random.default_rng(seed)
    maps = {}
    for axis, coordinates in decoded.maps.items():
        true = coordinates.coordinate_px
        wrong = rng.random(true.shape) < share
        jump = rng.choice([-30.0, 15.0, 60.0], true.shape).astype(np.float32)
        maps[axis] = replace(coordinates, coordinate_px=np.where(wrong, true + jump, true))
    return replace(decoded, **maps)


def groove(turn: float = np.pi / 4, side: float = 110.0) -> list[Body]:
    """Two plates that open towards the camera, with a vertical edge between them."""
    plates = []
    for sign in (-1, 1):
        R = rotation(np.array([0.0, sign * turn, 0.0]))
        middle = np.array([0.0, 0.0, 520.0]) + R @ np.array([sign * side / 2, 0.0, 0.0])
        plates.append(Body(Plane(side, side), pose(R, middle), 0.8))
    return plates


def head_on(size=64):
    """A rig whose camera is at the projector's pupil, with the same pixels."""
    device = Pinhole(size, size, (1000.0, 1000.0), (size / 2 - 0.5, size / 2 - 0.5))
    nearly = np.eye(4)
    nearly[0, 3] = -1e-9
    return Rig(device, device, nearly)
