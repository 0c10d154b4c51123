"""Height maps of simple bodies standing on the reference plane (theory §3)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fringeworks.types import FloatMap, InputError

Shape = Callable[[FloatMap, FloatMap, float], FloatMap]
"""Relative height (0…1) from x/R, y/R and the relative height unit h_max/R."""


def parabola_1d(n: int = 1001, height_mm: float = 100.0) -> FloatMap:
    """The dissertation's one-dimensional parabola, support 250…750 of 1001 samples.

    h = h_max · max(0, 1 − ((t − N/2)/(N/4))²) with N = n − 1; the printed formula is ambiguous
    (theory §3).
    """
    if n < 8:
        raise InputError(f"n: expected at least 8 samples, got {n}")
    t = np.arange(n, dtype=np.float64)
    quarter = (n - 1) / 4.0
    return height_mm * np.maximum(0.0, 1.0 - ((t - 2.0 * quarter) / quarter) ** 2)


def _parabola(x: FloatMap, y: FloatMap, _: float) -> FloatMap:
    return np.maximum(0.0, 1.0 - x * x - y * y)


def _cube(x: FloatMap, y: FloatMap, _: float) -> FloatMap:
    return ((np.abs(x) <= 1.0) & (np.abs(y) <= 1.0)).astype(np.float64)


def _cylinder(x: FloatMap, y: FloatMap, _: float) -> FloatMap:
    return np.sqrt(np.maximum(0.0, 1.0 - x * x)) * (np.abs(y) <= 1.0)


def _sphere(x: FloatMap, y: FloatMap, relative_height: float) -> FloatMap:
    # A cap of base radius R and height h belongs to a ball of radius (R² + h²) / 2h.
    h = relative_height
    ball = (1.0 + h * h) / (2.0 * h)
    r2 = x * x + y * y
    cap = np.sqrt(np.maximum(0.0, ball * ball - r2)) - (ball - h)
    return np.where(r2 <= 1.0, np.maximum(0.0, cap), 0.0) / h


def _plane(x: FloatMap, y: FloatMap, _: float) -> FloatMap:
    return np.zeros(np.broadcast_shapes(x.shape, y.shape))


def _tilt(x: FloatMap, y: FloatMap, _: float) -> FloatMap:
    return np.broadcast_to(0.5 + 0.25 * (x + y), np.broadcast_shapes(x.shape, y.shape)).copy()


def _step(x: FloatMap, y: FloatMap, _: float) -> FloatMap:
    return np.broadcast_to(x > 0.0, np.broadcast_shapes(x.shape, y.shape)).astype(np.float64)


OBJECTS: dict[str, Shape] = {
    "parabola": _parabola,
    "cube": _cube,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "plane": _plane,
    "tilt": _tilt,
    "step": _step,
}
"""Bodies by name: paraboloid of revolution, box, cylinder lying on the plane with its axis along
y, cap of a sphere, the bare plane, a tilted plane, a step half way across."""


def make_object(
    name: str,
    shape: tuple[int, int] = (1000, 1000),
    *,
    height_mm: float = 100.0,
    radius_px: float = 350.0,
    pitch_mm_per_px: float = 1.0,
    centre_px: tuple[float, float] | None = None,
) -> FloatMap:
    """Height map of a named body.

    Parameters
    ----------
    name : str
        A key of ``OBJECTS``.
    shape : (h, w)
    height_mm : float
        Largest height; negative for a hollow.
    radius_px : float > 0
        Base radius, or half the side of the base.
    pitch_mm_per_px : float > 0
        Only the sphere needs it: its curvature ties height and radius together.
    centre_px : (x, y), optional
        Position of the body's centre; the frame's centre by default.

    Returns
    -------
    (h, w) float64 array, mm.

    Examples
    --------
    >>> float(make_object("cube", (10, 10), height_mm=5, radius_px=3).sum())
    180.0
    """
    if name not in OBJECTS:
        raise InputError(f"object: expected one of {', '.join(OBJECTS)}, got {name!r}")
    h, w = shape
    if h < 1 or w < 1 or not radius_px > 0:
        raise InputError(
            f"object: expected a shape of at least (1, 1) and a radius > 0, "
            f"got {shape} and {radius_px}"
        )
    relative_height = abs(height_mm) / (radius_px * pitch_mm_per_px)
    if name == "sphere" and not 0 < relative_height <= 1:
        raise InputError(
            f"sphere: expected a height between 0 and its base radius of "
            f"{radius_px * pitch_mm_per_px:g} mm, got {height_mm:g}"
        )
    cx, cy = ((w - 1) / 2.0, (h - 1) / 2.0) if centre_px is None else centre_px
    x = (np.arange(w, dtype=np.float64) - cx)[None, :] / radius_px
    y = (np.arange(h, dtype=np.float64) - cy)[:, None] / radius_px
    return height_mm * OBJECTS[name](x, y, relative_height)


def paint(shape: tuple[int, int], *, darkest: float = 0.5, seed: int = 0) -> FloatMap:
    """An albedo map as of a painted body: a dark stripe, a dark disc and soft blotches.

    Parameters
    ----------
    shape : (h, w)
    darkest : float, 0…1
        Albedo of the darkest paint.
    seed : int

    Returns
    -------
    (h, w) float64 array, darkest…1.
    """
    if not 0 < darkest <= 1:
        raise InputError(f"darkest: expected 0 to 1, got {darkest}")
    h, w = shape
    y = np.linspace(-1.0, 1.0, h)[:, None]
    x = np.linspace(-1.0, 1.0, w)[None, :]
    stripe = np.abs(x + 0.5 * y + 0.3) < 0.1
    disc = (x - 0.3) ** 2 + (y + 0.25) ** 2 < 0.15**2
    rng = np.random.default_rng(seed)
    blotches = np.zeros(shape)
    for _ in range(6):
        cx, cy = rng.uniform(-1, 1, 2)
        blotches += np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / 0.1)
    soft = 1.0 - (1.0 - darkest) * 0.5 * np.minimum(blotches, 1.0)
    return np.where(stripe | disc, darkest, soft)
