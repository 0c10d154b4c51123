"""Planes, spheres and cylinders fitted to points, judged in the vocabulary of VDI/VDE 2634."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import optimize

from fringeworks.types import BoolMap, FloatMap, InputError

Body = Literal["plane", "sphere", "cylinder"]
DISCARDED = 0.003
"""Share of the points that VDI/VDE 2634 part 2 lets go before a range is taken."""
NEARBY = 0.7
"""Reach of the points that a start goes through, of the cloud's size: likely on one body."""
LARGEST = 5.0
"""Largest radius of a sphere or cylinder, of the cloud's size: a plane is a sphere beyond."""
SAMPLE = 20_000
"""Points that a start and a robust fit are made of."""
FEWEST = 0.1
"""Share of the points that must lie on a body for it to be found."""
LOOSEST = 0.05
"""Standard deviation, of the cloud's size, beyond which points do not lie on a body."""
FAR = 6.0
"""Points beyond this many robust standard deviations do not belong to the body."""
ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Form:
    """A body fitted to points."""

    body: Body
    parameters: dict[str, list[float] | float]
    """plane: point_mm, normal; sphere: centre_mm, radius_mm; cylinder: point_mm, axis,
    radius_mm."""
    distance_mm: FloatMap
    """Signed distance of every point, (n,), mm: out of the sphere or cylinder, along the normal."""
    used: BoolMap
    """Points that belong to the body, (n,)."""
    sigma_mm: float | None
    """Standard deviation of the radius, by the scatter of the points; None for a plane."""

    @property
    def deviation_mm(self) -> float:
        """Standard deviation of the points that belong to the body."""
        return float(np.std(self.distance_mm[self.used]))

    def spread_mm(self, share: float = 1.0 - DISCARDED) -> float:
        """Narrowest range of distances that holds this share of the body's points."""
        ordered = np.sort(self.distance_mm[self.used])
        kept = max(int(np.ceil(share * ordered.size)), 1)
        return float(np.min(ordered[kept - 1 :] - ordered[: ordered.size - kept + 1]))


def fit_form(
    points_mm: FloatMap, body: Body, *, sigma_mm: FloatMap | None = None, seed: int = 0
) -> Form:
    """Least-squares body through the points that lie on it.

    Parameters
    ----------
    points_mm : (n, 3) array
    body : "plane", "sphere" or "cylinder"
    sigma_mm : (n,) array, optional
        Standard deviations along the body's normal: weights of the points.
    seed : int
        Of the random choice of a start.

    Raises
    ------
    InputError for too few points, and where no such body is found.

    Notes
    -----
    Start: the body through random points that most of all points lie near (RANSAC). Then least
    squares of orthogonal distances, points beyond six robust standard deviations left out.
    """
    if body not in BODIES:
        raise InputError(f"fit: expected one of {', '.join(BODIES)}, got {body!r}")
    points = np.asarray(points_mm, np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(f"points: expected finite (n, 3), got shape {points.shape}")
    if len(points) < 10:
        raise InputError(f"fit: expected 10 points or more, got {len(points)}")
    kind = BODIES[body]
    rng = np.random.default_rng(seed)
    some = points if len(points) <= SAMPLE else points[rng.choice(len(points), SAMPLE, False)]
    middle = some.mean(axis=0)
    scale = float(np.sqrt(np.mean(np.sum((some - middle) ** 2, axis=1))))
    if not scale > 0:
        raise InputError("fit: expected points that determine a body, got one point many times")
    found, spread = _start((some - middle) / scale, kind, rng)
    weight = np.ones(len(points))
    if sigma_mm is not None:
        sigma = np.asarray(sigma_mm, np.float64)
        if sigma.shape != (len(points),) or not (sigma > 0).all():
            raise InputError(f"sigma: expected {len(points)} values > 0, got {sigma.shape}")
        weight = np.median(sigma) / sigma
    scaled = (points - middle) / scale
    used = np.zeros(len(points), bool)
    distance = kind.distance(found, scaled)
    covariance: FloatMap = np.zeros((len(found), len(found)))
    for _ in range(ROUNDS):
        before, used = used, np.abs(distance) * weight <= FAR * max(spread, 1e-12)
        if used.sum() < 10:
            raise InputError(f"fit: expected a {body}, found none that 10 points lie on")
        part, part_weight = scaled[used], weight[used]
        found, covariance = _refine(found, part, part_weight, kind)
        distance = kind.distance(found, scaled)
        spread = 1.4826 * float(np.median(np.abs(distance * weight)[used]))
        if np.array_equal(before, used):
            break
    if np.std(distance[used]) > LOOSEST:
        raise InputError(
            f"fit: expected a {body}, found none that a tenth of the points lie on; take a part "
            "of the cloud"
        )
    parameters = kind.parameters(found, middle, scale)
    last = float(np.sqrt(max(covariance[-1, -1], 0.0))) * scale
    return Form(body, parameters, distance * scale, used, None if body == "plane" else last)


@dataclass(frozen=True)
class _Kind:
    points: int
    """Points that determine one."""
    trials: int
    """Bodies through a few points each, of which the one that most points lie on is the start."""
    through: Callable[[FloatMap], FloatMap | None]
    distance: Callable[[FloatMap, FloatMap], FloatMap]
    parameters: Callable[[FloatMap, FloatMap, float], dict[str, Any]]


def _start(points: FloatMap, kind: _Kind, rng: np.random.Generator) -> tuple[FloatMap, float]:
    judges = points if len(points) <= 2000 else points[rng.choice(len(points), 2000, False)]
    best: tuple[float, FloatMap] | None = None
    for _ in range(kind.trials):
        anchor = judges[rng.integers(len(judges))]
        near = judges[np.sum((judges - anchor) ** 2, axis=1) < NEARBY**2]
        if len(near) < kind.points:
            continue
        trial = kind.through(near[rng.choice(len(near), kind.points, False)])
        if trial is None:
            continue
        # The distance that a tenth of the points keep: a body needs that many to be found.
        score = float(np.quantile(np.abs(kind.distance(trial, judges)), FEWEST))
        if best is None or score < best[0]:
            best = (score, trial)
    if best is None:
        raise InputError("fit: expected points that determine a body, got none that do")
    # Were all points on the body, a tenth of them would lie within an eighth of their deviation.
    return best[1], best[0] / 0.125


def _refine(
    start: FloatMap, points: FloatMap, weight: FloatMap, kind: _Kind
) -> tuple[FloatMap, FloatMap]:
    step = max(1, len(points) // (10 * SAMPLE))
    part, w = points[::step], weight[::step]
    solved = optimize.least_squares(
        lambda p: kind.distance(p, part) * w, start, x_scale="jac", method="trf"
    )
    jacobian = solved.jac
    variance = 2.0 * solved.cost / max(len(part) - start.size, 1) / step
    return solved.x, np.linalg.pinv(jacobian.T @ jacobian) * variance


def _plane_through(p: FloatMap) -> FloatMap | None:
    n = np.cross(p[1] - p[0], p[2] - p[0])
    size = np.linalg.norm(n)
    return None if size < 1e-9 else np.array([*(n / size), n @ p[0] / size])


def _plane_distance(q: FloatMap, p: FloatMap) -> FloatMap:
    size = np.linalg.norm(q[:3])
    return np.asarray((p @ q[:3] - q[3]) / size)


def _plane_parameters(q: FloatMap, middle: FloatMap, scale: float) -> dict[str, Any]:
    n = q[:3] / np.linalg.norm(q[:3])
    if n[2] > 0:
        n = -n  # towards the camera
        q = -q
    offset = q[3] / np.linalg.norm(q[:3])
    return {
        "point_mm": [float(v) for v in middle + scale * offset * n],
        "normal": [float(v) for v in n],
    }


def _sphere_through(p: FloatMap) -> FloatMap | None:
    A = np.column_stack((2.0 * p, np.ones(4)))
    if abs(np.linalg.det(A)) < 1e-9:
        return None
    s = np.linalg.solve(A, np.sum(p * p, axis=1))
    square = s[3] + s[:3] @ s[:3]
    return None if square <= 0 or square > LARGEST**2 else np.array([*s[:3], np.sqrt(square)])


def _sphere_distance(q: FloatMap, p: FloatMap) -> FloatMap:
    return np.asarray(np.linalg.norm(p - q[:3], axis=1) - q[3])


def _sphere_parameters(q: FloatMap, middle: FloatMap, scale: float) -> dict[str, Any]:
    return {
        "centre_mm": [float(v) for v in middle + scale * q[:3]],
        "radius_mm": float(scale * abs(q[3])),
    }


def _cylinder_through(p: FloatMap) -> FloatMap | None:
    """Through five points: of many directions the one that puts them best on a circle."""
    best: tuple[float, FloatMap] | None = None
    for k in range(60):
        # Even over the half sphere (Fibonacci).
        z = (k + 0.5) / 60
        r, a = np.sqrt(1 - z * z), k * 2.399963
        q = _circle(p, np.array([r * np.cos(a), r * np.sin(a), z]))
        if q is None:
            continue
        score = float(np.abs(_cylinder_distance(q, p)).max())
        if best is None or score < best[0]:
            best = (score, q)
    return None if best is None else best[1]


def _circle(p: FloatMap, axis: FloatMap) -> FloatMap | None:
    x = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)
    u, v = p @ x, p @ y
    A = np.column_stack((2 * u, 2 * v, np.ones(len(p))))
    s, _, rank, _ = np.linalg.lstsq(A, u * u + v * v, rcond=None)
    square = s[2] + s[0] ** 2 + s[1] ** 2
    if rank < 3 or square <= 0 or square > LARGEST**2:
        return None
    return np.array([*(s[0] * x + s[1] * y), *axis, np.sqrt(square)])


def _cylinder_distance(q: FloatMap, p: FloatMap) -> FloatMap:
    axis = q[3:6] / np.linalg.norm(q[3:6])
    return np.asarray(np.linalg.norm(np.cross(p - q[:3], axis), axis=1) - q[6])


def _cylinder_parameters(q: FloatMap, middle: FloatMap, scale: float) -> dict[str, Any]:
    axis = q[3:6] / np.linalg.norm(q[3:6])
    foot = q[:3] - (q[:3] @ axis) * axis
    return {
        "point_mm": [float(v) for v in middle + scale * foot],
        "axis": [float(v) for v in axis],
        "radius_mm": float(scale * abs(q[6])),
    }


BODIES: dict[str, _Kind] = {
    "plane": _Kind(3, 300, _plane_through, _plane_distance, _plane_parameters),
    "sphere": _Kind(4, 1000, _sphere_through, _sphere_distance, _sphere_parameters),
    "cylinder": _Kind(6, 200, _cylinder_through, _cylinder_distance, _cylinder_parameters),
}


def find_spheres(
    points_mm: FloatMap, count: int, *, sigma_mm: FloatMap | None = None, seed: int = 0
) -> list[Form]:
    """Several spheres in one cloud, one after the other; distances are those of all points.

    Raises
    ------
    InputError where fewer are found.
    """
    points = np.asarray(points_mm, np.float64)
    rest = np.ones(len(points), bool)
    found = []
    for k in range(count):
        if rest.sum() < 10:
            raise InputError(f"fit: expected {count} spheres, found {k}")
        part = None if sigma_mm is None else sigma_mm[rest]
        form = fit_form(points[rest], "sphere", sigma_mm=part, seed=seed)
        used = np.zeros(len(points), bool)
        used[rest] = form.used
        centre = np.asarray(form.parameters["centre_mm"])
        distance = np.linalg.norm(points - centre, axis=1) - float(form.parameters["radius_mm"])  # type: ignore[arg-type]
        found.append(Form("sphere", form.parameters, distance, used, form.sigma_mm))
        rest &= ~used
    return found


def report(form: Form, *, diameter_mm: float | None = None) -> dict[str, Any]:
    """Figures of a fit in the vocabulary of VDI/VDE 2634 part 2, mm.

    probing error form PF: range of radial distances; probing error size PS: measured minus
    calibrated diameter; flatness measurement error F: range of distances from the plane. Up to
    0.3 % of the points may be discarded. (That guideline has them in many positions of calibrated
    artefacts; this is one position.)
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
            raise InputError("--diameter: expected together with a sphere or cylinder")
        content["flatness_error_F_mm"] = content["range_mm"]
        return content
    content["radius_sigma_mm"] = form.sigma_mm
    content["probing_error_form_PF_mm"] = content["range_mm"]
    if diameter_mm is not None:
        if not diameter_mm > 0:
            raise InputError(f"--diameter: expected > 0 mm, got {diameter_mm}")
        measured = 2.0 * float(form.parameters["radius_mm"])  # type: ignore[arg-type]
        content["probing_error_size_PS_mm"] = measured - diameter_mm
    return content
