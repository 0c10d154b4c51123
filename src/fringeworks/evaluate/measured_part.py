"""What was measured of a part, in the form in which it is compared with a model."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.files.atomic import StrPath
from fringeworks.files.mesh import read_model
from fringeworks.files.points import read_cloud, read_points
from fringeworks.files.provenance import source_of
from fringeworks.rig.point_errors import point_errors
from fringeworks.surface.mesh import vertex_normals
from fringeworks.types import (
    Area,
    ByteMap,
    FloatMap,
    InputError,
    PointCloud,
    Points,
    Reason,
    Rig,
    Source,
    TriangleMesh,
    Where,
    fingerprint,
    need_camera_frame,
)
from fringeworks.views.registration import SAMPLES
from fringeworks.views.surface_points import MIN_POINTS, SurfacePoints, surface_points

NEIGHBOURS = 16
"""Number of neighbours through which a plane is laid for the normal of a point without one."""
SPACING_POINTS = 2000
"""Approximate number of points from which the typical distance of neighbours is taken."""
UNKNOWN_SIGMA = 1e-6
"""Standard deviation that a fit uses for points without one, as a share of the part's size: the
same for all, and far below their scatter."""


@dataclass(frozen=True)
class MeasuredPart:
    """The measured points of a part."""

    surface: PointCloud | Points
    """What was measured."""
    xyz_mm: FloatMap
    """(n, 3), mm."""
    index: NDArray[np.intp]
    """Places of the points in ``reason``, flattened, (n,)."""
    reason: ByteMap
    """``Reason`` of all points, in the shape of the part."""
    sigma_mm: FloatMap | None
    """(n,), along ``ray``; mm."""
    noise_mm: FloatMap | None
    """(n,), mm; 0 where the noise is not known apart from the rest of σ."""
    ray: FloatMap | None
    """Direction in which a point errs, (n, 3); None where it is that of the normal."""
    rig: Rig | None
    """The rig that measured the cloud; None where it is not known or has no covariance."""

    @property
    def one_view(self) -> bool:
        """Whether the points were seen from the origin of their coordinates."""
        return isinstance(self.surface, PointCloud)

    @cached_property
    def spacing_mm(self) -> float:
        """Typical distance of neighbouring points, mm."""
        some = self.xyz_mm[:: max(1, len(self.xyz_mm) // SPACING_POINTS)]
        if len(self.xyz_mm) < 2:
            return 0.0
        # Few points are searched for: a tree that is made faster is worth slower searches.
        tree = scipy.spatial.cKDTree(self.xyz_mm, compact_nodes=False, balanced_tree=False)
        return float(np.median(tree.query(some, k=2)[0][:, 1]))

    def along(self, at: NDArray[np.intp], direction: FloatMap) -> FloatMap:
        """Return the share of the errors of some points that acts along directions, (n,)."""
        if self.ray is None:
            return np.ones(len(at))
        return np.asarray(np.abs(np.einsum("nc,nc->n", self.ray[at], direction)))

    def errors_at(self, points_mm: FloatMap) -> FloatMap | None:
        """Return the errors that the rig's covariance stands for, (n, 3, k), mm."""
        if self.rig is None or not isinstance(self.surface, PointCloud):
            return None
        return point_errors(self.rig, np.asarray(points_mm, np.float64), self.surface)

    def common_at(self, points_mm: FloatMap) -> FloatMap | None:
        """Return σ of the errors in common of the nearest measured points, (n,), mm."""
        if self.sigma_mm is None or self.noise_mm is None:
            return None
        near = scipy.spatial.cKDTree(self.xyz_mm).query(points_mm)[1]
        variance = self.sigma_mm[near] ** 2 - self.noise_mm[near] ** 2
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def within(self, where: Where, *, least: int = MIN_POINTS) -> MeasuredPart:
        """Return the points of an area of the image, or of a ball; ``least`` or more."""
        if isinstance(where, Area):
            if not isinstance(self.surface, PointCloud):
                raise InputError(
                    "area: expected a cloud of a camera for an area of its image, got points; give "
                    "a ball (x, y, z, radius) instead"
                )
            inside = where.pixels(self.surface.shape).ravel()[self.index]
        else:
            if len(where) != 4 or not where[3] > 0:
                raise InputError(f"within: expected x, y, z and a radius > 0, got {where}")
            inside = np.linalg.norm(self.xyz_mm - np.asarray(where[:3]), axis=1) <= where[3]
        if np.count_nonzero(inside) < least:
            raise InputError(
                f"within: expected {least} points or more there, got {np.count_nonzero(inside)}"
            )
        outside = self.index[~inside]
        reason = self.reason.ravel().copy()
        reason[outside] = Reason.MASKED
        return replace(
            self,
            xyz_mm=self.xyz_mm[inside],
            index=self.index[inside],
            reason=reason.reshape(self.reason.shape),
            sigma_mm=None if self.sigma_mm is None else self.sigma_mm[inside],
            noise_mm=None if self.noise_mm is None else self.noise_mm[inside],
            ray=None if self.ray is None else self.ray[inside],
        )

    def plain(self) -> SurfacePoints:
        """Return the points with one rough normal out of the part; σ is that along the ray."""
        n = len(self.xyz_mm)
        unknown = np.zeros(n)
        # Without normals, the points were seen from the origin, or from where their camera was.
        out = -self.xyz_mm.mean(axis=0)
        if self.ray is not None and isinstance(self.surface, PointCloud):
            out = out if self.surface.placement is None else -self.ray.mean(axis=0)
        if isinstance(self.surface, Points) and self.surface.normals is not None:
            out = np.asarray(self.surface.normals[self.index], np.float64).mean(axis=0)
        return SurfacePoints(
            self.xyz_mm,
            np.broadcast_to(out / np.linalg.norm(out), (n, 3)),
            unknown if self.sigma_mm is None else self.sigma_mm,
            unknown if self.noise_mm is None else self.noise_mm,
            np.zeros(n),
            None,
            self.errors_at(self.xyz_mm),
        )

    def turned(self, seed: int) -> SurfacePoints:
        """Return some of the points with their normals, as registration takes them."""
        if isinstance(self.surface, PointCloud):
            found = surface_points(replace(self.surface, reason=self.reason))
        else:
            found = self._of_points(self.surface)
        if len(found.xyz_mm) > SAMPLES:
            rng = np.random.default_rng(seed)
            found = found.at(np.sort(rng.choice(len(found.xyz_mm), SAMPLES, replace=False)))
        return replace(found, errors=self.errors_at(found.xyz_mm))

    def _of_points(self, points: Points) -> SurfacePoints:
        turned = _normals(self.xyz_mm) if points.normals is None else points.normals[self.index]
        size = float(np.linalg.norm(np.ptp(self.xyz_mm, axis=0)))
        unknown = np.full(len(self.xyz_mm), UNKNOWN_SIGMA * size)
        good = np.linalg.norm(turned, axis=1) > 0.5
        found = SurfacePoints(
            self.xyz_mm,
            np.asarray(turned, np.float64),
            unknown if self.sigma_mm is None else self.sigma_mm,
            unknown if self.noise_mm is None else self.noise_mm,
            np.zeros(len(self.xyz_mm)),
            None,
        )
        return found.at(good)


def measured_part(surface: PointCloud | Points, rig: Rig | None) -> MeasuredPart:
    """Return the measured points of a cloud, or points.

    Raises
    ------
    InputError where nothing was measured.
    """
    if isinstance(surface, PointCloud):
        index = np.flatnonzero(surface.reason == Reason.OK)
        xyz = surface.xyz_mm.reshape(-1, 3)[index].astype(np.float64)
        if rig is not None:
            need_camera_frame(surface, "the errors of a rig")
        placement = surface.placement
        sight = xyz if placement is None else xyz - placement.T_frame_camera[:3, 3]
        ray: FloatMap | None = sight / np.linalg.norm(sight, axis=1, keepdims=True)
        sigma: FloatMap | None = surface.sigma_mm.ravel()[index].astype(np.float64)
        noise: FloatMap | None = surface.noise_mm.ravel()[index].astype(np.float64)
        reason = np.asarray(surface.reason)
    else:
        xyz, ray = np.asarray(surface.xyz_mm, np.float64), None
        index, reason = np.arange(len(xyz)), np.zeros(len(xyz), np.uint8)
        sigma, noise = surface.sigma_mm, surface.noise_mm
        if sigma is not None and noise is None:
            noise = np.zeros(len(xyz))
    if not len(xyz):
        raise InputError("part: expected measured points, got none")
    known = None if rig is None or rig.covariance is None else rig
    return MeasuredPart(surface, xyz, index, reason, sigma, noise, ray, known)


def named_part(
    part: PointCloud | Points | TriangleMesh | StrPath,
) -> tuple[PointCloud | Points, Source]:
    """Return a part, read from its file or made of a mesh, and where it comes from."""
    if isinstance(part, str | os.PathLike):
        read = read_cloud if Path(part).suffix.lower() == ".npz" else read_points
        return read(part), source_of(part)
    if isinstance(part, TriangleMesh):
        vertices = np.asarray(part.vertices_mm, np.float64)
        turned = vertex_normals(vertices, part.faces)
        kept = np.ones(len(vertices), bool) if part.filled is None else ~part.filled
        sigma = None if part.sigma_mm is None else part.sigma_mm[kept]
        points = Points(vertices[kept], sigma, findings=part.findings, normals=turned[kept])
        return points, Source("part", fingerprint(part))
    return part, Source("part", fingerprint(part))


def named_model(model: TriangleMesh | StrPath) -> tuple[TriangleMesh, Source]:
    """Return a model, read from its file, and where it comes from."""
    if isinstance(model, str | os.PathLike):
        source = source_of(model)
        return _read_once(os.fspath(model), source.sha256), source
    return model, Source("model", fingerprint(model))


@lru_cache(maxsize=2)
def _read_once(path: str, _: str | None) -> TriangleMesh:
    """The model of a file with this hash: parts that are measured one by one have the same."""
    return read_model(path)


def _normals(xyz: FloatMap) -> FloatMap:
    """Normals of points by their neighbours, (n, 3), towards the origin of the coordinates."""
    if len(xyz) < NEIGHBOURS:
        raise InputError(f"points: expected {NEIGHBOURS} or more for their normals, got {len(xyz)}")
    near = scipy.spatial.cKDTree(xyz).query(xyz, k=NEIGHBOURS, workers=-1)[1]
    around = xyz[near] - xyz[near].mean(axis=1, keepdims=True)
    moments = np.einsum("nki,nkj->nij", around, around)
    turned = np.linalg.eigh(moments)[1][:, :, 0]
    away = np.einsum("nc,nc->n", turned, xyz) > 0
    return np.asarray(np.where(away[:, None], -turned, turned))
