"""Surfaces of a report: which results the viewer turns, and how they are packed for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from fringeworks.report.kind import kind_of
from fringeworks.report.page.blocks import Surface
from fringeworks.report.page.chapter import Context
from fringeworks.types import (
    DisplacementMap,
    HeightMap,
    Pinhole,
    PointCloud,
    Points,
    Rig,
    TriangleMesh,
)

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure
    from fringeworks.report.viewer.pack import PackedSurface

DRAWN_AS = (DisplacementMap, TriangleMesh)
"""Results that the viewer turns as the surface that their kind makes of them."""


def is_surface(result: object) -> bool:
    """Whether the viewer shows a result."""
    return kind_of(result).surface is not None


def surface_of(result: Any) -> Any:
    """Return the map inside a result; what is no surface is returned as it is."""
    surface = kind_of(result).surface
    return result if surface is None else surface(result)


def surface_block(
    result: Any, context: Context, caption: str, draw: Callable[[], Figure]
) -> Surface:
    """A surface to turn, and what is drawn of it in a PDF."""

    def pack() -> PackedSurface:
        # The chapter lists the findings; each is said once.
        return packed(
            result, title=context.name, camera=context.rig, every=context.every, own_notes=False
        )

    return Surface((pack,), f"{caption}{thinned_words(result, context.every)}", draw)


def thinning(result: Any, every: int) -> int:
    """Every how many-th column and row a page shows: as many as are asked for, or as it holds."""
    from fringeworks.report.viewer.content import enough_thinned  # for those only who turn them

    reason = getattr(surface_of(result), "reason", None)
    return every if reason is None or reason.ndim != 2 else enough_thinned(reason.size, every)


def thinned_words(result: Any, every: int) -> str:
    """What a page says of a surface that it thins."""
    used, reason = thinning(result, every), getattr(surface_of(result), "reason", None)
    if used == 1 or reason is None or reason.ndim != 2:
        return ""
    rows, columns = reason.shape
    return f" Shown: one of {used} columns and rows of {columns:,} × {rows:,} px."


def packed(
    result: Any,
    *,
    title: str = "",
    camera: Rig | Pinhole | None = None,
    every: int = 1,
    own_notes: bool = True,
) -> PackedSurface:
    """Pack a surface; see ``pack_surface``. The camera counts for point clouds only."""
    from fringeworks.report.viewer.pack import pack_surface  # for those only who turn surfaces

    seen = camera if isinstance(surface_of(result), PointCloud) else None
    if isinstance(result, DRAWN_AS):
        result = surface_of(result)
    used = thinning(result, every)
    return pack_surface(result, title=title, camera=seen, every=used, own_notes=own_notes)


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
