"""Points of several views fused in voxels, weighted by their standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.types import FloatMap, Frozen, InputError, Points
from fringeworks.views.even_colours import even_colours
from fringeworks.views.poses import ViewPose
from fringeworks.views.surface_points import SurfacePoints

MAX_VOXELS_ACROSS = 1 << 20
"""Largest number of voxels along a side: three such numbers fit into 63 bits."""
SIDES = 6
"""Normals are sorted into six directions, so that both sides of a thin wall stay apart."""


@dataclass(frozen=True, eq=False, repr=False)
class Fused(Frozen):
    """Fused points, and how well the views agree where several see the same place."""

    points: Points
    """In the part's coordinates, with normals and brightness. ``noise_mm`` has averaged; the rest
    of ``sigma_mm``, from the calibration and the poses, has not."""
    views: NDArray[np.int32]
    """Number of views that see each point, (n,)."""
    disagreement: float
    """Robust standard deviation of single views about the fused points, over what their σ says; 1
    where σ explains it, NaN where no place is seen twice."""


def fuse_points(
    views: Sequence[SurfacePoints], poses: Sequence[ViewPose], *, voxel_mm: float
) -> Fused:
    """Fuse the points of views in voxels.

    Parameters
    ----------
    views : sequence of SurfacePoints
        In camera coordinates.
    poses : sequence of ViewPose
        One for each view.
    voxel_mm : float > 0
        Side of a voxel, mm.

    Returns
    -------
    Fused

    Raises
    ------
    InputError for a voxel that is not above 0 or far too small, and numbers that differ.

    Notes
    -----
    The point is the mean weighted by 1/σ², where σ is along the camera's ray divided by the cosine
    of incidence: a point seen at a grazing angle counts less. Its noise is √(Σ w² s²) / Σ w. Errors
    of calibration and pose are alike in all points of a view, so they are averaged, not reduced.
    Colours get the same weights, after the light of all views was made alike (``even_colours``).
    """
    if not voxel_mm > 0 or len(views) != len(poses) or not views:
        raise InputError(
            f"fusion: expected a voxel > 0 mm and a pose for each view, got {voxel_mm} mm, "
            f"{len(views)} views and {len(poses)} poses"
        )
    moved = [v.moved(p.T_part_camera) for v, p in zip(views, poses, strict=True)]
    xyz, turned, sigma, noise = (
        np.concatenate([getattr(v, name) for v in moved])
        for name in ("xyz_mm", "normals", "sigma_mm", "noise_mm")
    )
    by_pose = np.concatenate([_pose_variance(v, p) for v, p in zip(moved, poses, strict=True)])
    of_view = np.repeat(np.arange(len(moved)), [len(v.xyz_mm) for v in moved])
    index, count = _voxels(xyz, turned, voxel_mm)
    weight = 1.0 / sigma**2
    total = np.bincount(index, weight, count)

    def mean(values: FloatMap) -> FloatMap:
        return np.asarray(np.bincount(index, weight * values, count) / total)

    place = np.column_stack([mean(axis) for axis in xyz.T])
    normal = np.column_stack([mean(axis) for axis in turned.T])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
    alone = np.sqrt(np.bincount(index, (weight * noise) ** 2, count)) / total
    shared = mean(np.sqrt(np.maximum(sigma**2 - noise**2, 0.0) + by_pose)) ** 2
    seen_colours = _colours(views, index)
    colour = None
    if seen_colours is not None:
        colour = np.stack([mean(part) for part in seen_colours.T], axis=-1)
        colour = (
            colour if views[0].colour is not None and views[0].colour.ndim > 1 else colour[:, 0]
        )
    pairs = np.unique(np.column_stack((index, of_view)), axis=0)
    seen = np.bincount(pairs[:, 0], minlength=count).astype(np.int32)
    points = Points(place, np.sqrt(alone**2 + shared), alone, normals=normal, colour=colour)
    off = _disagreement(index, of_view, (xyz, sigma**2, by_pose), place, normal)
    return Fused(points, seen, off)


def _colours(views: Sequence[SurfacePoints], index: NDArray[np.intp]) -> FloatMap | None:
    """Colours of all points (n, 1 or 3), those of all views under one light; None where a view has
    none, or some have brightness only."""
    colours = [v.colour for v in views if v.colour is not None]
    if len(colours) < len(views) or len({c.ndim for c in colours}) > 1:
        return None
    every = np.concatenate([c.reshape(len(c), -1) for c in colours])
    factor = even_colours(views, index)
    return every if factor is None else np.asarray(every * factor[:, None])


def _pose_variance(points: SurfacePoints, pose: ViewPose) -> FloatMap:
    """Variance of points along their normals by the error of their view's pose, (n,), mm²."""
    rows = np.column_stack((np.cross(points.xyz_mm, points.normals), points.normals))
    return np.asarray(np.maximum(np.einsum("ni,ij,nj->n", rows, pose.covariance, rows), 0.0))


def _voxels(xyz: FloatMap, turned: FloatMap, side: float) -> tuple[NDArray[np.intp], int]:
    """Number of the voxel of every point, and how many there are."""
    cell = np.floor((xyz - xyz.min(axis=0)) / side).astype(np.int64)
    if cell.max() >= MAX_VOXELS_ACROSS:
        raise InputError(
            f"voxel: expected {np.ptp(xyz) / MAX_VOXELS_ACROSS:.2g} mm or more, got {side}"
        )
    main = np.argmax(np.abs(turned), axis=1)
    facing = 2 * main + (np.take_along_axis(turned, main[:, None], axis=1)[:, 0] > 0)
    key = ((cell[:, 0] * MAX_VOXELS_ACROSS + cell[:, 1]) * MAX_VOXELS_ACROSS + cell[:, 2]) * SIDES
    _, index = np.unique(key + facing, return_inverse=True)
    return index.ravel(), int(index.max()) + 1


def _disagreement(
    index: NDArray[np.intp],
    of_view: NDArray[np.intp],
    known: tuple[FloatMap, FloatMap, FloatMap],
    place: FloatMap,
    normal: FloatMap,
) -> float:
    """How far single views lie from the fused points, over what their σ says."""
    xyz, variance, by_pose = known
    key, group = np.unique(index * (int(of_view.max()) + 1) + of_view, return_inverse=True)
    group = group.ravel()
    voxel = key // (int(of_view.max()) + 1)
    number = np.bincount(group)
    off = np.sum((xyz - place[index]) * normal[index], axis=1)
    mean = np.bincount(group, off) / number
    expected = np.bincount(group, variance) / number**2 + np.bincount(group, by_pose) / number
    several = np.bincount(voxel)[voxel] > 1
    if not several.any():
        return float("nan")
    ratio = np.abs(mean[several]) / np.sqrt(expected[several])
    return robust_sigma(ratio)
