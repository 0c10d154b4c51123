"""From which poses a part is to be scanned, so that every face is measured well enough."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.evaluate.foresight import ALBEDO, CAUSES, Foresight, checked_pose, foresee
from fringeworks.evaluate.model_faces import smooth_faces
from fringeworks.files.atomic import StrPath
from fringeworks.files.mesh import read_model
from fringeworks.files.rig import read_rig
from fringeworks.patterns.plan import PatternPlan
from fringeworks.rig.pinhole import rotation
from fringeworks.simulate.optics import Optics
from fringeworks.types import FloatMap, Frozen, InputError, Rig, TriangleMesh

TOLERANCE_SHARE = 0.1
"""Largest σ of a point over the tolerance of its face: a tenth, by the usual rule that
a gauge is ten times better than what it judges."""
REQUIRED_SHARE = 0.8
"""Share of a face that has to be seen with that σ. The rest is left for edges, where pixels mix two
surfaces and are not decoded."""
SIGMA_QUANTILE = 0.95
"""σ of a face is the one that this share of its seen places keeps."""


@dataclass(frozen=True, eq=False, repr=False)
class ForeseenFace(Frozen):
    """What the chosen poses together see of a face."""

    name: str
    tolerance_mm: float | None
    """None where the face has no tolerance."""
    share: float
    """Share of the face that is seen, 0…1."""
    fit_share: float
    """Share that is seen with σ up to a tenth of the tolerance; all that is seen without one."""
    sigma_mm: float
    """σ that 95 % of the seen places keep, each from its best pose, mm; NaN where none is seen."""
    reached: bool
    """Whether at least 80 % of the face is seen with that σ."""
    cause: str
    """What keeps most of the missing part from being measured; empty where the face is reached."""


@dataclass(frozen=True, eq=False, repr=False)
class ViewPlan(Frozen):
    """Poses to scan a part from, and what each of its faces gets from them."""

    chosen: tuple[int, ...]
    """Places of the chosen poses in the given list, in the order of their choice."""
    faces: tuple[ForeseenFace, ...]
    views: tuple[Foresight, ...]
    """What is seen from each chosen pose."""

    @property
    def unreached(self) -> tuple[ForeseenFace, ...]:
        """Faces with a tolerance that no choice of the given poses reaches."""
        return tuple(f for f in self.faces if f.tolerance_mm is not None and not f.reached)


def turned_poses(
    T_camera_model: FloatMap, point_mm: Sequence[float], axis: Sequence[float], count: int
) -> list[FloatMap]:
    """Poses of a part on a turntable, at equal angles from a first pose on.

    Parameters
    ----------
    T_camera_model : (4, 4) array
        First pose: maps model coordinates to camera coordinates, mm.
    point_mm, axis : three numbers each
        A point on the turntable's axis, mm, and the axis's direction, in camera coordinates.
    count : int ≥ 1
        Number of poses over a whole turn.

    Returns
    -------
    List of (4, 4) arrays

    Raises
    ------
    InputError for an axis without a direction, and numbers that are not finite.

    Examples
    --------
    >>> first, second = turned_poses(np.eye(4), (0, 0, 500), (0, 1, 0), 2)
    >>> second[2, 3].round(6).item()
    1000.0
    """
    first = checked_pose(T_camera_model)
    try:
        point, way = (np.array([float(v) for v in given]) for given in (point_mm, axis))
    except (TypeError, ValueError):
        raise InputError("turntable: expected three numbers for point and axis") from None
    good = point.shape == way.shape == (3,) and np.isfinite([point, way]).all()
    if not good or not np.linalg.norm(way) > 0:
        raise InputError("turntable: expected three finite numbers for point and axis")
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= 360:
        raise InputError(f"count: expected 1 to 360 poses, got {count!r}")
    found: list[FloatMap] = []
    for k in range(count):
        turn = np.eye(4)
        turn[:3, :3] = rotation(way / np.linalg.norm(way) * (2 * np.pi * k / count))
        turn[:3, 3] = point - turn[:3, :3] @ point
        found.append(turn @ first)
    return found


def plan_views(
    model: TriangleMesh | StrPath,
    rig: Rig | StrPath,
    plan: PatternPlan,
    poses: Sequence[FloatMap],
    *,
    tolerance_mm: float | Mapping[str, float],
    albedo: float = ALBEDO,
    optics: Optics | None = None,
    faces: Mapping[str, NDArray[Any]] | None = None,
    progress: Callable[[float], None] | None = None,
) -> ViewPlan:
    """Choose poses until every face with a tolerance is measured well enough.

    Parameters
    ----------
    model, rig, plan, albedo, optics, faces
        As for ``foresee``.
    poses : sequence of (4, 4) arrays
        Candidates: each maps model coordinates to camera coordinates, mm.
    tolerance_mm : float, or mapping of names of faces to floats
        Tolerance of all faces, or of some, mm. With an empty mapping, all poses are chosen.
    progress : callable, optional
        Called with the finished share, 0…1.

    Returns
    -------
    ViewPlan

    Raises
    ------
    InputError for no poses, a tolerance that is not above 0 or of a face that the model lacks, and
    as ``foresee``.

    Notes
    -----
    Greedy set cover: the next pose is the one that adds most to the face that is farthest from its
    goal; where none adds to it, the next face counts. A place counts where σ ≤ tolerance/10.
    """
    rig = rig if isinstance(rig, Rig) else read_rig(rig)
    model = model if isinstance(model, TriangleMesh) else read_model(model)
    groups = smooth_faces(model) if faces is None else dict(faces)
    limits = _limits(tolerance_mm, list(groups))
    if not len(poses):
        raise InputError("poses: expected one or more, got none")
    views = []
    for k, pose in enumerate(poses):
        views.append(foresee(model, rig, plan, pose, albedo=albedo, optics=optics, faces=groups))
        if progress is not None:
            progress((k + 1) / len(poses))
    face = views[0].samples.face
    limit = np.array([limits.get(name, np.inf) for name in groups])[face] * TOLERANCE_SHARE
    sigma = np.stack([view.sigma_mm for view in views])
    wanted = [n for n, name in enumerate(groups) if name in limits]
    chosen = _chosen(sigma <= limit, face, wanted) if wanted else list(range(len(poses)))
    told = tuple(
        _face(name, limits.get(name), views, chosen, face == n) for n, name in enumerate(groups)
    )
    return ViewPlan(tuple(chosen), told, tuple(views[k] for k in chosen))


def _limits(tolerance: float | Mapping[str, float], names: list[str]) -> dict[str, float]:
    limits = tolerance if isinstance(tolerance, Mapping) else dict.fromkeys(names, tolerance)
    for name, value in limits.items():
        if name not in names:
            raise InputError(f"tolerance: expected one of the faces {', '.join(names)}, got {name}")
        real = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not real or not (np.isfinite(value) and value > 0):
            raise InputError(f"tolerance: expected one above 0 mm, got {value!r}")
    return {name: float(value) for name, value in limits.items()}


def _chosen(fit: NDArray[np.bool_], face: NDArray[np.intp], wanted: list[int]) -> list[int]:
    """Places of the poses that the greedy cover takes; ``fit`` is (poses, samples)."""
    chosen: list[int] = []
    got = np.zeros(len(face), bool)
    while True:
        share = {n: float(np.mean(got[face == n])) for n in wanted}
        short = sorted((n for n in wanted if share[n] < REQUIRED_SHARE), key=share.__getitem__)
        for n in short:
            gain = np.count_nonzero(fit & ~got & (face == n), axis=1)
            if gain.max() == 0:
                continue
            # Equal gains of the worst face are decided by what a pose adds to all wanted faces.
            others = np.count_nonzero(fit & ~got & np.isin(face, wanted), axis=1)
            best = int(np.lexsort((-others, -gain))[0])
            chosen.append(best)
            got |= fit[best]
            break
        else:
            return chosen


def _face(
    name: str,
    tolerance: float | None,
    views: list[Foresight],
    chosen: list[int],
    mine: NDArray[np.bool_],
) -> ForeseenFace:
    """What the chosen poses see of a face, and from all poses why its rest is missing."""
    sigma = np.full(int(mine.sum()), np.inf)
    for k in chosen:
        sigma = np.fmin(sigma, views[k].sigma_mm[mine])
    seen = np.isfinite(sigma)
    limit = np.inf if tolerance is None else TOLERANCE_SHARE * tolerance
    fit = seen & (sigma <= limit)
    reached = float(np.mean(fit)) >= REQUIRED_SHARE
    worst = float(np.quantile(sigma[seen], SIGMA_QUANTILE)) if seen.any() else np.nan
    cause = "" if reached else _cause(views, mine, np.flatnonzero(~fit))
    return ForeseenFace(
        name, tolerance, float(np.mean(seen)), float(np.mean(fit)), worst, reached, cause
    )


def _cause(views: list[Foresight], mine: NDArray[np.bool_], missing: NDArray[np.intp]) -> str:
    """The commonest cause over the missing places, each by the pose that comes nearest to it.

    Causes are numbered in the order of the light: a place that is seen and too noisy came nearest,
    and a later cause came nearer than an earlier one.
    """
    causes = np.stack([view.cause[mine][missing] for view in views])
    nearest = np.where((causes == 0).any(axis=0), 0, causes.max(axis=0))
    most = int(np.bincount(nearest).argmax())
    return "σ above a tenth of the tolerance" if most == 0 else CAUSES[most]
