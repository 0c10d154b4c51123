"""A turntable with a board before the virtual rig."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import fringeworks as fw
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate.standard import standard_rig

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
