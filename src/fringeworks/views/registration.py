"""Two views of a part brought together by their shape, with the covariance of the result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from fringeworks.types import MAD_TO_SIGMA, FloatMap, Frozen, InputError
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

    @property
    def slides(self) -> int:
        """Number of directions in which the surface slides on itself: 3 for a sphere."""
        return 6 - int(self.determined.shape[1])


def register(
    source: SurfacePoints,
    target: SurfacePoints,
    start: FloatMap | None = None,
    *,
    reach_mm: float = START_MM,
    seed: int = 0,
) -> Registration:
    """Bring a view to another one by the distances of their points along the normals.

    Parameters
    ----------
    source, target : SurfacePoints
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
    2019). Matches are weighted by 1/σ², and left out by their normals and by their distance in
    robust standard deviations. Every step moves only along directions that the shape determines.
    The covariance is that of sums over patches of the overlap (clustered errors, Liang and Zeger,
    Biometrika 73, 1986), plus the stated errors by blur and calibration.
    """
    if not reach_mm > 0:
        raise InputError(f"reach_mm: expected > 0, got {reach_mm}")
    rng = np.random.default_rng(seed)
    if len(source.xyz_mm) > SAMPLES:
        source = source.at(np.sort(rng.choice(len(source.xyz_mm), SAMPLES, replace=False)))
    tree = scipy.spatial.cKDTree(target.xyz_mm)
    T = np.eye(4) if start is None else np.asarray(start, np.float64)
    reach, converged = reach_mm, False
    for _ in range(MAX_STEPS):
        match = _matches(source.moved(T), target, tree, reach)
        step, displacement = _step(match)
        T = from_twist(step) @ T
        if displacement < SETTLED_MM:
            converged = True
            break
        # Matches come nearer as the views do.
        reach = max(min(reach, 3.0 * displacement + 6.0 * match.typical_mm), match.spacing_mm)
    return _result(T, _matches(source.moved(T), target, tree, reach), converged)


@dataclass(frozen=True)
class _Matches:
    """Matched points: what the normal equations are made of."""

    points: FloatMap
    """(n, 3), middle between the two, mm."""
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

    @property
    def typical_mm(self) -> float:
        return float(MAD_TO_SIGMA * np.median(np.abs(self.distance)))

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


def _matches(
    source: SurfacePoints, target: SurfacePoints, tree: scipy.spatial.cKDTree, reach: float
) -> _Matches:
    near, index = tree.query(source.xyz_mm, distance_upper_bound=reach, workers=1)
    has = np.isfinite(near)
    at = index[has]
    n_source, n_target = source.normals[has], target.normals[at]
    cosine = np.sum(n_source * n_target, axis=1)
    offset = source.xyz_mm[has] - target.xyz_mm[at]
    n = n_source + n_target
    n /= np.linalg.norm(n, axis=1, keepdims=True) + 1e-12
    distance = np.sum(offset * n, axis=1)
    sigma2 = source.sigma_mm[has] ** 2 + target.sigma_mm[at] ** 2
    blur = source.blur_mm[has] ** 2 + target.blur_mm[at] ** 2
    calibration = sigma2 - source.noise_mm[has] ** 2 - target.noise_mm[at] ** 2 - blur
    good = cosine > MAX_NORMAL_COSINE
    if np.count_nonzero(good) >= MIN_MATCHES:
        # A point that ends the overlap matches the other's border from aside.
        aside = np.sqrt(np.maximum(near[has] ** 2 - distance**2, 0.0))
        spacing = float(np.median(aside[good]))
        good &= aside < 4.0 * spacing + 1e-9
        ratio = np.abs(distance) / np.sqrt(sigma2)
        good &= ratio < END_SIGMAS * max(MAD_TO_SIGMA * float(np.median(ratio[good])), 1.0)
    if np.count_nonzero(good) < MIN_MATCHES:
        raise InputError(
            f"views: expected {MIN_MATCHES} matching points or more, got {np.count_nonzero(good)}: "
            "the views hardly overlap, or start too far from each other"
        )
    return _Matches(
        points=(source.xyz_mm[has] - 0.5 * offset)[good],
        normals=n[good],
        distance=distance[good],
        sigma=np.sqrt(sigma2[good]),
        blur=blur[good],
        calibration=np.maximum(calibration[good], 0.0),
        overlap=float(np.count_nonzero(good)) / len(has),
        spacing_mm=4.0 * spacing,
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
    kept = vectors[:, values > MIN_EIGENVALUE]
    right = match.rows.T @ (w * match.distance)
    local = -kept @ ((kept.T @ right) / values[values > MIN_EIGENVALUE])
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
    good = values > MIN_EIGENVALUE
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
    common = covariance(
        CALIBRATION_SHARE * np.sqrt(match.calibration), max(1.0, count / CALIBRATION_PATCHES)
    )
    return Registration(
        T,
        noise,
        common,
        to_origin @ kept,
        match.overlap,
        float(np.sqrt(np.mean(match.distance**2))),
        float(np.sqrt(np.mean((match.distance / match.sigma) ** 2))),
        converged,
    )
