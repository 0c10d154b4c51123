"""A part with areas on the virtual rig, measured, and the recipe of its step."""

from __future__ import annotations

from functools import cache

import numpy as np

import fringeworks as fw
from fringeworks.evaluate.area_points import area_points
from fringeworks.evaluate.quantities import MEASURED
from fringeworks.rig.pinhole import pose
from fringeworks.simulate.bodies import Body, Box, Cylinder, Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.stack.frames import Stack

AREAS = {
    "top": fw.evaluate.Area(box=(165, 130, 225, 175)),
    "base": fw.evaluate.Area(box=(20, 20, 100, 285)),
    "ball": fw.evaluate.Area(polygon=((275, 131), (320, 131), (320, 176), (275, 176))),
    "other": fw.evaluate.Area(box=(283, 235, 312, 264)),
    "tube": fw.evaluate.Area(box=(140, 226, 190, 250)),
}
"""Areas of the scene."""

TRUE = {
    ("flatness", "base"): 0.0,
    ("step_height", "top", "base"): 10.0,
    ("sphere_diameter", "ball"): 40.0,
    ("sphere_spacing", "ball", "other"): float(np.hypot(58.0, 0.0)),
    ("cylinder_diameter", "tube"): 30.0,
}
"""What the scene measures, mm."""


def at(x, y, z):
    return pose(np.eye(3), np.array([x, y, z], float))


@cache
def scene():
    """A block of 10 mm on a plane, two spheres and a cylinder; frames of 384 × 307 px."""
    lying = pose(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([-15.0, 48.0, 520.0]))
    bodies = [
        Body(Plane(), at(0, 0, 520), 0.7),
        Body(Box((40.0, 40.0, 10.0)), at(0, 0, 515), 0.8),
        Body(Sphere(20.0), at(55, 0, 510), 0.8),
        Body(Sphere(20.0), at(55, 58, 510), 0.8),
        Body(Cylinder(15.0, 60.0), lying, 0.8),
    ]
    rig = standard_rig(scale=0.3)
    return rig, fringe_plan(rig, both=False), look(rig, bodies)


@cache
def points(seed, noise=2.0):
    rig, plan, view = scene()
    frames = list(photograph(view, plan, Optics(noise=noise, seed=seed)))
    return fw.measure(Stack(frames, plan), rig).points


def measured(surface, key):
    quantity, *names = key
    return MEASURED[quantity](*(area_points(surface, AREAS[name]) for name in names))


def step(low, high):
    tolerance = fw.evaluate.PartTolerance("step", "step_height", ("top", "base"), low, high)
    return fw.Recipe(areas=AREAS, tolerances=(tolerance,), risk=0.01)


def plate(seed=0):
    """A flat cloud of 40 × 40 points with noise of 0.01 mm."""
    y, x = np.mgrid[:40, :40] * 0.5
    z = 500.0 + np.random.default_rng(seed).normal(0.0, 0.01, x.shape)
    sigma = np.full(x.shape, 0.01, np.float32)
    xyz = np.stack((x - 10.0, y - 10.0, z), -1).astype(np.float32)
    return fw.PointCloud(xyz, sigma, sigma, np.zeros(x.shape, np.uint8))


def share_recipe(head=None):
    """A recipe that asks for 90 % of the plate."""
    share = fw.evaluate.PartTolerance("seen", "valid_share", ("face",), 0.9, None)
    areas = {"face": fw.evaluate.Area(box=(2, 2, 37, 37))}
    return fw.Recipe(areas=areas, tolerances=(share,), head=head or {})
