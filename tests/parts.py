"""A part with planes, a ramp and a dome, its model, and its measurements on the virtual rig."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

import fringeworks as fw
from fringeworks.rig.calibration.parameters import moved_rig
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate.bodies import Body, Mesh
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from tests.rigs import calibrated
from tests.shared import shared

SIZE_MM = (80.0, 60.0)
DENT_MM = (0.1, 4.0)
"""Depth and diameter of the dent."""
PLACE_MM = (58.0, 20.0)
"""x and y of the dent on the part, on its flat base of z = 10."""


def height_mm(x, y, dent=0.0):
    """The top of the part: a base, a block, a ramp and a dome; optionally a dent in the base."""
    z = np.full(np.broadcast(x, y).shape, 10.0)
    z = np.where((x > 6) & (x < 26) & (y > 34) & (y < 54), 16.0, z)
    z = np.where((x > 6) & (x < 36) & (y > 6) & (y < 20), 10.0 + 0.25 * (x - 6), z)
    z = np.maximum(z, np.sqrt(np.maximum(18.0**2 - (x - 58) ** 2 - (y - 44) ** 2, 0.0)) - 0.0)
    r2 = ((x - PLACE_MM[0]) ** 2 + (y - PLACE_MM[1]) ** 2) / (0.5 * DENT_MM[1]) ** 2
    return z - dent * np.maximum(1.0 - r2, 0.0)


@lru_cache
def model(dent: float = 0.0, pitch: float = 0.5) -> fw.TriangleMesh:
    """The part as a closed mesh."""
    nx, ny = (round(s / pitch) + 1 for s in SIZE_MM)
    y, x = np.meshgrid(
        np.linspace(0, SIZE_MM[1], ny), np.linspace(0, SIZE_MM[0], nx), indexing="ij"
    )
    top = np.stack((x, y, height_mm(x, y, dent)), -1).reshape(-1, 3)
    index = np.arange(nx * ny).reshape(ny, nx)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    up = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (b, d, c))])
    rim = np.concatenate((index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]))
    foot = np.arange(len(rim)) + len(top)
    middle = len(top) + len(rim)
    vertices = np.concatenate((top, top[rim] * (1, 1, 0), [[40.0, 30.0, 0.0]]))
    after, under = np.roll(rim, -1), np.roll(foot, -1)
    sides = np.concatenate((np.stack((rim, foot, after), 1), np.stack((after, foot, under), 1)))
    below = np.stack((under, foot, np.full(len(foot), middle)), 1)
    return fw.TriangleMesh(vertices, np.concatenate((up, sides, below)).astype(np.uint32))


@lru_cache
def rig(scale: float = 0.5) -> fw.Rig:
    return standard_rig(scale=scale)


def placed(turn_deg=(0.0, 0.0, 0.0)):
    """T_camera_part: the top of the part faces the camera, turned about its middle."""
    facing = np.diag([1.0, -1.0, -1.0])
    R = facing @ rotation(np.radians(np.array(turn_deg, float)))
    return pose(R, np.array([0.0, 0.0, 510.0]) - R @ np.array([40.0, 30.0, 10.0]))


@shared
def decoded(dent=0.0, turn_deg=(6.0, -5.0, 12.0), seed=0, noise=2.0, scale=0.5, pitch=0.25):
    """Coordinates of the part before the true rig, and the true pose."""
    T = placed(turn_deg)
    whole = model(dent, pitch)
    body = Body(Mesh(whole.vertices_mm, whole.faces), T, 0.75)
    plan = fringe_plan(rig(scale), both=False)
    frames = list(photograph(look(rig(scale), [body]), plan, Optics(noise=noise, seed=seed)))
    return fw.decode(frames, plan), T


def covariance():
    """Covariance of a calibration of the rig by eight poses of a board."""
    return calibrated().rig.covariance


def drawn(seed, truth=None, C=None):
    """A rig as a calibration may have found it, with its covariance."""
    C = covariance() if C is None else C
    step = np.random.default_rng(seed).multivariate_normal(np.zeros(24), C)
    return replace(moved_rig(truth or rig(), step), covariance=C)


def measured(rig_used, **how):
    """The cloud that a rig makes of the part, cleaned, and the true pose."""
    found, T = decoded(**how)
    return fw.surface.clean_cloud(fw.triangulate(found, rig_used)), T
