"""A board measured with a rig: its corners as points, how flat they are, and their scale."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fringeworks.rig.calibration.parameters import moved_rig
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.rig.pinhole import rays
from fringeworks.rig.ray_depth import inverse_depth, main_axis, projector_by_parameters
from fringeworks.types import FloatMap, Rig

STEPS = 3
"""Newton steps from a point by one axis to that by both; two are usual."""


def corner_points(rig: Rig, sighting: Sighting) -> FloatMap:
    """Triangulate the corners of a board: the points on the camera's rays that lie nearest to the
    projector's coordinates, (m, 3), mm; NaN where there is none."""
    axis = main_axis(rig)
    goal = sighting.projector_px
    w = inverse_depth(rig, sighting.camera_px, goal[:, 0 if axis == "x" else 1], axis)
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            seen, _, by_w, _ = projector_by_parameters(rig, sighting.camera_px, w)
            w = w + np.sum(by_w * (goal - seen), axis=1) / np.sum(by_w**2, axis=1)
        points = rays(rig.camera, sighting.camera_px) / np.where(w > 0, w, np.nan)[:, None]
    return np.asarray(points)


def flatness_mm(points: FloatMap) -> float:
    """Root mean square distance of points (m, 3) from the plane through them, mm."""
    across = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]
    return float(across / np.sqrt(len(points)))


def scale_of(points: FloatMap, board: FloatMap) -> float:
    """Size of points (m, 3) over that of the same points of a board (m, 3).

    The scale of the similarity that maps the board to the points by least squares (Umeyama, IEEE
    PAMI 13, 1991, doi:10.1109/34.88573).
    """
    p, b = points - points.mean(axis=0), board - board.mean(axis=0)
    u, values, v = np.linalg.svd(p.T @ b)
    values[-1] *= np.sign(np.linalg.det(u @ v))
    return float(values.sum() / np.sum(b**2))


def by_rig(rig: Rig, covariance: FloatMap, of: Callable[[Rig], FloatMap]) -> FloatMap:
    """Differences of a quantity for one standard deviation of a rig in each of 24 directions.

    Parameters
    ----------
    covariance : (24, 24) array
    of : callable
        The quantity of a rig, an array.

    Returns
    -------
    (24, …) array; the sum of their squares is the quantity's variance.
    """
    values, vectors = np.linalg.eigh(covariance)
    here, found = of(rig), []
    for step in (vectors * np.sqrt(np.maximum(values, 0.0))).T:
        moved = moved_rig(rig, step)
        found.append(np.zeros_like(here) if moved is None else of(moved) - here)
    return np.array(found)


def displacement(
    sightings: Sequence[Sighting], rig: Rig, change: FloatMap, covariance: FloatMap
) -> tuple[float, float, float, float]:
    """By how much points at the corners move when a rig changes.

    Parameters
    ----------
    change : (24,) array
        Of the rig's parameters.
    covariance : (24, 24) array
        Of ``change``.

    Returns
    -------
    Median displacement of the points, mm, and its standard deviation; root mean square displacement
    of the projector's pixels at the same points, px, and its standard deviation.
    """
    points = np.concatenate([corner_points(rig, s) for s in sightings])
    w = 1.0 / points[:, 2]
    camera = np.concatenate([s.camera_px for s in sightings])

    def places(of: Rig) -> FloatMap:
        return np.concatenate([corner_points(of, s) for s in sightings])

    def pixels(of: Rig) -> FloatMap:
        return projector_by_parameters(of, camera, w)[0]

    now = moved_rig(rig, change)
    if now is None:
        return (float("nan"),) * 4
    mm = np.linalg.norm(places(now) - points, axis=1)
    px = np.linalg.norm(pixels(now) - pixels(rig), axis=1)
    mm2, px2 = (np.sum(by_rig(rig, covariance, q) ** 2, axis=(0, 2)) for q in (places, pixels))
    return (
        float(np.nanmedian(mm)),
        float(np.sqrt(np.nanmedian(mm2))),
        float(np.sqrt(np.nanmean(px**2))),
        float(np.sqrt(np.nanmean(px2))),
    )
