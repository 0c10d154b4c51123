"""The standard scene on which methods are compared (theory §3)."""

from __future__ import annotations

from typing import Any, Literal

from fringeworks.simulate.fringes import PairSettings, capture_pair
from fringeworks.simulate.objects import make_object, paint
from fringeworks.types import InputError, Pair, ReferencePlaneGeometry

STANDARD_GEOMETRY = ReferencePlaneGeometry(
    distance_mm=5000.0, baseline_mm=2000.0, pitch_mm_per_px=1.0
)


def standard_scene(
    name: str = "parabola",
    *,
    size: int = 1000,
    height_mm: float = 100.0,
    painted: bool = False,
    sign: Literal[1, -1] = 1,
    **settings: Any,
) -> Pair:
    """A body on the standard scene: 1000 × 1000 px of 1 mm, l = 5000 mm, d₀ = 2000 mm.

    Parameters
    ----------
    name : str
        A key of ``OBJECTS``.
    size : int
        Frame side, px; body and displacement keep their size relative to the frame.
    height_mm : float
        Largest height.
    painted : bool
        Give the frame of the object an albedo map (``paint``).
    sign : +1 or −1
        Side on which the projector stands.
    **settings
        Fields of ``PairSettings``.

    Examples
    --------
    >>> scene = standard_scene("parabola", size=100, gamma=2.2, bits=8, noise=2, seed=1)
    >>> scene.reference.dtype, scene.object.shape
    (dtype('uint8'), (100, 100))
    """
    scale = max(size, 1) / 1000.0
    geometry = ReferencePlaneGeometry(
        distance_mm=STANDARD_GEOMETRY.distance_mm,
        baseline_mm=STANDARD_GEOMETRY.baseline_mm,
        pitch_mm_per_px=STANDARD_GEOMETRY.pitch_mm_per_px / scale,
        sign=sign,
    )
    if size < 16:
        raise InputError(f"size: expected at least 16 px, got {size}")
    body = make_object(
        name,
        (size, size),
        height_mm=height_mm,
        radius_px=350.0 * scale,
        pitch_mm_per_px=geometry.pitch_mm_per_px,
    )
    fringe_settings = PairSettings(**settings)
    albedo = paint(body.shape, seed=fringe_settings.seed) if painted else 1.0
    return capture_pair(body, geometry, fringe_settings, albedo=albedo)
