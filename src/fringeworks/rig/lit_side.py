"""Whether the projector lights the side of a surface that the camera sees."""

from __future__ import annotations

import numpy as np

from fringeworks.rig.pinhole import inverse
from fringeworks.types import PointCloud, Rig, RigMismatch

REACH_PX = 4
"""Distance of the pixels on both sides that tell the slope of a surface, px: noise turns the
normals of a ball by a few degrees only, and edges spoil few."""
CHECKED = 200
"""Approximate number of rows, and of columns, whose normals are computed."""
FEWEST = 300
"""Smallest number of normals for a judgement."""
MOST_BEHIND = 0.9
"""Share of normals that face away from the projector from which on the rig is refused. Right rigs
have below 0.001, also with noise of 8 counts, and mirrored frames over 0.999, in simulations."""


def refuse_wrong_side(points: PointCloud, rig: Rig) -> None:
    """Refuse points of surfaces that the projector would have to light from behind.

    Frames of a mirrored camera, or of a projector that mirrors its pictures, give such points. A
    plan along one axis has no other sign of it: all rays meet.

    Parameters
    ----------
    points : PointCloud
        In camera coordinates.
    rig : Rig

    Raises
    ------
    RigMismatch
    """
    height, width = points.shape
    if min(height, width) <= 2 * REACH_PX:
        return
    r = REACH_PX
    v = np.arange(r, height - r, max(1, height // CHECKED))[:, None]
    u = np.arange(r, width - r, max(1, width // CHECKED))[None]
    place = np.asarray(points.xyz_mm[v, u], np.float64)
    across = points.xyz_mm[v, u + r] - points.xyz_mm[v, u - r]
    down = points.xyz_mm[v + r, u] - points.xyz_mm[v - r, u]
    normal = np.cross(across.astype(np.float64), down.astype(np.float64))
    # Of both directions, the one that faces the camera.
    facing = -np.sign(np.sum(normal * place, axis=-1))
    lamp = inverse(rig.T_projector_camera)[:3, 3]
    lit = facing * np.sum(normal * (lamp - place), axis=-1)
    known = np.isfinite(lit)
    count = int(np.count_nonzero(known))
    share = np.count_nonzero(lit[known] < 0) / max(count, 1)
    if count >= FEWEST and share > MOST_BEHIND:
        raise RigMismatch(
            f"rig: the projector would light {share:.0%} of the surface from behind: the frames "
            "are those of a mirrored camera, or the projector mirrors its pictures, which a plan "
            "says by mirrored"
        )
