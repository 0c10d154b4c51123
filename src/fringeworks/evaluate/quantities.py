"""Quantities of parts that can have a tolerance, each one function: value and uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import scipy

from fringeworks.evaluate.area_points import AreaPoints, Term, sigma_of
from fringeworks.surface.form import DISCARDED, Form, fit_region
from fringeworks.surface.form_geometry import BodyKind
from fringeworks.types import FloatMap, InputError

HALF_SIGMAS = 4.0
"""Upper end of the search for half of a range, standard deviations: 0.006 % of normal errors lie
beyond, which is less than the discarded 0.3 %."""
MOST_SIGMAS = 10_000
"""About as many points, evenly thinned, enter the range of the noise: all of them would change it
by less than 1 %."""
LEAST_SHARE_OF_VOLUME = 0.99
"""Smallest share of measured pixels of a volume: nothing is known about the rest."""


@dataclass(frozen=True)
class Quantified:
    """A quantity that was measured."""

    value: float
    sigma: float
    """Standard deviation, of noise and of calibration."""
    unit: str
    noise: float = 0.0
    """By how much noise alone may have raised the value; 0 where it does not."""


def flatness(part: AreaPoints) -> Quantified:
    """Range of the distances from the plane of least squares, without the farthest 0.3 %.

    Errors of points widen the range F. Their part is F − √(F² − R²), with the range R that they
    alone would have.
    """
    plane = _Plane(part)
    away = plane.heights(part.points)
    order = np.argsort(away)
    kept = max(int(np.ceil((1.0 - DISCARDED) * order.size)), 1)
    ranges = away[order[kept - 1 :]] - away[order[: order.size - kept + 1]]
    first = int(np.argmin(ranges))
    value = float(ranges[first])
    sigma = np.abs(part.by_value @ plane.normal) * part.sigma
    inner = float(np.sqrt(max(value**2 - noise_range(sigma) ** 2, 0.0)))
    # The range is the difference of its two ends; the plane between them follows all points.
    ends = np.zeros(order.size)
    ends[order[first + kept - 1]], ends[order[first]] = 1.0, -1.0
    follows = (ends @ plane.at(part.points)) @ plane.inverse
    return Quantified(
        value, sigma_of([Term(part, ends - follows, plane.normal)]), "mm", noise=value - inner
    )


def noise_range(sigma: FloatMap) -> float:
    """Return the range that holds 99.7 % of normal errors with these standard deviations."""
    step = max(1, len(sigma) // MOST_SIGMAS)
    known = np.maximum(sigma[::step], np.finfo(np.float64).tiny)

    def beyond(half: float) -> float:
        return float(np.mean(2.0 * scipy.special.ndtr(-half / known))) - DISCARDED

    return 2.0 * float(scipy.optimize.brentq(beyond, 0.0, HALF_SIGMAS * float(known.max())))


def step_height(part: AreaPoints, base: AreaPoints) -> Quantified:
    """Mean distance of an area from the plane through the base, positive towards the camera."""
    plane = _Plane(base)
    n = len(part.points)
    follows = plane.at(part.points).mean(axis=0) @ plane.inverse
    terms = [Term(part, np.full(n, 1.0 / n), plane.normal), Term(base, -follows, plane.normal)]
    return Quantified(float(plane.heights(part.points).mean()), sigma_of(terms), "mm")


def distance(one: AreaPoints, other: AreaPoints) -> Quantified:
    """Distance of the mean points of two areas."""
    way = other.middle - one.middle
    length = float(np.linalg.norm(way))
    if length == 0:
        raise InputError("distance: expected two areas, got one twice")
    unit = way / length
    terms = [
        Term(area, np.full(len(area.points), sign / len(area.points)), unit)
        for area, sign in ((other, 1.0), (one, -1.0))
    ]
    return Quantified(length, sigma_of(terms), "mm")


def sphere_diameter(part: AreaPoints) -> Quantified:
    """Diameter of the sphere of least squares."""
    found = _sphere(part)
    return Quantified(
        2.0 * found.radius, 2.0 * sigma_of([Term(part, found.weights[3], found.normals)]), "mm"
    )


def sphere_spacing(one: AreaPoints, other: AreaPoints) -> Quantified:
    """Distance of the centres of two spheres."""
    spheres = _sphere(one), _sphere(other)
    way = spheres[1].centre - spheres[0].centre
    length = float(np.linalg.norm(way))
    if length == 0:
        raise InputError("sphere_spacing: expected two areas, got one twice")
    unit = way / length
    terms = [
        Term(area, sign * (unit @ sphere.weights[:3]), sphere.normals)
        for area, sphere, sign in ((one, spheres[0], -1.0), (other, spheres[1], 1.0))
    ]
    return Quantified(length, sigma_of(terms), "mm")


def cylinder_diameter(part: AreaPoints) -> Quantified:
    """Diameter of the cylinder of least squares."""
    form = _fitted(part, "cylinder")
    radius = form.parameters["radius_mm"]
    assert isinstance(radius, float)
    axis = np.asarray(form.parameters["axis"])
    out = part.points - np.asarray(form.parameters["point_mm"])
    along = out @ axis
    out = out - along[:, None] * axis
    normals = out / np.linalg.norm(out, axis=1, keepdims=True)
    across = normals @ np.linalg.svd(axis[None, :])[2][1:].T
    slopes = np.column_stack((across, across * along[:, None], np.ones(len(along))))
    weights = np.linalg.pinv(slopes * form.used[:, None])[-1]
    return Quantified(2.0 * radius, 2.0 * sigma_of([Term(part, weights, normals)]), "mm")


def volume(part: AreaPoints, base: AreaPoints) -> Quantified:
    """Volume between an area and the plane through the base, positive towards the camera.

    Each pixel counts with its element of the surface, projected on the plane.
    """
    plane = _Plane(base)
    pieces = np.abs(part.size_mm2 @ plane.normal)
    measured = np.isfinite(pieces)
    share = float(measured.sum()) / part.wanted
    if share < LEAST_SHARE_OF_VOLUME:
        raise InputError(
            f"volume: expected {LEAST_SHARE_OF_VOLUME:.0%} of the area to be measured, got "
            f"{share:.1%}"
        )
    pieces = np.where(measured, pieces, 0.0)
    follows = (pieces @ plane.at(part.points)) @ plane.inverse
    terms = [Term(part, pieces, plane.normal), Term(base, -follows, plane.normal)]
    return Quantified(float(pieces @ plane.heights(part.points)), sigma_of(terms), "mm³")


def valid_share(part: AreaPoints) -> Quantified:
    """Share of the area's pixels that have a value, 0…1."""
    return Quantified(part.share, 0.0, "")


def median_sigma(part: AreaPoints) -> Quantified:
    """Median standard deviation of the area's pixels."""
    return Quantified(float(np.median(part.sigma)), 0.0, "mm")


MEASURED: Mapping[str, Callable[..., Quantified]] = MappingProxyType(
    {
        one.__name__: one
        for one in (
            flatness,
            step_height,
            distance,
            sphere_diameter,
            sphere_spacing,
            cylinder_diameter,
            volume,
            valid_share,
            median_sigma,
        )
    }
)
"""What measures each quantity."""


def _fitted(part: AreaPoints, body: BodyKind) -> Form:
    # Where the calibration's errors are known, they are added to what follows from the fit.
    common = 0.0 if part.by_rig is not None else float(np.sqrt(np.mean(part.common**2)))
    return fit_region(part.points, body, common_mm=common)


class _Plane:
    """The plane of least squares through an area, and its derivatives by the points."""

    def __init__(self, base: AreaPoints) -> None:
        form = _fitted(base, "plane")
        normal = np.asarray(form.parameters["normal"])
        self.normal: FloatMap = normal if normal @ base.up > 0 else -normal
        """Towards the camera, (3,)."""
        self._point = np.asarray(form.parameters["point_mm"])
        self._across = np.linalg.svd(normal[None, :])[2][1:]
        self.inverse: FloatMap = np.linalg.pinv(self.at(base.points) * form.used[:, None])
        """Derivative of the plane's three values by the displacement of each point, (3, n)."""

    def at(self, points: FloatMap) -> FloatMap:
        """Return the derivative of the plane's height at points by its three values, (n, 3)."""
        places = (points - self._point) @ self._across.T
        return np.column_stack((np.ones(len(points)), places))

    def heights(self, points: FloatMap) -> FloatMap:
        """Return the signed distances of points, (n,), mm."""
        return np.asarray((points - self._point) @ self.normal)


@dataclass(frozen=True)
class _Sphere:
    """The sphere of least squares through an area."""

    centre: FloatMap
    radius: float
    normals: FloatMap
    """Outwards at each point, (n, 3)."""
    weights: FloatMap
    """Derivative of centre and radius by the displacement of each point, (4, n)."""


def _sphere(part: AreaPoints) -> _Sphere:
    form = _fitted(part, "sphere")
    centre = np.asarray(form.parameters["centre_mm"])
    radius = form.parameters["radius_mm"]
    assert isinstance(radius, float)
    out = part.points - centre
    normals = out / np.linalg.norm(out, axis=1, keepdims=True)
    slopes = np.column_stack((normals, np.ones(len(normals))))
    return _Sphere(centre, radius, normals, np.linalg.pinv(slopes * form.used[:, None]))
