"""How the points of a surface follow from one number per pixel, and how exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.polynomial import chebyshev, polynomial

from fringeworks.report.viewer.coding import Blocks, coded
from fringeworks.rig.pinhole import project_with_derivatives, rays
from fringeworks.types import BoolMap, FloatMap, InputError, Pinhole

ALLOWED_SIGMAS = 0.125
"""Largest distance of a packed point from the measured one, in its σ: not visible in any figure
that σ belongs to. The step is twice that."""
MARGINS = (0.98, 0.8, 0.4)
"""Parts of the allowed step that are tried one after the other. The rest is for what the camera
model leaves: points in single precision lie up to 1e-5 mm beside their rays."""
RAY_DEGREE = 13
"""Degree of the polynomials in column and row that stand for a camera's rays. For a lens that bends
rays by 10 % at the corner they leave 1e-8 of the depth."""
FIT_NODES = 32
"""Chebyshev nodes in each direction to which the polynomials are fitted: twice the degree and
more, so that nodes beyond the lens's field may be missing."""
SAME_DIRECTION = 1e-12
"""Spread of the rays' directions up to which all points lie behind each other, rad: rounding alone
spreads them by 1e-16, the pixels of any camera by 1e-3."""
FITTED_PIXELS = 4000
"""Number of pixels, about, that a camera is fitted to: its nine values need no more."""
FITTED_PX = 0.5
"""Largest distance of a point's image from its pixel at which a fitted camera is used, px, for the
places of pixels without a value."""


@dataclass(frozen=True)
class Lattice:
    """The pixels of a surface and how they look into space."""

    place: dict[str, Any]
    """What the page computes points from: polynomials of the directions and of the offsets."""
    directions: FloatMap | None
    """Points are these times z, plus ``offsets``, (h, w, 3); None where there is no such rule."""
    offsets: FloatMap
    """Points at z = 0, (h, w, 3) or broadcast to it."""
    pitch: float = 0.0
    """Distance of neighbours over a plane, in the unit of x and y; 0 for a camera."""


def camera_lattice(shape: tuple[int, int], camera: Pinhole, every: int) -> Lattice:
    """Points on the rays of a camera's pixels, of which every k-th one is used."""
    # The page needs no lens model: polynomials follow the rays to far less than a pixel.
    nodes = np.cos(np.pi * (np.arange(FIT_NODES) + 0.5) / FIT_NODES)
    u, v = np.meshgrid(nodes, nodes)
    rows, columns = shape
    column, row = ((place + 1.0) * size / 2.0 for place, size in ((u, columns), (v, rows)))
    seen = rays(camera, every * np.stack((column, row), axis=-1))[..., :2]
    fitted = _chebyshev_fit(seen, nodes)
    side = RAY_DEGREE + 1
    change = np.zeros((side, side))  # from Chebyshev's polynomials to powers
    for k in range(side):
        change[: k + 1, k] = chebyshev.cheb2poly(np.eye(side)[k, : k + 1])
    directions = [change @ fitted[..., k] @ change.T for k in range(2)]
    return _lattice(shape, directions, [np.zeros((1, 1))] * 2)


def _chebyshev_fit(values: FloatMap, nodes: FloatMap) -> FloatMap:
    """Least squares of Chebyshev's polynomials to values at a grid of nodes, (rows, columns, k).

    Returns
    -------
    Coefficients, (power of the column, power of the row, k). NaN count as missing.
    """
    known = np.isfinite(values).all(axis=-1)
    if known.all():
        # On the whole grid the fit is one of rows after one of columns.
        inverse = np.linalg.pinv(chebyshev.chebvander(nodes, RAY_DEGREE))
        return np.asarray(np.einsum("ic,jr,rck->ijk", inverse, inverse, values, optimize=True))
    u, v = np.meshgrid(nodes, nodes)
    terms = chebyshev.chebvander2d(u[known], v[known], [RAY_DEGREE, RAY_DEGREE])
    solved = np.linalg.lstsq(terms, values[known], rcond=None)[0]
    return np.asarray(solved.reshape(RAY_DEGREE + 1, RAY_DEGREE + 1, -1))


def _lattice(
    shape: tuple[int, int], directions: Sequence[FloatMap], offsets: Sequence[FloatMap]
) -> Lattice:
    """A lattice of polynomials: [power of the column, power of the row], both scaled to −1…1."""
    rows, columns = shape
    u, v = (2.0 * np.arange(size) / size - 1.0 for size in (columns, rows))
    values = [polynomial.polygrid2d(u, v, c).T for c in (*directions, *offsets)]
    place = {
        "directions": [c.tolist() for c in directions],
        "offsets": [c.tolist() for c in offsets],
    }
    one, zero = np.ones(shape), np.zeros(shape)
    return Lattice(
        place, np.stack((*values[:2], one), axis=-1), np.stack((*values[2:], zero), axis=-1)
    )


def plane_lattice(
    shape: tuple[int, int], pitch: float, pupil: tuple[float, float, float] | None
) -> Lattice:
    """Points over a plane: x right, y up, z towards the camera, as ``height_map_points``."""
    rows, columns = shape
    # Column and row, as polynomials of the page's coordinates.
    column = np.array([[columns / 2.0], [columns / 2.0]])
    row = np.array([[rows / 2.0, rows / 2.0]])
    directions = [np.zeros((1, 1))] * 2
    if pupil is not None:
        foot_x, foot_y, distance = pupil
        slope_x, slope_y = -column / distance, row / distance
        slope_x[0, 0] += foot_x / distance
        slope_y[0, 0] -= foot_y / distance
        directions = [slope_x * pitch, slope_y * pitch]
    return replace(_lattice(shape, directions, [column * pitch, -row * pitch]), pitch=pitch)


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
    directions = seen[:, :2] / seen[:, 2:]
    if not np.ptp(directions, axis=0).min() > SAME_DIRECTION:
        return None
    start = np.zeros(9)
    for k in range(2):
        start[[k, 2 + k]] = np.polyfit(directions[:, k], pixels[:, k], 1)
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
        solved = scipy.optimize.least_squares(residual, start, slope, x_scale="jac")
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
    single = np.array_equal(exact.astype(np.float32), exact)
    exact = points.astype(np.float32 if single else np.float64)
    places = [blocks.add_planes(exact[..., k]) for k in range(3)]
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
            symbols, z = coded(points[..., 2], factor * sigma, origin)
        except InputError:
            return None
        found = lattice.directions * z[..., None] + lattice.offsets
        if _within(found, points, sigma, measured):
            places = [blocks.add_planes(symbols)]
            code = {"coding": "z", "factor": factor, "of_sigma": True, "origins": [origin]}
            return {**code, "blocks": places}
    return None


def _coordinates(
    blocks: Blocks, points: FloatMap, measured: BoolMap, sigma: FloatMap, _: Lattice | None
) -> dict[str, Any] | None:
    """Three coordinates in steps of σ; None where the steps are too small for their range."""
    factor = 2.0 * ALLOWED_SIGMAS * MARGINS[0] / np.sqrt(3.0)
    origins = [float(v) for v in np.median(points[measured], axis=0)]
    try:
        found = [coded(points[..., k], factor * sigma, origin) for k, origin in enumerate(origins)]
    except InputError:
        return None
    if not _within(np.stack([values for _, values in found], axis=-1), points, sigma, measured):
        return None
    places = [blocks.add_planes(symbols) for symbols, _ in found]
    code = {"coding": "xyz", "factor": factor, "of_sigma": True, "origins": origins}
    return {**code, "blocks": places}


def _within(found: FloatMap, points: FloatMap, sigma: FloatMap, measured: BoolMap) -> bool:
    error = np.linalg.norm((found - points)[measured], axis=1)
    return bool((error <= ALLOWED_SIGMAS * sigma[measured]).all())
