"""Two views of a part brought together by their shape, with the covariance of the result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.types import FloatMap, Frozen, InputError
from fringeworks.views.poses import from_twist
from fringeworks.views.surface_points import SurfacePoints

SAMPLES = 8000
"""Largest number of points of a view that are matched. Twice as many lower the error by less than
the calibration adds, and take twice the time. Empirical."""
START_MM = 8.0
"""Largest distance of two points that are matched in the first steps, mm."""
END_SIGMAS = 4.0
"""Distance of matched points along the normal, in robust standard deviations, from which on a match
is left out."""
MAX_STEPS = 60
"""Largest number of steps."""
SETTLED_MM = 2e-5
"""Step, as a displacement, below which the registration has converged, mm: far below its error."""
MAX_NORMAL_COSINE = 0.7
"""Least cosine between the normals of matched points: 45° apart they are of different surfaces."""
MIN_MATCHES = 300
"""Smallest number of matches. Fewer determine a pose hardly better than a coarse alignment does."""
MIN_EIGENVALUE = 5e-4
"""Smallest eigenvalue of the normal equations per match, with rotations measured by the
displacement they cause at the overlap's size. Below it, the surface slides on itself in that
direction. Noise in the normals keeps it above 0 for a sphere, at 1e-5 on the virtual rig; between
views of the bust 30° apart it is 3e-3 and more, with a board beside it 1e-3."""
MIN_EXACT_EIGENVALUE = 1e-4
"""The same against a model, whose normals have no noise. A sphere of triangles with interpolated
normals gives less than 1e-5."""
PATCH_SHARE = 0.15
"""Side of a patch of the overlap, over its size. Errors of neighbours are alike in the calibration,
the fringes and the normals; patches of about a sixth are independent to first order."""
CALIBRATION_PATCHES = 9
"""Number of independent patches into which the stated error of the calibration divides an overlap
(as ``surface/form.py``)."""

CALIBRATION_SHARE = 0.5
"""Error of a pair's pose by the calibration, over that of views whose calibrations differ. The
calibration bends both views alike, so that most of it cancels. Empirical: five calibrations of the
virtual rig give 0.2 … 0.6, depending on the direction."""


MAX_ASIDE = 0.2
"""Largest distance aside of the normal, over the whole distance, of a point that is matched with a
model: the angle of 12° allows for triangles of a round surface, not for the edges of a body."""
ROUNDING_MM = 1e-6
"""Distance aside that rounding causes, mm."""


@dataclass(frozen=True, eq=False, repr=False)
class Registration(Frozen):
    """How one view lies to another, by their shape."""

    T_target_source: FloatMap
    """(4, 4), maps the source's coordinates to the target's, mm."""
    noise: FloatMap
    """(6, 6) covariance of the error ξ = (ω, v) in the target's coordinates that is independent
    from pair to pair, by noise and blur; rad, mm. Directions that the shape does not determine have
    none: see ``determined``."""
    common: FloatMap
    """(6, 6) covariance that several pairs may share, by the calibration."""
    determined: FloatMap
    """(6, k), the directions of ξ that the shape determines, as columns."""
    overlap: float
    """Share of the source's points that have a match, 0…1."""
    rms_mm: float
    """Root mean square distance of matched points along the normal, mm."""
    chi: float
    """The same over its standard deviation: 1 where σ explains the distances."""
    converged: bool
    """Whether the last step was below its limit."""
    response: FloatMap | None = None
    """(6, k), the errors ξ that the k parts of the points' ``errors`` cause; None where the points
    have none. ``common`` is then response · responseᵀ."""

    @property
    def slides(self) -> int:
        """Number of directions in which the surface slides on itself: 3 for a sphere."""
        return 6 - int(self.determined.shape[1])


class Target(Protocol):
    """What points are registered to."""

    @property
    def exact(self) -> bool:
        """Whether it is a model without noise, whose normals alone then count."""

    def matched(self, xyz_mm: FloatMap, reach_mm: float) -> tuple[FloatMap, SurfacePoints]:
        """Return the distance of each point, (n,), ∞ beyond the reach, and the nearest points of
        those within it."""


class ViewTarget:
    """A view that another one is registered to."""

    exact = False

    def __init__(self, view: SurfacePoints) -> None:
        self._view = view
        self._tree = scipy.spatial.cKDTree(view.xyz_mm)

    def matched(self, xyz_mm: FloatMap, reach_mm: float) -> tuple[FloatMap, SurfacePoints]:
        near, index = self._tree.query(xyz_mm, distance_upper_bound=reach_mm, workers=1)
        found: NDArray[np.intp] = index[np.isfinite(near)]
        return near, self._view.at(found)


def register(
    source: SurfacePoints,
    target: SurfacePoints | Target,
    start: FloatMap | None = None,
    *,
    reach_mm: float = START_MM,
    seed: int = 0,
) -> Registration:
    """Bring a view to another one, or to a model, by distances along the normals.

    Parameters
    ----------
    source : SurfacePoints
    target : SurfacePoints or Target
        Each in coordinates of its own.
    start : (4, 4) array, optional
        T_target_source to start from; by default the same coordinates.
    reach_mm : float > 0
        How far apart matched points may be at the start, mm.
    seed : int
        Seed of the choice of points.

    Returns
    -------
    Registration

    Raises
    ------
    InputError where the views overlap too little.

    Notes
    -----
    Iterative closest points with the symmetric distance (p − q)·(n_p + n_q), which vanishes for two
    points of one surface up to its third derivative (Rusinkiewicz, ACM Transactions on Graphics 38,
    2019); for a model, whose normals are exact, with (p − q)·n_q. Matches are weighted by 1/σ², and
    left out by their normals and by their distance in robust standard deviations. Every step moves
    only along directions that the shape determines.
    The covariance is that of sums over patches of the overlap (clustered errors, Liang and Zeger,
    Biometrika 73, 1986), plus the stated errors by blur and calibration. The latter is that of the
    points' ``errors`` where they are known, and else of their variance.
    """
    if not reach_mm > 0:
        raise InputError(f"reach_mm: expected > 0, got {reach_mm}")
    rng = np.random.default_rng(seed)
    if len(source.xyz_mm) > SAMPLES:
        source = source.at(np.sort(rng.choice(len(source.xyz_mm), SAMPLES, replace=False)))
    if isinstance(target, SurfacePoints):
        target = ViewTarget(target)
    T = np.eye(4) if start is None else np.asarray(start, np.float64)
    reach, converged = reach_mm, False
    for _ in range(MAX_STEPS):
        match = _matches(source.moved(T), target, reach)
        step, displacement = _step(match)
        T = from_twist(step) @ T
        if displacement < SETTLED_MM:
            converged = True
            break
        # Matches come nearer as the views do.
        reach = max(min(reach, 3.0 * displacement + 6.0 * match.typical_mm), match.spacing_mm)
    return _result(T, _matches(source.moved(T), target, reach), converged)


@dataclass(frozen=True)
class _Matches:
    """Matched points: what the normal equations are made of."""

    points: FloatMap
    """(n, 3), middle between the two, or on the model, mm."""
    normals: FloatMap
    distance: FloatMap
    """Of the source's point along the normal, (n,), mm."""
    sigma: FloatMap
    blur: FloatMap
    """Variance of the part by blur, (n,), mm²."""
    calibration: FloatMap
    """Variance of the calibration's part, (n,), mm²."""
    overlap: float
    spacing_mm: float
    exact: bool
    """Whether the target is a model, without errors."""
    errors: FloatMap | None
    """Errors of the distances by the parts of the points' ``errors``, (n, k), mm."""

    @property
    def least(self) -> float:
        """Smallest eigenvalue of a direction that the shape determines."""
        return MIN_EXACT_EIGENVALUE if self.exact else MIN_EIGENVALUE

    @property
    def unexplained(self) -> FloatMap:
        """Variance of the calibration's part that ``errors`` do not stand for, (n,), mm²."""
        if self.errors is None:
            return self.calibration
        return np.asarray(np.maximum(self.calibration - np.sum(self.errors**2, axis=1), 0.0))

    @property
    def typical_mm(self) -> float:
        return robust_sigma(self.distance)

    @property
    def centre(self) -> FloatMap:
        return np.asarray(self.points.mean(axis=0))

    @property
    def size(self) -> float:
        """Root mean square distance of the points from their middle, mm."""
        return float(np.sqrt(np.mean(np.sum((self.points - self.centre) ** 2, axis=1))))

    @property
    def rows(self) -> FloatMap:
        """Derivative of the distances by (ω size, v) about the middle, (n, 6)."""
        arm = (self.points - self.centre) / self.size
        return np.column_stack((np.cross(arm, self.normals), self.normals))


def _matches(source: SurfacePoints, target: Target, reach: float) -> _Matches:
    near, found = target.matched(source.xyz_mm, reach)
    near, seen = near[np.isfinite(near)], source.at(np.isfinite(near))
    offset = seen.xyz_mm - found.xyz_mm
    n = found.normals if target.exact else seen.normals + found.normals
    n = n / (np.linalg.norm(n, axis=1, keepdims=True) + 1e-12)
    distance = np.sum(offset * n, axis=1)
    sigma2 = seen.sigma_mm**2 + found.sigma_mm**2
    blur = seen.blur_mm**2 + found.blur_mm**2
    calibration = sigma2 - seen.noise_mm**2 - found.noise_mm**2 - blur
    good = np.sum(seen.normals * found.normals, axis=1) > MAX_NORMAL_COSINE
    spacing = 0.0
    if np.count_nonzero(good) >= MIN_MATCHES:
        # A point that ends the overlap matches the other's border from aside.
        aside = np.sqrt(np.maximum(near**2 - distance**2, 0.0))
        spacing = 0.0 if target.exact else 4.0 * float(np.median(aside[good]))
        good &= aside < (MAX_ASIDE * near + ROUNDING_MM if target.exact else spacing + 1e-9)
    if np.count_nonzero(good) >= MIN_MATCHES:
        ratio = np.abs(distance) / np.sqrt(sigma2)
        good &= ratio < END_SIGMAS * max(robust_sigma(ratio[good]), 1.0)
    if np.count_nonzero(good) < MIN_MATCHES:
        raise InputError(
            f"views: expected {MIN_MATCHES} matching points or more, got {np.count_nonzero(good)}: "
            "the views hardly overlap, or start too far from each other"
        )
    errors = None if seen.errors is None else np.einsum("nc,nck->nk", n, seen.errors)[good]
    return _Matches(
        points=(seen.xyz_mm - (1.0 if target.exact else 0.5) * offset)[good],
        normals=n[good],
        distance=distance[good],
        sigma=np.sqrt(sigma2[good]),
        blur=blur[good],
        calibration=np.maximum(calibration[good], 0.0),
        overlap=float(np.count_nonzero(good)) / len(source.xyz_mm),
        spacing_mm=spacing,
        exact=target.exact,
        errors=errors,
    )


def _eigen(match: _Matches) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Weights (sum 1), eigenvalues and eigenvectors of the normal equations per match."""
    w = 1.0 / (match.sigma**2 + match.typical_mm**2)
    w = w / w.sum()
    rows = match.rows
    values, vectors = np.linalg.eigh((w[:, None] * rows).T @ rows)
    return w, values, vectors


def _step(match: _Matches) -> tuple[FloatMap, float]:
    """The step ξ that lowers the distances, and how far it moves points, mm."""
    w, values, vectors = _eigen(match)
    good = values > match.least
    kept = vectors[:, good]
    right = match.rows.T @ (w * match.distance)
    local = -kept @ ((kept.T @ right) / values[good])
    xi = local / np.append(np.full(3, match.size), np.ones(3))
    return _about_origin(match) @ xi, float(np.linalg.norm(local))


def _about_origin(match: _Matches) -> FloatMap:
    """Converts ξ about the middle of the matches to ξ about the origin, (6, 6)."""
    A = np.eye(6)
    A[3:, :3] = carried_matrix(match.centre)
    return A


def carried_matrix(centre: FloatMap) -> FloatMap:
    """The displacement of the origin per rotation about a point, (3, 3)."""
    x, y, z = centre
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _result(T: FloatMap, match: _Matches, converged: bool) -> Registration:
    w, values, vectors = _eigen(match)
    good = values > match.least
    kept = vectors[:, good]
    gain = kept / values[good] @ kept.T
    rows = match.rows * w[:, None]
    cell = np.floor((match.points - match.centre) / (PATCH_SHARE * match.size)).astype(int)
    _, patch = np.unique(cell, axis=0, return_inverse=True)
    left = match.distance - match.rows @ (gain @ (rows.T @ match.distance))
    count = int(patch.max()) + 1
    scale = np.append(np.full(3, match.size), np.ones(3))
    to_origin = _about_origin(match) / scale

    def covariance(errors: FloatMap, factor: float) -> FloatMap:
        """Of the pose, for errors that are alike within a patch."""
        sums = np.zeros((count, 6))
        np.add.at(sums, patch.ravel(), rows * errors[:, None])
        inner = gain @ (factor * sums.T @ sums) @ gain
        return np.asarray(to_origin @ inner @ to_origin.T)

    noise = covariance(left, count / max(count - 6, 1)) + covariance(np.sqrt(match.blur), 1.0)
    # A model is not bent by the calibration: nothing cancels.
    share = 1.0 if match.exact else CALIBRATION_SHARE
    common = covariance(share * np.sqrt(match.unexplained), max(1.0, count / CALIBRATION_PATCHES))
    response = None
    if match.errors is not None:
        response = -to_origin @ gain @ (rows.T @ match.errors)
        noise, common = noise + common, response @ response.T
    return Registration(
        T,
        noise,
        common,
        to_origin @ kept,
        match.overlap,
        float(np.sqrt(np.mean(match.distance**2))),
        float(np.sqrt(np.mean((match.distance / match.sigma) ** 2))),
        converged,
        response,
    )
