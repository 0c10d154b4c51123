"""The standard scene on which methods are compared (theory §3)."""

from __future__ import annotations

from typing import Literal, Unpack

from fringeworks.simulate.fringes import PairOptions, PairSettings, capture_pair
from fringeworks.simulate.objects import make_object, paint
from fringeworks.types import MOST_PX, InputError, Pair, ReferencePlaneGeometry, finite, whole

STANDARD_GEOMETRY = ReferencePlaneGeometry(
    distance_mm=5000.0, baseline_mm=2000.0, pitch_mm_per_px=1.0
)
"""Geometry of the standard scene: l and d₀ of the dissertation, and our choice of the pitch (theory
§3)."""
STANDARD_SIZE_PX = 1000
"""Side of the standard scene's frame, px; our choice, as the dissertation does not print it."""
STANDARD_RADIUS_PX = 350.0
"""Radius of the body's base in a frame of 1000 px, px: it leaves the reference plane visible all
around."""
MIN_SIZE_PX = 16
"""Smallest side of a frame, px: below, ten fringes have less than two pixels each."""


def standard_scene(
    name: str = "parabola",
    *,
    size: int = 1000,
    height_mm: float = 100.0,
    painted: bool = False,
    sign: Literal[1, -1] = 1,
    **settings: Unpack[PairOptions],
) -> Pair:
    """Simulate a pair of the standard scene: 1000 × 1000 px of 1 mm, l = 5000 mm, d₀ = 2000 mm.

    Parameters
    ----------
    name : str
        A key of ``OBJECTS``.
    size : int ≥ 16
        Side of the frame, px. Body and displacement keep their size relative to the frame, and the
        pitch changes accordingly.
    height_mm : float
        Largest height, mm.
    painted : bool
        Whether the object has the albedo of ``paint`` instead of 1.
    sign : +1 or −1
        Side on which the projector is; see ``ReferencePlaneGeometry.sign``.
    **settings
        Fields of ``PairSettings``.

    Returns
    -------
    Pair with the true height.

    Raises
    ------
    InputError for an unknown body, a frame that is too small, and settings out of their range.

    Examples
    --------
    >>> scene = standard_scene("parabola", size=100, gamma=2.2, bits=8, noise=2, seed=1)
    >>> scene.reference.dtype, scene.object.shape
    (dtype('uint8'), (100, 100))
    """
    if not whole(size, MIN_SIZE_PX, MOST_PX):
        raise InputError(f"size: expected at least {MIN_SIZE_PX} px, at most {MOST_PX}, got {size}")
    if not finite(height_mm):
        raise InputError(f"height_mm: expected a finite value, got {height_mm}")
    if sign not in (1, -1):
        raise InputError(f"sign: expected +1 or -1, got {sign}")
    scale = size / STANDARD_SIZE_PX
    geometry = ReferencePlaneGeometry(
        distance_mm=STANDARD_GEOMETRY.distance_mm,
        baseline_mm=STANDARD_GEOMETRY.baseline_mm,
        pitch_mm_per_px=STANDARD_GEOMETRY.pitch_mm_per_px / scale,
        sign=sign,
    )
    body = make_object(
        name,
        (size, size),
        height_mm=height_mm,
        radius_px=STANDARD_RADIUS_PX * scale,
        pitch_mm_per_px=geometry.pitch_mm_per_px,
    )
    fringe_settings = PairSettings(**settings)
    albedo = paint(body.shape, seed=fringe_settings.seed) if painted else 1.0
    return capture_pair(body, geometry, fringe_settings, albedo=albedo)
