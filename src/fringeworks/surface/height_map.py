"""Height maps as points and triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import Finding, FloatMap, HeightMap, InputError, as_notes

MAX_TRIANGLE_SLOPE = 10.0
"""Largest slope of a triangle, rise over lateral pitch. A steeper one (84°) is taken to bridge a
step in height, where no surface was seen. Empirical."""


def known_pitch(surface: HeightMap, kind: str) -> float:
    """The lateral pitch of a height map, for a kind of file or calculation that needs one.

    Raises
    ------
    InputError where it is unknown.
    """
    if surface.pitch is None:
        raise InputError(
            f"{kind}: expected heights with a known pitch in mm/px, got an unknown one; give the "
            "pitch to the calibration, or write .tif or .npz"
        )
    return float(surface.pitch)


def height_map_points(surface: HeightMap) -> tuple[FloatMap, FloatMap, NDArray[np.int32]]:
    """Return the measured pixels of a height map as points.

    Parameters
    ----------
    surface : HeightMap

    Returns
    -------
    xyz : (n, 3) float64
        x to the right in the image, y up, z towards the camera: right-handed. Lateral unit as the
        pitch's: mm, or px without a geometry. With the camera's pupil, points lie on its rays;
        else straight above their pixels.
    sigma : (n,) float64
        Standard deviation of z, in the unit of the heights.
    index : (h, w) int32
        Row of each pixel's point; −1 where it has none.

    Notes
    -----
    A ray from the pupil at distance l above the foot X₀ meets the plane at X, and the height h at
    X₀ + (X − X₀)(1 − h/l).
    """
    valid = np.isfinite(surface.values)
    y, x = (place.astype(np.float64) for place in np.nonzero(valid))
    pitch = known_pitch(surface, "points")
    if surface.pupil is not None:
        foot_x, foot_y, distance = surface.pupil
        nearer = 1.0 - surface.values[valid] / distance
        x, y = foot_x + (x - foot_x) * nearer, foot_y + (y - foot_y) * nearer
    xyz = np.column_stack((x * pitch, -y * pitch, surface.values[valid]))
    index = np.full(valid.shape, -1, np.int32)
    index[valid] = np.arange(len(xyz), dtype=np.int32)
    return xyz.astype(np.float64), surface.sigma[valid].astype(np.float64), index


def lateral_findings(surface: HeightMap) -> tuple[Finding, ...]:
    """What is known of the lateral places of ``height_map_points``."""
    if surface.quantity != "height":
        return ()
    if surface.pupil is None:
        seen = (
            "points stand straight above their pixels: the place of the camera is not known; where "
            "one took them, perspective shifts a point by its height over the camera's distance, "
            "times its distance from the camera's axis"
        )
        return as_notes([seen], "lateral places")
    rows, columns = surface.shape
    x, y = surface.pupil[:2]
    where = f"points lie on rays through a camera above pixel ({x:.1f}, {y:.1f})"
    if (x, y) != (0.5 * (columns - 1), 0.5 * (rows - 1)):
        return as_notes([where], "lateral places")
    seen = (
        f"{where}, the middle of the frame: right for frames that were not cropped; the "
        "geometry's principal_px states another place"
    )
    return as_notes([seen], "lateral places")


def height_map_triangles(surface: HeightMap, index: NDArray[np.int32]) -> NDArray[np.int32]:
    """Connect neighbouring points of a height map by triangles that face the camera.

    Parameters
    ----------
    surface : HeightMap
    index : (h, w) int32 array
        As from ``height_map_points``.

    Returns
    -------
    (m, 3) int32 array, rows of the points; without triangles that would bridge a step in height.
    """
    a, b = index[:-1, :-1], index[:-1, 1:]
    c, d = index[1:, :-1], index[1:, 1:]
    z = surface.values
    steepest = MAX_TRIANGLE_SLOPE * known_pitch(surface, "triangles")
    za, zb, zc, zd = z[:-1, :-1], z[:-1, 1:], z[1:, :-1], z[1:, 1:]

    def keep(
        corners: tuple[NDArray[np.int32], ...], heights: tuple[FloatMap, ...]
    ) -> NDArray[np.int32]:
        rise = np.maximum.reduce(heights) - np.minimum.reduce(heights)
        # NaN compares false: a triangle with an unmeasured corner is left out.
        good = rise <= steepest
        return np.column_stack([corner[good] for corner in corners])

    return np.vstack((keep((a, c, b), (za, zc, zb)), keep((b, c, d), (zb, zc, zd))))
