"""Frames of a wavy surface, taken again and again by one rig."""

from __future__ import annotations

import numpy as np

import fringeworks as fw
from fringeworks.rig.pinhole import project, rays, transform

COUNTS = (1, 8, 64)


def plan_of(axes="x", width=640, height=400, steps=4):
    length = {"x": width, "y": height}
    return fw.PatternPlan(
        width,
        height,
        tuple(
            fw.patterns.PhaseSteps(a, length[a] / v, fw.patterns.equal_steps(steps))
            for a in axes
            for v in COUNTS
        ),
    )


def rig_of(shape=(161, 233)):
    """Distorted camera and projector above a scene at 500 mm."""
    from fringeworks.rig.pinhole import look_at

    h, w = shape
    camera = fw.rig.Pinhole(w, h, (1900.0, 1900.0), (w / 2, h / 2), (-0.1, 0.1, 1e-4, 1e-4, 0.0))
    projector = fw.rig.Pinhole(
        640, 400, (1300.0, 1300.0), (320.0, 200.0), (-0.05, 0.04, 1e-4, 1e-4, 0)
    )
    sigma = np.array([0.05, 0.05, 0.1, 0.1, *[1e-4] * 5] * 2 + [1e-6] * 3 + [1e-3] * 3)
    pose = look_at(np.array([150.0, 20.0, 0.0]), np.array([0.0, 0.0, 500.0]))
    return fw.Rig(camera, projector, pose, np.diag(sigma**2), (0.01, 0.01))


def captured(plan, rig, *, seed=0, step_mm=30.0, gain=200.0, shift_mm=0.0, shadow=0.01):
    """Frames of a wavy surface with a cliff, pixels that see two depths, and shadow with a share of
    the light, in noise of two counts."""
    h, w = rig.camera.shape
    v, u = np.mgrid[:h, :w].astype(float)
    depth = 500.0 + shift_mm + 8.0 * np.sin(u / 30.0) + step_mm * (u > 0.6 * w)
    ray = rays(rig.camera, np.stack((u, v), axis=-1))
    surfaces = []
    for z in (depth, depth + 6.0):
        points = ray * z[..., None]
        surfaces.append(project(rig.projector, transform(rig.T_projector_camera, points)))
    pixels, others = surfaces
    mixed = np.where((u == int(0.6 * w)) & np.isin(v, (h // 8, h // 2)), 0.5, 0.0)
    rng = np.random.default_rng(seed)
    frames = []
    for block in plan.blocks:
        axis = 0 if block.axis == "x" else 1
        at = pixels[..., axis]
        for k in range(block.frames):
            values = block.values(at, k) * (1 - mixed) + block.values(others[..., axis], k) * mixed
            light = 20.0 + gain * values * np.where(v > 0.9 * h, shadow, 1.0)
            frames.append(np.clip(np.rint(light + 2.0 * rng.standard_normal(at.shape)), 0, 255))
    return [frame.astype(np.uint8) for frame in frames]
