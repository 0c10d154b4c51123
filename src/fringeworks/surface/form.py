"""Planes, spheres and cylinders fitted to points, evaluated in the terms of VDI/VDE 2634."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import optimize

from fringeworks.surface.form_geometry import GEOMETRIES, BodyKind, FormGeometry
from fringeworks.types import MAD_TO_SIGMA, BoolMap, FloatMap, Frozen, InputError

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
    """Which points belong to the body, (n,)."""
    sigma_mm: float | None
    """Standard deviation of the radius from the scatter of the points, mm; None for a plane."""

    @property
    def deviation_mm(self) -> float:
        """Standard deviation of the distances of the body's points, mm."""
        return float(np.std(self.distance_mm[self.used]))

    def spread_mm(self, share: float = 1.0 - DISCARDED) -> float:
        """Return the narrowest range of distances that holds a share of the body's points, mm."""
        ordered = np.sort(self.distance_mm[self.used])
        kept = max(int(np.ceil(share * ordered.size)), 1)
        return float(np.min(ordered[kept - 1 :] - ordered[: ordered.size - kept + 1]))


def fit_form(
    points_mm: FloatMap, body: BodyKind, *, sigma_mm: FloatMap | None = None, seed: int = 0
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
    seed : int
        Seed of the random choice of points for the start.

    Returns
    -------
    Form

    Raises
    ------
    InputError for too few points or points that are not finite, and where no such body is found:
    at least a tenth of the points must lie on it.

    Notes
    -----
    The start is, of many bodies through a few random points, the one that a tenth of all points
    lie nearest to (after RANSAC: Fischler and Bolles, CACM 24, 1981, doi:10.1145/358669.358692).
    Then the orthogonal distances are minimised; points beyond six robust standard deviations do
    not count.

    Examples
    --------
    >>> x, y = np.mgrid[:10, :10]
    >>> flat = np.column_stack((x.ravel(), y.ravel(), np.full(100, 500.0)))
    >>> form = fit_form(flat, "plane")
    >>> [round(v, 6) + 0.0 for v in form.parameters["normal"]], round(form.deviation_mm, 6)
    ([0.0, 0.0, -1.0], 0.0)
    """
    points, geometry = _checked(points_mm, body)
    weight = _weights(sigma_mm, len(points))
    rng = np.random.default_rng(seed)
    sample = points
    if len(points) > START_POINTS:
        sample = points[rng.choice(len(points), START_POINTS, False)]
    mean = sample.mean(axis=0)
    scale = float(np.sqrt(np.mean(np.sum((sample - mean) ** 2, axis=1))))
    if not scale > 0:
        raise InputError("fit: expected points that determine a body, got one point many times")
    start, spread = _start((sample - mean) / scale, geometry, rng)
    fitted = _fit((points - mean) / scale, weight, start, spread, geometry)
    if fitted is None:
        raise InputError(f"fit: expected {MIN_POINTS} or more points on a {body}, found fewer")
    values, covariance, distance, used = fitted
    if np.std(distance[used]) > MAX_SPREAD:
        raise InputError(
            f"fit: expected a {body}, found none that a tenth of the points lie on; fit a part of "
            "the cloud that shows the body alone"
        )
    parameters = geometry.parameters(values, mean, scale)
    # The radius is the last value of a sphere and of a cylinder.
    radius_sigma = float(np.sqrt(max(covariance[-1, -1], 0.0))) * scale
    return Form(body, parameters, distance * scale, used, None if body == "plane" else radius_sigma)


def _checked(points_mm: FloatMap, body: str) -> tuple[FloatMap, FormGeometry]:
    if body not in GEOMETRIES:
        raise InputError(f"fit: expected one of {', '.join(GEOMETRIES)}, got {body!r}")
    points = np.asarray(points_mm, np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(f"points: expected finite (n, 3), got shape {points.shape}")
    if len(points) < MIN_POINTS:
        raise InputError(f"fit: expected {MIN_POINTS} points or more, got {len(points)}")
    return points, GEOMETRIES[body]


def _weights(sigma_mm: FloatMap | None, n: int) -> FloatMap:
    """Factors of the distances, (n,): the median σ over each point's σ."""
    if sigma_mm is None:
        return np.ones(n)
    sigma = np.asarray(sigma_mm, np.float64)
    if sigma.shape != (n,) or not (sigma > 0).all():
        raise InputError(f"sigma: expected {n} values > 0, got shape {sigma.shape}")
    return np.asarray(np.median(sigma) / sigma)


def _start(
    points: FloatMap, geometry: FormGeometry, rng: np.random.Generator
) -> tuple[FloatMap, float]:
    """The best of many trial bodies, and a rough standard deviation of the points on it."""
    judges = points
    if len(points) > JUDGING_POINTS:
        judges = points[rng.choice(len(points), JUDGING_POINTS, False)]
    best: tuple[float, FloatMap] | None = None
    for _ in range(geometry.trials):
        anchor = judges[rng.integers(len(judges))]
        near = judges[np.sum((judges - anchor) ** 2, axis=1) < NEARBY**2]
        if len(near) < geometry.points:
            continue
        trial = geometry.through(near[rng.choice(len(near), geometry.points, False)])
        if trial is None:
            continue
        # The distance within which the required share of the points lies: the smaller the better.
        score = float(np.quantile(np.abs(geometry.distance(trial, judges)), BODY_SHARE))
        if best is None or score < best[0]:
            best = (score, trial)
    if best is None:
        raise InputError(
            "fit: expected points that determine a body, got points on a line or in one place"
        )
    return best[1], best[0] / TENTH_OF_NORMAL


def _fit(
    scaled: FloatMap, weight: FloatMap, start: FloatMap, spread: float, geometry: FormGeometry
) -> tuple[FloatMap, FloatMap, FloatMap, BoolMap] | None:
    """Values of the body, covariance, distances of all points, and which of them belong to it.

    None where fewer than ten points belong to it.
    """
    values = start
    covariance: FloatMap = np.zeros((len(start), len(start)))
    used = np.zeros(len(scaled), bool)
    distance = geometry.distance(values, scaled)
    for _ in range(FIT_ROUNDS):
        before, used = used, np.abs(distance) * weight <= FAR_SIGMAS * max(spread, 1e-12)
        if used.sum() < MIN_POINTS:
            return None
        values, covariance = _refine(values, scaled[used], weight[used], geometry)
        distance = geometry.distance(values, scaled)
        spread = MAD_TO_SIGMA * float(np.median(np.abs(distance * weight)[used]))
        if np.array_equal(before, used):
            break
    return values, covariance, distance, used


def _refine(
    start: FloatMap, points: FloatMap, weight: FloatMap, geometry: FormGeometry
) -> tuple[FloatMap, FloatMap]:
    """Least squares of the weighted distances: the body's values and their covariance."""
    every = max(1, len(points) // REFINED_POINTS)
    part, part_weight = points[::every], weight[::every]
    solved = optimize.least_squares(
        lambda p: geometry.distance(p, part) * part_weight, start, x_scale="jac", method="trf"
    )
    jacobian = solved.jac
    variance = 2.0 * solved.cost / max(len(part) - start.size, 1) / every
    return solved.x, np.linalg.pinv(jacobian.T @ jacobian) * variance


def find_spheres(
    points_mm: FloatMap, count: int, *, sigma_mm: FloatMap | None = None, seed: int = 0
) -> list[Form]:
    """Fit several spheres to one cloud, one after the other.

    Parameters
    ----------
    points_mm : (n, 3) array, mm
    count : int
        Number of spheres.
    sigma_mm, seed
        As for ``fit_form``.

    Returns
    -------
    list of Form, each with the distances of all points.

    Raises
    ------
    InputError where fewer spheres are found.
    """
    points = np.asarray(points_mm, np.float64)
    remaining = np.ones(len(points), bool)
    forms = []
    for k in range(count):
        if remaining.sum() < MIN_POINTS:
            raise InputError(f"fit: expected {count} spheres, found {k}")
        sigma = None if sigma_mm is None else sigma_mm[remaining]
        form = fit_form(points[remaining], "sphere", sigma_mm=sigma, seed=seed)
        used = np.zeros(len(points), bool)
        used[remaining] = form.used
        centre = np.asarray(form.parameters["centre_mm"])
        distance = np.linalg.norm(points - centre, axis=1) - float(form.parameters["radius_mm"])  # type: ignore[arg-type]
        forms.append(Form("sphere", form.parameters, distance, used, form.sigma_mm))
        remaining &= ~used
    return forms


def report(form: Form, *, diameter_mm: float | None = None) -> dict[str, Any]:
    """Return the numerical results of a fit in the terms of VDI/VDE 2634 part 2, ready for JSON.

    Parameters
    ----------
    form : Form
    diameter_mm : float > 0, optional
        Calibrated diameter of the sphere or cylinder, mm, for the probing error of size.

    Returns
    -------
    dict, lengths in mm. ``probing_error_form_PF_mm``: range of the radial distances.
    ``probing_error_size_PS_mm``: measured minus calibrated diameter. ``flatness_error_F_mm``: range
    of the distances from the plane. Up to 0.3 % of the points are discarded from the ranges.

    Raises
    ------
    InputError for a diameter of a plane, or one that is not above 0.

    Notes
    -----
    The guideline asks for many positions of calibrated artefacts. This is one position.
    """
    content: dict[str, Any] = {
        "fit": form.body,
        "points": int(form.used.sum()),
        "left_out": int((~form.used).sum()),
        **form.parameters,
        "standard_deviation_mm": form.deviation_mm,
        "range_mm": form.spread_mm(),
        "range_95_mm": form.spread_mm(0.95),
    }
    if form.body == "plane":
        if diameter_mm is not None:
            raise InputError(
                f"diameter_mm: expected none for a plane, got {diameter_mm}; only spheres and "
                "cylinders have one"
            )
        content["flatness_error_F_mm"] = content["range_mm"]
        return content
    content["radius_sigma_mm"] = form.sigma_mm
    content["probing_error_form_PF_mm"] = content["range_mm"]
    if diameter_mm is not None:
        if not diameter_mm > 0:
            raise InputError(f"diameter_mm: expected > 0 mm, got {diameter_mm}")
        measured = 2.0 * float(form.parameters["radius_mm"])  # type: ignore[arg-type]
        content["probing_error_size_PS_mm"] = measured - diameter_mm
    return content
