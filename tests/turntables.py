"""A turntable with a board before the virtual rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

import fringeworks as fw
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate.bodies import Body
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import FloatMap
from tests.turntable import on_table

BOARD = fw.rig.parse_board("charuco:10x10:20:15")

T_table_board = pose(rotation(np.array([0.0, 0.0, 0.2])), np.array([-97.0, -103.0, 0.0]))


@cache
def rig():
    base = standard_rig(scale=0.4)
    camera, projector = (
        replace(d, focal_px=tuple(0.75 * f for f in d.focal_px))
        for d in (base.camera, base.projector)
    )
    return fw.Rig(camera, projector, base.T_projector_camera)


def clouds_on_table(
    bodies: Sequence[Body], poses: Sequence[FloatMap], *, exposure: float, seed: int
) -> list[fw.PointCloud]:
    """Clouds of bodies on the table in every pose, measured with noise."""
    plan, clouds = fringe_plan(rig(), both=False), []
    for k, T in enumerate(poses):
        optics = Optics(exposure=exposure, noise=1.0, seed=100 * seed + k)
        frames = np.stack(list(photograph(look(rig(), on_table(bodies, T)), plan, optics)))
        clouds.append(fw.measure(fw.Stack(frames, plan), rig()).points)
    return clouds
