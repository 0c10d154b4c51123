"""Quantities of parts that can have a tolerance, each one function: value and uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fringeworks.evaluate.area_points import (
    AreaPoints,
    Term,
    area_points,
    noise_along,
    shares_of,
)
from fringeworks.evaluate.deviation import Deviation
from fringeworks.evaluate.quantified import (
    Noise,
    Quantified,
    freed,
    freed_range,
    kept_of,
    narrowest,
    narrowest_range,
)
from fringeworks.evaluate.shares import Share, Shares, scaled, total
from fringeworks.rig.pinhole import transform
from fringeworks.surface.closest import MeshDistance
from fringeworks.surface.form import DISCARDED, Form, fit_region
from fringeworks.surface.form_geometry import BodyKind
from fringeworks.types import Area, FloatMap, InputError, PointCloud, Reason, Rig, TriangleMesh
from fringeworks.types.numbers import percent

SECTION_POINTS = 300
"""Number of points of a section of a cylinder: 0.3 % of them are one."""
MOST_SECTIONS = 9
"""Largest number of sections along a cylinder."""
RIGHT_ANGLE_DEG = 90.0
"""Angle from which on noise across it does not raise it."""
PARALLEL_SINE = 1e-9
"""Sine of an angle below which two planes are parallel to rounding."""
LEAST_SHARE_OF_VOLUME = 0.99
"""Smallest share of measured pixels of a volume: nothing is known about the rest."""


class PartOnModel:
    """Distances of points in the part's coordinates from its model, wherever they are moved."""

    def __init__(self, model: TriangleMesh, T_model_part: FloatMap) -> None:
        self._model, self._T = model, T_model_part

    @cached_property
    def _mesh(self) -> MeshDistance:
        return MeshDistance(self._model)

    def __call__(self, points_mm: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Return signed distances of points (n, 3), (n,), mm, and directions out of the model's
        round surface, (n, 3)."""
        placed = transform(self._T, points_mm)
        apart = float(np.abs(placed).max() + np.abs(self._mesh.corners).max())
        found = self._mesh.nearest(placed, 2.0 * apart)
        return found.distance_mm, self._mesh.smooth_normals(found) @ self._T[:3, :3]


@dataclass(frozen=True)
class AreaDeviation(AreaPoints):
    """The points of an area with their distances from the model.

    ``by_rig`` holds what is left of the calibration's errors when the alignment has followed them.
    """

    distance: FloatMap
    """Signed distance from the model, (n,), mm."""
    outwards: FloatMap
    """Directions out of the model, in the part's coordinates, (n, 3)."""
    by_pose: FloatMap
    """Derivative of the distances by an error ξ of the alignment, (n, 6)."""
    pose_covariance: FloatMap
    """(6, 6) covariance of ξ that is not in ``by_rig``."""
    on_model: PartOnModel
    """Distances of any points of the part from the model."""

    def shares_by(self, weights: FloatMap) -> Shares:
        """Return the parts of σ of a quantity with these derivatives by the distances, (n,)."""
        pose = weights @ self.by_pose
        aligned = Share("alignment", float(np.sqrt(pose @ self.pose_covariance @ pose)))
        return (*shares_of([Term(self, weights, self.outwards)]), aligned)


def _middle(cloud: PointCloud) -> FloatMap:
    """Mean of the measured points, (3,), mm: alignments follow an error of the scale about it."""
    return np.asarray(cloud.xyz_mm[cloud.reason == Reason.OK].mean(axis=0, dtype=np.float64))


def area_deviation(
    found: Deviation, area: Area, rig: Rig | None, *, scales: Shares = ()
) -> AreaDeviation:
    """Return the points of an area with their distances.

    Parameters
    ----------
    found : Deviation
        Of a cloud of a camera.
    area : Area
    rig : Rig, optional
        The rig that the deviation was computed with.
    scales : tuple of Share
        Stated errors of the scale, relative.

    Raises
    ------
    InputError for a part that is no cloud, an area with fewer than ten measured pixels, and one of
    which more than 0.3 % lie beyond the reach of the model.
    """
    if not isinstance(found.part, PointCloud):
        raise InputError("deviation: expected a cloud of a camera for an area of its image")
    pixels = area.pixels(found.part.shape)
    beyond = float(np.mean(found.reason[pixels] == Reason.OUTSIDE))
    if beyond > DISCARDED:
        raise InputError(
            f"deviation: expected points within reach of the model, got {percent(beyond)} that lie "
            "farther away; give a larger reach, or another area"
        )
    cloud = replace(found.part, reason=found.reason)
    base = area_points(cloud, area, rig, scales=scales)
    rows, columns = np.nonzero(pixels & (found.reason == Reason.OK))
    T, pose = found.alignment.T_model_part, found.alignment
    n = np.asarray(found.normals[rows, columns], np.float64)
    placed = np.asarray(found.points_mm[rows, columns], np.float64)
    by_rig = base.by_rig
    if by_rig is not None and pose.response is not None:
        count = np.bincount(base.cell, minlength=len(by_rig))
        middle = [np.bincount(base.cell, placed[:, k], len(by_rig)) / count for k in range(3)]
        turned = np.cross(pose.response[:3].T[None], np.stack(middle, axis=-1)[:, None])
        moved = turned + pose.response[3:].T[None]
        by_rig = by_rig + np.einsum("ji,ckj->cik", T[:3, :3], moved)
    covariance = pose.noise
    if by_rig is None and pose.by != "best fit":
        covariance = covariance + pose.common
    return AreaDeviation(
        **{field.name: getattr(base, field.name) for field in fields(base) if field.init}
        | {"by_rig": by_rig, "still": _middle(found.part)},
        distance=np.asarray(found.distance_mm[rows, columns], np.float64),
        outwards=n @ T[:3, :3],
        by_pose=np.column_stack((np.cross(placed, n), n)),
        pose_covariance=covariance,
        on_model=PartOnModel(found.model, T),
    )


def deviation_mean(part: AreaDeviation) -> Quantified:
    """Mean signed distance from the model."""
    n = len(part.distance)
    return Quantified(float(part.distance.mean()), part.shares_by(np.full(n, 1.0 / n)), "mm")


def deviation_rms(part: AreaDeviation) -> Quantified:
    """Root mean square distance from the model."""
    value = float(np.sqrt(np.mean(part.distance**2)))
    weights = part.distance / (len(part.distance) * max(value, np.finfo(np.float64).tiny))
    noise = float(np.sqrt(np.mean(noise_along(part, part.outwards) ** 2)))
    alone = Noise(noise, noise / (2.0 * len(part.distance)) ** 0.5)
    return freed(value, part.shares_by(weights), alone, "mm")


def deviation_max(part: AreaDeviation) -> Quantified:
    """Largest distance from the model to either side, without the farthest 0.3 %."""
    inner = np.flatnonzero(part.inner)
    size = np.abs(part.distance[inner])
    at = int(inner[np.argsort(size, kind="stable")[kept_of(size.size) - 1]])
    weights = np.zeros(len(part.distance))
    weights[at] = np.sign(part.distance[at])
    noise, shares = noise_along(part, part.outwards)[inner], part.without_noise().shares_by(weights)

    def farthest(distance: FloatMap) -> float:
        kept = kept_of(distance.size) - 1
        return float(np.partition(np.abs(distance), kept)[kept])

    alike = part.like_noise_at(inner)
    return freed_range(part.distance[inner], noise, farthest, shares, like_noise=alike)


def flatness(part: AreaPoints) -> Quantified:
    """Range of the distances from the plane of least squares, without the farthest 0.3 %, pixels
    beside others without a value, and the share of noise."""
    return _range_from_plane(part, part)


def parallelism(part: AreaPoints, base: AreaPoints) -> Quantified:
    """Range of the distances from a plane parallel to the base, without the same."""
    return _range_from_plane(part, base)


def _range_from_plane(part: AreaPoints, base: AreaPoints) -> Quantified:
    plane = _plane(base)
    inner = np.flatnonzero(part.inner)
    heights = plane.heights(part.points[inner])
    _, top, bottom = narrowest_range(heights)
    sigma = noise_along(part, plane.normal)[inner]
    # The range is the difference of its two ends; the plane between them follows the base.
    ends = np.zeros(len(part.points))
    ends[inner[top]], ends[inner[bottom]] = 1.0, -1.0
    top_at, bottom_at = plane.at(part.points[inner[[top, bottom]]])
    follows = (top_at - bottom_at) @ plane.inverse
    # The ends are chosen among all points: their noise is that of a range, not of two points.
    still = part.without_noise()
    if base is part:
        terms = [Term(still, ends - follows, plane.normal)]
    else:
        terms = [Term(still, ends, plane.normal), Term(base, -follows, plane.normal)]
    alike = part.like_noise_at(inner)
    return freed_range(heights, sigma, narrowest, shares_of(terms), like_noise=alike)


def angle(one: AreaPoints, other: AreaPoints) -> Quantified:
    """Angle between the planes of two areas, 0 … 180°: that of their normals to the camera."""
    planes = _plane(one), _plane(other)
    n, m = planes[0].normal, planes[1].normal
    axis = np.cross(n, m)
    sine = float(np.linalg.norm(axis))
    value = float(np.degrees(np.arctan2(sine, n @ m)))
    axis = axis / sine if sine > PARALLEL_SINE else planes[0].across[0]
    # The angle grows with the rotation of the second plane about the axis, against the first.
    # A rotation about the third direction raises an angle of 0 only.
    middle = (n + m) / max(float(np.linalg.norm(n + m)), PARALLEL_SINE)
    across = np.cross(axis, middle)
    spread = []
    for about in (axis, across):
        terms = [
            Term(area, sign * plane.turning(about), plane.normal)
            for area, plane, sign in ((one, planes[0], -1.0), (other, planes[1], 1.0))
        ]
        spread.append(scaled(shares_of(terms), float(np.degrees(1.0))))
    # Two angles across each other, of which noise makes one: |N(0, s)| is s√(2/π) ± 0.6 s.
    across_noise = total(spread[1]) if value < RIGHT_ANGLE_DEG else 0.0
    return freed(value, spread[0], Noise(across_noise, 0.6 * across_noise), "°")


def roundness(part: AreaPoints) -> Quantified:
    """Largest range of the radial distances in a section across the cylinder of least squares.

    Each section has a circle of least squares of its own; its farthest 0.3 % do not count.
    """
    cylinder = _cylinder(part)
    count = int(np.clip(len(part.points) // SECTION_POINTS, 1, MOST_SECTIONS))
    order = np.argsort(cylinder.along)
    order = order[part.inner[order]]
    found = [_section(part, cylinder, index) for index in np.array_split(order, count)]
    noise = noise_along(part, cylinder.normals)[order]
    shares = max(found, key=lambda one: narrowest(one[0]))[1]
    away = np.concatenate([section for section, _ in found])

    def largest(distances: FloatMap) -> float:
        return max(narrowest(section) for section in np.array_split(distances, count))

    return freed_range(away, noise, largest, shares, like_noise=part.like_noise_at(order))


def _section(
    part: AreaPoints, cylinder: _Cylinder, index: NDArray[np.intp]
) -> tuple[FloatMap, Shares]:
    """Radial distances of the points of one section from its own circle, and the parts of σ of
    their range without noise."""
    slopes = np.column_stack((cylinder.across[index], np.ones(len(index))))
    inverse = np.linalg.pinv(slopes)
    away = cylinder.distance[index]
    away = away - slopes @ (inverse @ away)
    _, top, bottom = narrowest_range(away)
    ends = np.zeros(len(index))
    ends[top], ends[bottom] = 1.0, -1.0
    weights = np.zeros(len(part.points))
    weights[index] = ends - (ends @ slopes) @ inverse
    return away, shares_of([Term(part.without_noise(), weights, cylinder.normals)])


def step_height(part: AreaPoints, base: AreaPoints) -> Quantified:
    """Mean distance of an area from the plane through the base, positive towards the camera."""
    plane = _plane(base)
    n = len(part.points)
    follows = plane.at(part.middle[None])[0] @ plane.inverse
    terms = [Term(part, np.full(n, 1.0 / n), plane.normal), Term(base, -follows, plane.normal)]
    return Quantified(float(plane.heights(part.points).mean()), shares_of(terms), "mm")


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
    return Quantified(length, shares_of(terms), "mm")


def sphere_diameter(part: AreaPoints) -> Quantified:
    """Diameter of the sphere of least squares."""
    found = _sphere(part)
    return Quantified(
        2.0 * found.radius,
        scaled(shares_of([Term(part, found.weights[3], found.normals)]), 2.0),
        "mm",
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
    return Quantified(length, shares_of(terms), "mm")


def cylinder_diameter(part: AreaPoints) -> Quantified:
    """Diameter of the cylinder of least squares."""
    found = _cylinder(part)
    slopes = np.column_stack(
        (found.across, found.across * found.along[:, None], np.ones(len(found.along)))
    )
    weights = _inverse(slopes, found.used * part.weights)[-1]
    return Quantified(
        2.0 * found.radius, scaled(shares_of([Term(part, weights, found.normals)]), 2.0), "mm"
    )


def volume(part: AreaPoints, base: AreaPoints) -> Quantified:
    """Volume between an area and the plane through the base, positive towards the camera.

    Each pixel counts with its element of the surface, projected on the plane.
    """
    plane = _plane(base)
    pieces = np.abs(part.size_mm2 @ plane.normal)
    measured = np.isfinite(pieces)
    share = float(measured.sum()) / part.wanted
    if share < LEAST_SHARE_OF_VOLUME:
        raise InputError(
            f"volume: expected {percent(LEAST_SHARE_OF_VOLUME)} of the area to be measured, got "
            f"{percent(share)}"
        )
    pieces = np.where(measured, pieces, 0.0)
    follows = (pieces @ plane.at(part.points)) @ plane.inverse
    terms = [Term(part, pieces, plane.normal), Term(base, -follows, plane.normal)]
    return Quantified(float(pieces @ plane.heights(part.points)), shares_of(terms), "mm³")


def valid_share(part: AreaPoints) -> Quantified:
    """Share of the area's pixels that have a value, 0…1."""
    return Quantified(part.share, (), "")


def median_sigma(part: AreaPoints) -> Quantified:
    """Median standard deviation of the area's pixels."""
    return Quantified(float(np.median(part.sigma)), (), "mm")


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
            parallelism,
            angle,
            roundness,
            valid_share,
            median_sigma,
            deviation_mean,
            deviation_rms,
            deviation_max,
        )
    }
)
"""What measures each quantity."""


def _fitted(part: AreaPoints, body: BodyKind) -> Form:
    # Where the calibration's errors are known, they are added to what follows from the fit.
    common = 0.0 if part.by_rig is not None else float(np.sqrt(np.mean(part.common**2)))
    weights = part.weights
    sigma = None if (weights == 1.0).all() else 1.0 / weights
    return fit_region(part.points, body, sigma_mm=sigma, common_mm=common)


def _inverse(slopes: FloatMap, factors: FloatMap) -> FloatMap:
    """Derivative of the values of a weighted fit by the displacement of each point, (k, n)."""
    weighted = slopes * (factors**2)[:, None]
    return np.asarray(np.linalg.pinv(weighted.T @ slopes, hermitian=True) @ weighted.T)


def _plane(base: AreaPoints) -> _Plane:
    return base.once("plane", _Plane)


class _Plane:
    """The plane of least squares through an area, and its derivatives by the points."""

    def __init__(self, base: AreaPoints) -> None:
        form = _fitted(base, "plane")
        normal = np.asarray(form.parameters["normal"])
        self.normal: FloatMap = normal if normal @ base.up > 0 else -normal
        """Towards the camera, (3,)."""
        self._point = np.asarray(form.parameters["point_mm"])
        self.across: FloatMap = np.linalg.svd(normal[None, :])[2][1:]
        """Two directions in the plane, (2, 3)."""
        self.inverse: FloatMap = _inverse(self.at(base.points), form.used * base.weights)
        """Derivative of the plane's three values by the displacement of each point, (3, n)."""

    def at(self, points: FloatMap) -> FloatMap:
        """Return the derivative of the plane's height at points by its three values, (n, 3)."""
        slopes = np.ones((3, len(points)))  # each derivative in a row, which is read as a whole
        np.matmul(self.across, (points - self._point).T, out=slopes[1:])
        return slopes.T

    def turning(self, axis: FloatMap) -> FloatMap:
        """Return the derivative of a rotation of the plane about an axis by each point, (n,)."""
        # A plane that rises along u turns its normal by −u. A rotation about the axis a turns the
        # normal by a × n, so that it is the rise along n × a.
        rise = self.across @ np.cross(self.normal, axis)
        return np.asarray(rise @ self.inverse[1:])

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
    return part.once("sphere", _sphere_through)


def _sphere_through(part: AreaPoints) -> _Sphere:
    form = _fitted(part, "sphere")
    centre = np.asarray(form.parameters["centre_mm"])
    radius = form.parameters["radius_mm"]
    assert isinstance(radius, float)
    out = part.points - centre
    normals = out / np.linalg.norm(out, axis=1, keepdims=True)
    slopes = np.column_stack((normals, np.ones(len(normals))))
    return _Sphere(centre, radius, normals, _inverse(slopes, form.used * part.weights))


def _cylinder(part: AreaPoints) -> _Cylinder:
    return part.once("cylinder", _Cylinder)


class _Cylinder:
    """The cylinder of least squares through an area."""

    def __init__(self, part: AreaPoints) -> None:
        form = _fitted(part, "cylinder")
        radius = form.parameters["radius_mm"]
        assert isinstance(radius, float)
        self.radius = radius
        self.used = form.used
        self.distance: FloatMap = form.distance_mm
        """Of each point, (n,), mm, outwards."""
        axis = np.asarray(form.parameters["axis"])
        out = part.points - np.asarray(form.parameters["point_mm"])
        self.along: FloatMap = out @ axis
        """Place of each point along the axis, (n,), mm."""
        out = out - self.along[:, None] * axis
        self.normals: FloatMap = out / np.linalg.norm(out, axis=1, keepdims=True)
        """Outwards at each point, (n, 3)."""
        self.across: FloatMap = self.normals @ np.linalg.svd(axis[None, :])[2][1:].T
        """Normals in two directions across the axis, (n, 2)."""
