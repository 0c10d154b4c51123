"""Which results are surfaces, and how they are packed for the page."""

from __future__ import annotations

from typing import Any

from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.pipeline.stacks import Measurement
from fringeworks.report.viewer.pack import PackedSurface, pack_surface
from fringeworks.types import (
    CoordinateMap,
    DisplacementMap,
    HeightMap,
    Pinhole,
    PointCloud,
    Points,
    Rig,
)

Turnable = (
    Measurement | Reconstruction | PointCloud | HeightMap | CoordinateMap | DisplacementMap | Points
)
"""Results that the viewer shows."""


def is_surface(result: object) -> bool:
    """Whether the viewer shows a result."""
    return isinstance(result, Turnable)


def packed(
    result: Any, *, title: str = "", camera: Rig | Pinhole | None = None, every: int = 1
) -> PackedSurface:
    """Pack a surface; see ``pack_surface``. The camera counts for point clouds only."""
    if isinstance(result, DisplacementMap):
        result = as_heights(result)
    seen = camera if isinstance(result, Measurement | PointCloud) else None
    return pack_surface(result, title=title, camera=seen, every=every)


def as_heights(found: DisplacementMap) -> HeightMap:
    """Return a displacement map as the surface that it is drawn as, in px."""
    return HeightMap(
        found.displacement_px,
        found.sigma_px,
        found.reason,
        "displacement",
        "px",
        None,
        method=found.method,
        converged=found.converged,
    )


def comparable(results: list[Any]) -> bool:
    """Whether the viewer can show two results together: same kind, size and units."""
    if len(results) != 2 or not all(is_surface(one) for one in results):
        return False
    one, other = (surface_of(result) for result in results)
    if type(one) is not type(other) or isinstance(one, Points):
        return False
    if one.reason.shape != other.reason.shape:
        return False
    if isinstance(one, HeightMap):
        return (one.unit, one.quantity, one.pitch) == (other.unit, other.quantity, other.pitch)
    return True


def surface_of(result: Any) -> Any:
    """Return the map inside a result."""
    if isinstance(result, Measurement):
        return result.points
    if isinstance(result, Reconstruction):
        return result.surface
    return as_heights(result) if isinstance(result, DisplacementMap) else result
