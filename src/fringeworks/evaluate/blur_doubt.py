"""Points of a rig whose blur is not known: their σ holds what a usual blur does."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar, cast

import numpy as np

from fringeworks.surface.camera_blur import doubt_blur
from fringeworks.types import BoolMap, HeightMap, PointCloud, Points, Rig

AROUND_PX = 8
"""Pixels around the wanted ones that are looked at: blur and the windows of ``remove_blur`` reach
half as far."""

Surface = TypeVar("Surface", bound=HeightMap | PointCloud | Points)


def with_blur_doubt(surface: Surface, rig: Rig | None, wanted: BoolMap | None = None) -> Surface:
    """Return a surface whose σ holds the blur of its camera.

    It is the same where that blur was removed, and where it cannot be computed: heights, points
    without brightness, points that were moved, and rigs that are not known. Only the rectangle
    around the ``wanted`` pixels is computed, if they are given.
    """
    if rig is None or not isinstance(surface, PointCloud):
        return surface
    if surface.blur_mm is not None or surface.colour is None or surface.placement is not None:
        return surface
    options = {} if surface.provenance is None else surface.provenance.options
    part = _around(surface.shape, wanted)
    some = PointCloud(
        surface.xyz_mm[part],
        surface.sigma_mm[part],
        surface.noise_mm[part],
        surface.reason[part],
        colour=surface.colour[part],
    )
    found = doubt_blur(some, rig, removed_px=float(options.get("removed_blur_px", 0.0)))
    assert found.blur_mm is not None
    sigma, blur = surface.sigma_mm.copy(), np.zeros(surface.shape, np.float32)
    sigma[part], blur[part] = found.sigma_mm, found.blur_mm
    return cast(Surface, replace(surface, sigma_mm=sigma, blur_mm=blur))


def _around(shape: tuple[int, int], wanted: BoolMap | None) -> tuple[slice, slice]:
    if wanted is None or not wanted.any():
        return slice(0, shape[0]), slice(0, shape[1])
    ends = [np.flatnonzero(wanted.any(axis=1 - k))[[0, -1]] for k in range(2)]
    rows, columns = (slice(max(int(a) - AROUND_PX, 0), int(b) + AROUND_PX + 1) for a, b in ends)
    return rows, columns
