"""Height maps of simple bodies standing on the reference plane (theory §3)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fringeworks.types import FloatMap, InputError

HeightFunction = Callable[[FloatMap, FloatMap, float], FloatMap]
"""Height over the largest height (0…1), as a function of x/R, y/R and h_max/R."""


def parabola_1d(n: int = 1001, height_mm: float = 100.0) -> FloatMap:
    """Compute the dissertation's one-dimensional parabola.

    Parameters
    ----------
    n : int ≥ 8
        Number of samples.
    height_mm : float
        Largest height, mm.

    Returns
    -------
    (n,) array, mm; above 0 in the middle half, which is 250…750 of 1001 samples.

    Raises
    ------
    InputError for fewer than 8 samples.

    Notes
    -----
    h = h_max · max(0, 1 − ((t − N/2)/(N/4))²) with N = n − 1. The printed formula is ambiguous
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
    # A cap with base radius R and height h belongs to a ball of radius (R² + h²) / 2h.
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


OBJECTS: dict[str, HeightFunction] = {
    "parabola": _parabola,
    "cube": _cube,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "plane": _plane,
    "tilt": _tilt,
    "step": _step,
}
"""Bodies by name: a paraboloid of revolution, a box, half a cylinder with its axis along y, the cap
of a sphere, the bare reference plane, a tilted plane, a step in the middle."""


def make_object(
    name: str,
    shape: tuple[int, int] = (1000, 1000),
    *,
    height_mm: float = 100.0,
    radius_px: float = 350.0,
    pitch_mm_per_px: float = 1.0,
    centre_px: tuple[float, float] | None = None,
) -> FloatMap:
    """Compute the height map of a named body.

    Parameters
    ----------
    name : str
        A key of ``OBJECTS``.
    shape : (h, w)
        Rows and columns.
    height_mm : float
        Largest height, mm; negative for a hollow.
    radius_px : float > 0
        Radius of the base, or half its side, px.
    pitch_mm_per_px : float > 0
        Size of a pixel. Only the sphere needs it, because its height and its radius are lengths in
        one equation.
    centre_px : (x, y), optional
        Position of the body's centre, px; the frame's centre by default.

    Returns
    -------
    (h, w) float64 array, mm.

    Raises
    ------
    InputError for an unknown name, an empty shape, a radius that is not above 0, and a sphere
    higher than its base radius.

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
            f"object: expected a shape of at least (1, 1) and a radius > 0 px, "
            f"got {shape} and {radius_px} px"
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
    """Simulate the albedo of a painted body: a dark stripe, a dark disc and soft blotches.

    Parameters
    ----------
    shape : (h, w)
        Rows and columns.
    darkest : float, 0…1
        Albedo of the darkest paint; > 0.
    seed : int
        Seed of the positions of the blotches.

    Returns
    -------
    (h, w) float64 array, darkest…1.

    Raises
    ------
    InputError for an albedo out of its range.
    """
    if not 0 < darkest <= 1:
        raise InputError(f"darkest: expected above 0 and up to 1, got {darkest}")
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
