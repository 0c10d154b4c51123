"""Points of a rig whose blur is not known: their σ holds what a usual blur does."""

from __future__ import annotations

from typing import TypeVar, cast

from fringeworks.surface.camera_blur import doubt_blur
from fringeworks.types import HeightMap, PointCloud, Points, Rig

Surface = TypeVar("Surface", bound=HeightMap | PointCloud | Points)


def with_blur_doubt(surface: Surface, rig: Rig | None) -> Surface:
    """Return a surface whose σ holds the blur of its camera.

    It is the same where that blur was removed, and where it cannot be computed: heights, points
    without brightness, points that were moved, and rigs that are not known.
    """
    if rig is None or not isinstance(surface, PointCloud):
        return surface
    if surface.blur_mm is not None or surface.colour is None or surface.placement is not None:
        return surface
    options = {} if surface.provenance is None else surface.provenance.options
    found = doubt_blur(surface, rig, removed_px=float(options.get("removed_blur_px", 0.0)))
    return cast(Surface, found)
