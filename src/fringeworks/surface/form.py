"""Planes, spheres and cylinders fitted to points, evaluated in the terms of VDI/VDE 2634."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fringeworks import _core
from fringeworks.statistics.quantiles import robust_sigma, smallest
from fringeworks.surface.form_geometry import GEOMETRIES, BodyKind, FormGeometry
from fringeworks.types import (
    LARGEST,
    MOST_SEED,
    NUMBERS,
    BoolMap,
    FloatMap,
    Frozen,
    InputError,
    unmasked,
    whole,
)

DISCARDED = 0.003
"""Share of the points that may be discarded before a range is taken, from VDI/VDE 2634 part 2."""
MIN_POINTS = 10
"""Smallest number of points for a fit: more than the seven numbers of a cylinder."""
NEARBY = 0.7
"""Distance within which the points of a trial body are chosen, in sizes of the cloud: neighbours
are more likely to lie on one body. Empirical."""
START_POINTS = 20_000
"""Largest number of points from which a start is found; more only cost time."""
JUDGING_POINTS = 2_000
"""Largest number of points by which trial bodies are compared: a tenth of them, 200, determine the
score of a body."""
REFINED_POINTS = 200_000
"""Number of points above which the least-squares fit uses every second one, or fewer: the precision
is then limited by the calibration, not by the number of points."""
FIRST_JUDGES = 200
"""Approximate number of points by which all trial bodies are compared first."""
SECOND_TRIALS = 64
"""Number of the best of them that all judging points compare (D. Nistér, Preemptive RANSAC, 2003,
doi:10.1109/ICCV.2003.1238341). The order of bodies by 200 points is off by far fewer places."""
BODY_SHARE = 0.1
"""Share of the points that must lie on a body for it to be found, 0…1: one body among several."""
TENTH_OF_NORMAL = 0.125
"""Distance, in standard deviations, within which a tenth of normally distributed distances lies."""
MAX_SPREAD = 0.05
"""Largest standard deviation of the points that count as on the body, in sizes of the cloud. Above,
the body does not describe the points. Empirical."""
FAR_SIGMAS = 6.0
"""Distance in robust standard deviations beyond which a point does not belong to the body; of
normally distributed distances one in 10⁹ is larger."""
PATCHES = 9
"""Number of independent patches into which an error that is alike in neighbours divides a body.
Errors of form and of calibration are smooth: about a third of the body in each direction."""
MAX_RELATIVE_SIGMA = 0.1
"""Largest standard deviation of a radius relative to it, or of a direction in rad, at which a body
counts as determined. A wall has a curvature of 0 ± something: its radius has no bound."""
TINY_EIGENVALUE = 1e-24
"""Smallest eigenvalue of normal equations that is divided by: the points then determine nothing."""
LEAST_DAMPING = 1e-6
"""First damping of a step that failed, over the diagonal of the normal equations. Without damping,
bodies that the points determine converge quadratically."""
MORE_DAMPING = 10.0
"""Factor of the damping after a step that failed, and of its decrease after one that did not."""
SETTLED = 1e-12
"""Relative change of the squared distances below which a fit has converged."""
ROUNDING = 1e-6
"""Smallest standard deviation of points in sizes of the cloud: single precision of files, for a
cloud at a distance of ten sizes."""
MAX_FAR_SHARE = 0.1
"""Largest share of a region's points that may lie off the body that the others lie on. With more,
least squares over all of them describes neither. Empirical."""
MAX_STEPS = 40
"""Largest number of steps of a fit. A determined body takes about ten; a radius that runs to
infinity never ends."""
FIT_ROUNDS = 6
"""Largest number of fits; the points that belong to the body are chosen anew after each. Usually
they no longer change after the second or third."""


@dataclass(frozen=True, eq=False, repr=False)
class Form(Frozen):
    """A body fitted to points."""

    body: BodyKind
    parameters: dict[str, list[float] | float]
    """In mm, in the coordinates of the points. plane: point_mm, normal; sphere: centre_mm,
    radius_mm; cylinder: point_mm, axis, radius_mm."""
    distance_mm: FloatMap
    """Signed distance of every point, (n,), mm: out of the sphere or cylinder, along the normal."""
    used: BoolMap
    """Which points the body was fitted to, (n,)."""
    sigma_mm: float | None
    """Standard deviation of the radius, mm; None for a plane. From the scatter of the points and,
    where given, from their common error."""
    region: BoolMap
    """Which points the form is evaluated over, (n,)."""
    far: BoolMap
    """Points of the region that lie more than six robust standard deviations off the body that
    the others lie on, (n,): dents, bumps, or points of something else."""

    @property
    def deviation_mm(self) -> float:
        """Standard deviation of the distances of the fitted points, mm."""
        return float(np.std(self.distance_mm[self.used]))

    def spread_mm(self, share: float = 1.0 - DISCARDED) -> float:
        """Return the narrowest range of distances that holds a share of the region's points, mm."""
        ordered = np.sort(self.distance_mm[self.region])
        kept = max(int(np.ceil(share * ordered.size)), 1)
        return float(np.min(ordered[kept - 1 :] - ordered[: ordered.size - kept + 1]))


def fit_form(
    points_mm: FloatMap,
    body: BodyKind,
    *,
    sigma_mm: FloatMap | None = None,
    common_mm: float = 0.0,
    seed: int = 0,
) -> Form:
    """Fit a plane, sphere or cylinder to the points that lie on it, by least squares.

    Parameters
    ----------
    points_mm : (n, 3) array
        At least ten points, finite, mm. Points of other surfaces may be among them.
    body : "plane", "sphere" or "cylinder"
    sigma_mm : (n,) array, optional
        Standard deviations of the points along the body's normal, mm, > 0; points are weighted by
        1/σ². By default all count alike.
    common_mm : float
        Standard deviation of the error that neighbouring points have in common, such as that of
        the calibration, mm.
    seed : int
        Seed of the random choice of points for the start.

    Returns
    -------
    Form, whose region are the points that lie on the body.

    Raises
    ------
    InputError for too few points or points that are not finite, and where no such body is found:
    at least a tenth of the points must lie on it, and they must determine it.

    Notes
    -----
    The start is, of many bodies through a few random points, the one that a tenth of all points
    lie nearest to (after RANSAC: Fischler and Bolles, CACM 24, 1981, doi:10.1145/358669.358692).
    Then the orthogonal distances are minimised; points beyond six robust standard deviations do
    not count. A body is determined where its radius is known to 10 % and its direction to 0.1 rad,
    also if the deviations are alike over patches of a ninth of the body.

    Examples
    --------
    >>> x, y = np.mgrid[:10, :10]
    >>> flat = np.column_stack((x.ravel(), y.ravel(), np.full(100, 500.0)))
    >>> form = fit_form(flat, "plane")
    >>> [round(v, 6) + 0.0 for v in form.parameters["normal"]], round(form.deviation_mm, 6)
    ([0.0, 0.0, -1.0], 0.0)
    """
    found = _find(points_mm, body, sigma_mm, seed)
    none_far = np.zeros(len(found.used), bool)
    return _form(body, found, common_mm, region=found.used, far=none_far)


class _Found(NamedTuple):
    """A fit in scaled coordinates."""

    scaled: FloatMap
    """Points, (n, 3), in sizes of the cloud from its mean."""
    mean: FloatMap
    """Mean of the points, mm."""
    scale: float
    """Size of the cloud, mm."""
    values: FloatMap
    """Values of the body."""
    unit: FloatMap
    """Covariance of the values where points err by 1, independently."""
    distance: FloatMap
    """Distances of all points, (n,)."""
    used: BoolMap
    """Points that were fitted, (n,)."""
    weight: FloatMap
    """Factors of the distances, (n,)."""


def _find(points_mm: FloatMap, body: BodyKind, sigma_mm: FloatMap | None, seed: int) -> _Found:
    """The body that is found among the points, whatever else is there."""
    points, geometry = _checked(points_mm, body)
    weight = _weights(sigma_mm, len(points))
    if not whole(seed, 0, MOST_SEED):
        raise InputError(f"seed: expected a whole number from 0 on, got {seed}")
    rng = np.random.default_rng(seed)
    sample = points
    if len(points) > START_POINTS:
        sample = points[rng.choice(len(points), START_POINTS, False)]
    mean = sample.mean(axis=0)
    scale = float(np.sqrt(np.mean(np.sum((sample - mean) ** 2, axis=1))))
    if not scale > 0:
        raise InputError("fit: expected points that determine a body, got one point many times")
    start, spread = _start((sample - mean) / scale, geometry, rng)
    scaled = (points - mean) / scale
    fitted = _fit(scaled, weight, start, spread, geometry)
    if fitted is None:
        raise InputError(f"fit: expected {MIN_POINTS} or more points on a {body}, found fewer")
    values, unit, distance, used = fitted
    if np.std(distance[used]) > MAX_SPREAD:
        raise InputError(
            f"fit: expected a {body}, found none that a tenth of the points lie on; fit a part of "
            "the cloud that shows the body alone"
        )
    return _Found(scaled, mean, scale, values, unit, distance, used, weight)


def _form(
    body: BodyKind, found: _Found, common_mm: float, *, region: BoolMap, far: BoolMap
) -> Form:
    """A fit in mm. Raises InputError where the points do not determine the body."""
    on_body = (found.distance * found.weight)[found.used]
    sigma = _radius_sigma(found.values, found.unit, on_body, common_mm / found.scale, body)
    return Form(
        body,
        GEOMETRIES[body].parameters(found.values, found.mean, found.scale),
        found.distance * found.scale,
        found.used,
        None if sigma is None else sigma * found.scale,
        region,
        far,
    )


def fit_region(
    points_mm: FloatMap,
    body: BodyKind,
    *,
    sigma_mm: FloatMap | None = None,
    common_mm: float = 0.0,
) -> Form:
    """Fit a body to all points of a region, as VDI/VDE 2634 part 2 asks.

    Parameters
    ----------
    points_mm : (n, 3) array
        Points that show the body alone, mm.
    body : "plane", "sphere" or "cylinder"
    sigma_mm, common_mm
        As for ``fit_form``.

    Returns
    -------
    Form, whose region are all points. The farthest 0.3 % are left out of the fit.

    Raises
    ------
    InputError as ``fit_form`` does, and where more than a tenth of the points lie off the body
    that the others lie on.
    """
    found = _find(points_mm, body, sigma_mm, 0)
    far, weight = ~found.used, found.weight
    if far.mean() > MAX_FAR_SHARE:
        farthest = found.scale * np.abs(found.distance[far]).max()
        raise InputError(
            f"fit: expected points of one {body} alone, got {far.mean():.1%} of them up to "
            f"{farthest:.4g} mm off the {body} that the others lie on; give the region that shows "
            f"the {body} (within)"
        )
    values, unit, used = found.values, found.unit, found.used
    kept = far.size - int(DISCARDED * far.size)
    for _ in range(FIT_ROUNDS):
        size = np.abs(_core.form_distances(body, values, found.scaled)) * weight
        before, used = used, smallest(size, kept)
        if np.array_equal(before, used):
            break
        values, unit = _refine(values, found.scaled, weight, used, GEOMETRIES[body])
    distance = _core.form_distances(body, values, found.scaled)
    found = found._replace(values=values, unit=unit, distance=distance, used=used)
    return _form(body, found, common_mm, region=np.ones(far.size, bool), far=far)


def _radius_sigma(
    values: FloatMap, unit: FloatMap, distance: FloatMap, common: float, body: str
) -> float | None:
    """Standard deviation of the radius in sizes of the cloud; None for a plane.

    ``unit`` is the covariance of the values where points err by 1, independently. Raises
    InputError where the points do not determine the body.
    """
    geometry = GEOMETRIES[body]
    n = len(distance)
    scatter = max(float(np.std(distance)), ROUNDING)
    alike = unit * max(scatter, common) ** 2 * n / PATCHES
    loose = []
    if geometry.has_radius:
        loose.append(np.sqrt(alike[-1, -1]) / abs(values[-1]))
    if geometry.direction is not None:
        part = geometry.direction
        loose.append(np.sqrt(np.trace(alike[part, part])) / np.linalg.norm(values[part]))
    if not max(loose) <= MAX_RELATIVE_SIGMA:
        raise InputError(
            f"fit: expected points that determine a {body}, got points that fit one of another "
            f"radius or direction as well; show more of the {body}, or fit another body"
        )
    if not geometry.has_radius:
        return None
    return float(np.sqrt(unit[-1, -1] * (scatter**2 + common**2 * n / PATCHES)))


def _checked(points_mm: FloatMap, body: str) -> tuple[FloatMap, FormGeometry]:
    if body not in GEOMETRIES:
        raise InputError(f"fit: expected one of {', '.join(GEOMETRIES)}, got {body!r}")
    given = unmasked(points_mm, "points")
    if given.dtype.kind not in NUMBERS:
        raise InputError(f"points: expected real numbers, got {given.dtype}")
    points = given.astype(np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not _bounded(points):
        raise InputError(f"points: expected finite (n, 3), got shape {points.shape}")
    if len(points) < MIN_POINTS:
        raise InputError(f"fit: expected {MIN_POINTS} points or more, got {len(points)}")
    return points, GEOMETRIES[body]


def _bounded(values: FloatMap) -> bool:
    """Whether all values are finite, and not beyond ``LARGEST``."""
    return not values.size or bool(values.min() >= -LARGEST and values.max() <= LARGEST)


def _weights(sigma_mm: FloatMap | None, n: int) -> FloatMap:
    """Factors of the distances, (n,): the median σ over each point's σ."""
    if sigma_mm is None:
        return np.ones(n)
    sigma = unmasked(sigma_mm, "sigma").astype(np.float64)
    if sigma.shape != (n,) or not ((sigma >= 1 / LARGEST) & (sigma <= LARGEST)).all():
        raise InputError(f"sigma: expected {n} values > 0, got shape {sigma.shape}")
    return np.asarray(np.median(sigma) / sigma)


def _start(
    points: FloatMap, geometry: FormGeometry, rng: np.random.Generator
) -> tuple[FloatMap, float]:
    """The best of many trial bodies, and a rough standard deviation of the points on it."""
    judges = points
    if len(points) > JUDGING_POINTS:
        judges = points[rng.choice(len(points), JUDGING_POINTS, False)]
    judges = np.ascontiguousarray(judges)
    seed = int(rng.integers(2**32))
    groups = _core.near_groups(judges, geometry.points, geometry.trials, NEARBY, seed)
    bodies = geometry.through(judges[groups])
    if not len(bodies):
        raise InputError(
            "fit: expected points that determine a body, got points on a line or in one place"
        )
    # The distance within which the required share of the points lies: the smaller the better.
    for some in (judges[:: max(1, len(judges) // FIRST_JUDGES)], judges):
        some, bodies = np.ascontiguousarray(some), np.ascontiguousarray(bodies)
        scores = _core.form_scores(geometry.kind, bodies, some, BODY_SHARE)
        best = np.argsort(scores)[:SECOND_TRIALS]
        bodies = bodies[best]
    return bodies[0], float(scores[best[0]]) / TENTH_OF_NORMAL


def _fit(
    scaled: FloatMap, weight: FloatMap, start: FloatMap, spread: float, geometry: FormGeometry
) -> tuple[FloatMap, FloatMap, FloatMap, BoolMap] | None:
    """Values of the body, covariance for points that err by 1, distances of all points, and which
    of them belong to it.

    None where fewer than ten points belong to it.
    """
    values = start
    unit: FloatMap = np.zeros((len(start), len(start)))
    used = np.zeros(len(scaled), bool)
    distance = _core.form_distances(geometry.kind, values, scaled)
    for _ in range(FIT_ROUNDS):
        before, used = used, np.abs(distance) * weight <= FAR_SIGMAS * max(spread, ROUNDING)
        if np.count_nonzero(used) < MIN_POINTS:
            return None
        values, unit = _refine(values, scaled, weight, used, geometry)
        distance = _core.form_distances(geometry.kind, values, scaled)
        spread = robust_sigma((distance * weight)[used])
        if np.array_equal(before, used):
            break
    return values, unit, distance, used


def _refine(
    start: FloatMap, points: FloatMap, weight: FloatMap, used: BoolMap, geometry: FormGeometry
) -> tuple[FloatMap, FloatMap]:
    """Least squares of the weighted distances: the body's values, and their covariance where
    points err by 1, independently.

    Gauss–Newton with exact derivatives, damped where a step fails (Levenberg and Marquardt).
    """
    every = max(1, int(used.sum()) // REFINED_POINTS)
    index = np.flatnonzero(used)[::every]
    part, part_weight = points.take(index, axis=0), weight.take(index)
    values, damping = start, 0.0
    cost, slope, normal = _normal(values, part, part_weight, geometry)
    for _ in range(MAX_STEPS):
        basis = _changing(values, geometry)
        inside = basis.T @ normal @ basis
        damped = inside + damping * np.diag(np.diag(inside))
        step = -basis @ np.linalg.lstsq(damped, basis.T @ slope, rcond=None)[0]
        # The step would lower the cost by this much if the distances were linear.
        if -float(slope @ step) <= SETTLED * cost:
            break
        moved = _normal(values + step, part, part_weight, geometry)
        if moved[0] > cost:
            damping = max(MORE_DAMPING * damping, LEAST_DAMPING)
        else:
            values, (cost, slope, normal) = values + step, moved
            damping = damping / MORE_DAMPING if damping > LEAST_DAMPING else 0.0
    basis = _changing(values, geometry)
    own, vectors = np.linalg.eigh(basis.T @ normal @ basis)
    basis = (basis @ vectors) / np.sqrt(np.maximum(own, TINY_EIGENVALUE))
    return values, basis @ basis.T / every


def _normal(
    values: FloatMap, points: FloatMap, weight: FloatMap, geometry: FormGeometry
) -> tuple[float, FloatMap, FloatMap]:
    """Sum of the squared weighted distances, half its derivative by the body's values, and the
    matrix of the normal equations."""
    moments = _core.form_moments(geometry.kind, values, points, weight)
    return float(moments[-1, -1]), moments[-1, :-1], moments[:-1, :-1]


def _changing(values: FloatMap, geometry: FormGeometry) -> FloatMap:
    """Orthonormal changes of the values that change the body, (values, k)."""
    free = geometry.free(values)
    return np.asarray(np.linalg.svd(free)[2][len(free) :].T) if len(free) else np.eye(values.size)
