"""How the points of a surface follow from one number per pixel, and how exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from fringeworks.report.viewer.coding import Blocks, coded
from fringeworks.rig.pinhole import project_with_derivatives, rays
from fringeworks.types import BoolMap, FloatMap, InputError, Pinhole

ALLOWED_SIGMAS = 0.125
"""Largest distance of a packed point from the measured one, in its σ: not visible in any figure
that σ belongs to. The step is twice that."""
MARGINS = (0.98, 0.8, 0.4)
"""Parts of the allowed step that are tried one after the other. The rest is for what the camera
model leaves: points in single precision lie up to 1e-5 mm beside their rays."""
FITTED_PIXELS = 4000
"""Number of pixels, about, that a camera is fitted to: its nine values need no more."""
FITTED_PX = 0.5
"""Largest distance of a point's image from its pixel at which a fitted camera is used, px, for the
places of pixels without a value."""


@dataclass(frozen=True)
class Lattice:
    """The pixels of a surface and how they look into space."""

    place: dict[str, Any]
    """What the page computes points from."""
    directions: FloatMap | None
    """Points are these times z, plus ``offsets``, (h, w, 3); None where there is no such rule."""
    offsets: FloatMap
    """Points at z = 0, (h, w, 3) or broadcast to it."""


def camera_lattice(shape: tuple[int, int], camera: Pinhole, every: int) -> Lattice:
    """Points on the rays of a camera's pixels, of which every k-th one is used."""
    row, column = (every * index.astype(np.float64) for index in np.indices(shape))
    directions = rays(camera, np.stack((column, row), axis=-1))
    place = {"kind": "camera", "camera": camera.parameters.tolist(), "every": every}
    return Lattice(place, directions, np.zeros(3))


def plane_lattice(
    shape: tuple[int, int], pitch: float, pupil: tuple[float, float, float] | None
) -> Lattice:
    """Points over a plane: x right, y up, z towards the camera, as ``height_map_points``."""
    row, column = (index.astype(np.float64) for index in np.indices(shape))
    zero = np.zeros(shape)
    slope_x, slope_y = zero, zero
    if pupil is not None:
        foot_x, foot_y, distance = pupil
        slope_x, slope_y = -(column - foot_x) / distance, -(row - foot_y) / distance
    directions = np.stack((slope_x * pitch, -slope_y * pitch, zero + 1.0), axis=-1)
    offsets = np.stack((column * pitch, -row * pitch, zero), axis=-1)
    place = {"kind": "plane", "pitch": pitch, "pupil": None if pupil is None else list(pupil)}
    return Lattice(place, directions, offsets)


def fitted_camera(points: FloatMap) -> Pinhole | None:
    """The camera whose pixels see the points of a cloud, with its lens distortion.

    Parameters
    ----------
    points : (h, w, 3) array
        NaN where unmeasured.

    Returns
    -------
    Pinhole; None where no camera sees the points at their pixels.
    """
    rows, columns = points.shape[:2]
    row, column = np.nonzero(np.isfinite(points[..., 2]) & (points[..., 2] > 0))
    part = slice(None, None, max(1, len(row) // FITTED_PIXELS))
    row, column = row[part], column[part]
    if min(rows, columns) < 2 or len(np.unique(row)) < 2 or len(np.unique(column)) < 2:
        return None
    seen, pixels = points[row, column], np.column_stack((column, row)).astype(np.float64)
    start = np.zeros(9)
    for k in range(2):
        start[[k, 2 + k]] = np.polyfit(seen[:, k] / seen[:, 2], pixels[:, k], 1)
    if not min(start[:2]) > 0:
        return None

    def camera(values: FloatMap) -> Pinhole:
        fx, fy, cx, cy, *distortion = (float(v) for v in values)
        lens = (distortion[0], distortion[1], distortion[2], distortion[3], distortion[4])
        return Pinhole(columns, rows, (fx, fy), (cx, cy), lens)

    def residual(values: FloatMap) -> FloatMap:
        found, _, _ = project_with_derivatives(camera(values), seen)
        return np.asarray((found - pixels).ravel())

    def slope(values: FloatMap) -> FloatMap:
        _, _, by_device = project_with_derivatives(camera(values), seen)
        return np.asarray(by_device.reshape(-1, 9))

    try:
        solved = optimize.least_squares(residual, start, slope, x_scale="jac")
        usable = np.isfinite(solved.fun).all() and np.abs(solved.fun).max() < FITTED_PX
        return camera(solved.x) if usable else None
    except (InputError, ValueError, np.linalg.LinAlgError):
        return None


def place_points(
    blocks: Blocks,
    points: FloatMap,
    measured: BoolMap,
    low_sigma: FloatMap,
    lattice: Lattice | None,
) -> dict[str, Any]:
    """Write the points in the shortest form that keeps them within σ/8.

    Parameters
    ----------
    blocks : Blocks
        Written to.
    points : (h, w, 3) float64
    measured : (h, w) bool
    low_sigma : (h, w) float64
        σ of every pixel or a little less, as the page knows it, mm; NaN where unknown.
    lattice : Lattice, optional
        How points follow from z.

    Returns
    -------
    Header: ``place`` (pixels to space) and ``points`` (which numbers, steps over σ, blocks). Pixels
    of unknown σ have the finest step. Where no σ is known, some are 0, or steps do not suffice, the
    points are written as they are, in single or double precision.
    """
    known = measured & np.isfinite(low_sigma)
    place = None if lattice is None else lattice.place
    if known.any() and (low_sigma[known] > 0).all():
        sigma = np.where(known, low_sigma, low_sigma[known].min())
        for attempt in (_along_rays, _coordinates):
            content = attempt(blocks, points, measured, sigma, lattice)
            if content is not None:
                return {"place": place, "points": content}
    exact = points[measured]
    if np.array_equal(exact.astype(np.float32), exact):
        exact = exact.astype(np.float32)
    places = [blocks.add_planes(exact[:, k]) for k in range(3)]
    return {"place": place, "points": {"coding": exact.dtype.name, "blocks": places}}


def _along_rays(
    blocks: Blocks, points: FloatMap, measured: BoolMap, sigma: FloatMap, lattice: Lattice | None
) -> dict[str, Any] | None:
    """z in steps of σ; None where the points do not lie on the lattice's rays."""
    if lattice is None or lattice.directions is None:
        return None
    stretch = float(np.linalg.norm(lattice.directions[measured], axis=1).max())
    origin = float(np.median(points[measured, 2]))
    for margin in MARGINS:
        factor = 2.0 * ALLOWED_SIGMAS * margin / stretch
        try:
            symbols, z = coded(points[..., 2], factor * sigma, measured, origin)
        except InputError:
            return None
        found = lattice.directions * z[..., None] + lattice.offsets
        if _within(found, points, sigma, measured):
            places = [blocks.add_planes(symbols)]
            return {"coding": "z", "factor": factor, "origins": [origin], "blocks": places}
    return None


def _coordinates(
    blocks: Blocks, points: FloatMap, measured: BoolMap, sigma: FloatMap, _: Lattice | None
) -> dict[str, Any] | None:
    """Three coordinates in steps of σ; None where the steps are too small for their range."""
    factor = 2.0 * ALLOWED_SIGMAS * MARGINS[0] / np.sqrt(3.0)
    origins = [float(v) for v in np.median(points[measured], axis=0)]
    try:
        found = [
            coded(points[..., k], factor * sigma, measured, origin)
            for k, origin in enumerate(origins)
        ]
    except InputError:
        return None
    if not _within(np.stack([values for _, values in found], axis=-1), points, sigma, measured):
        return None
    places = [blocks.add_planes(symbols) for symbols, _ in found]
    return {"coding": "xyz", "factor": factor, "origins": origins, "blocks": places}


def _within(found: FloatMap, points: FloatMap, sigma: FloatMap, measured: BoolMap) -> bool:
    error = np.linalg.norm((found - points)[measured], axis=1)
    return bool((error <= ALLOWED_SIGMAS * sigma[measured]).all())
