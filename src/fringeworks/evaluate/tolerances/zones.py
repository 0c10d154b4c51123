"""Geometrical tolerances of ISO 1101:2017: each is the width of a zone under its datums."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fringeworks.evaluate.tolerances.association import associate, zone_of
from fringeworks.evaluate.tolerances.bodies import (
    SAME,
    Body,
    everything,
    invariant,
    shared,
    translations,
    twists,
)
from fringeworks.evaluate.tolerances.datums import NEAR_DEG, System
from fringeworks.evaluate.tolerances.settled import settled
from fringeworks.evaluate.tolerances.skins import Skin
from fringeworks.types import FloatMap, InputError
from fringeworks.types.numbers import number
from fringeworks.types.recipe import Association

SAME_ANGLE = 1e-3
"""Difference of two stated angles up to which they are the same, rad: directions are written with
three digits."""


@dataclass(frozen=True)
class Feature:
    """A measured feature, with its points as they are or as an error might have moved them."""

    skin: Skin
    change: FloatMap
    """Change of the distances of its points from its body, (m,), mm."""

    @cached_property
    def points(self) -> FloatMap:
        """The points of the surface, (m, 3), mm."""
        return self.skin.points(self.change)

    @property
    def body(self) -> Body:
        """The body of least squares of the points as they were measured."""
        return self.skin.body

    @property
    def pivot(self) -> FloatMap:
        """Point about which rotations count, (3,)."""
        return np.asarray(self.skin.foot.mean(axis=0))

    @property
    def scale(self) -> float:
        """Length by which rotations count as mm."""
        return float(np.sqrt(np.mean(np.sum((self.skin.foot - self.pivot) ** 2, axis=1))))

    @property
    def circles(self) -> bool:
        """Whether the lines are circles around a cylinder, which do not tilt."""
        across = self.skin.across
        if across is None or self.body.kind != "cylinder":
            return False
        return bool(abs(across @ self.body.direction) > np.sqrt(0.5))

    def derived(self) -> FloatMap:
        """Return the centre of a sphere, (1, 3), or those of the sections of a cylinder, (k, 3).

        Notes
        -----
        By least squares (ISO 17450-3:2016). A circle of least squares moves by the mean of the
        distances' first harmonic, which is linear in them.
        """
        body = self.body
        if body.kind == "sphere":
            found = associate(
                body, self.points, translations(), "least-squares", weights=self.skin.weight
            )
            return found.point[None]
        u, v = np.linalg.svd(body.direction[None])[2][1:]
        centres = []
        for at in self.skin.lines:
            n, away = body.normals(self.points[at]), body.distances(self.points[at])
            slopes = np.column_stack((n @ u, n @ v, np.ones(len(at))))
            x, y, _ = np.linalg.lstsq(slopes, away, rcond=None)[0]
            middle = body.point + body.along(self.points[at]).mean() * body.direction
            centres.append(middle + x * u + y * v)
        return np.array(centres)


def form(part: Feature, by: Association = "minimum-zone") -> float:
    """Flatness, roundness, cylindricity, straightness: 17.2 to 17.5 of ISO 1101:2017.

    The range of the distances from the associated body, free in all motions; the largest one of
    all lines, where the feature is judged by lines.
    """
    skin, free = part.skin, translations() if part.circles else everything()
    if not skin.lined or by not in ("minimum-zone", "least-squares"):
        return max(
            float(np.ptp(associate(part.body, points, free, by, weights=weights).distances(points)))
            for points, weights in ((part.points[at], skin.weight[at]) for at in skin.lines)
        )
    # Lines are short: one linear step is exact to the square of the deviation over the radius.
    away = skin.distance + part.change
    left = [away[at] - u @ (u.T @ away[at]) for at, u in zip(skin.lines, skin.bases, strict=True)]
    bounds = np.array([np.ptp(one) for one in left])
    if by == "least-squares":
        return float(bounds.max())
    # No line's smallest zone is wider than that of least squares.
    widest = 0.0
    for k in np.argsort(bounds)[::-1]:
        if bounds[k] <= widest:
            break
        widest = max(widest, 2.0 * zone_of(left[k], skin.bases[k]))
    return widest


def profile(part: Feature) -> float:
    """Profile of a line or a surface: 17.6 to 17.9. Twice the largest distance from the model.

    Without datums, the points, or those of each line, may move in the way that makes it smallest.
    """
    skin = part.skin
    if skin.model is None:
        return 2.0 * float(np.abs(skin.distance + part.change).max())
    starts = [
        one.changed(part.change[at], skin.normal[at])
        for at, one in zip(skin.lines, skin.settled, strict=True)
    ]
    # Motions only make a line's zone smaller.
    bounds = np.array([one.size for one in starts])
    largest = 0.0
    for k in np.argsort(bounds)[::-1]:
        if bounds[k] <= largest:
            break
        largest = max(largest, settled(starts[k], skin.motions, skin.model).size)
    return 2.0 * largest


def orientation(
    part: Feature, datums: System, angle_deg: float, direction: FloatMap | None = None
) -> float:
    """Parallelism, angularity, perpendicularity: 17.10 to 17.12.

    The zone keeps the angle between the feature's and the first datum's plane or axis, and is free
    in place: the range of distances of a plane, the diameter of the zone of an axis. Further datums
    may lock the turn about the first one (ISO 5459:2011). The zone then has one direction: the
    given one, in the frame of the datums, or the one at right angles to the others that is near.

    Raises
    ------
    InputError for spheres, and a direction that does not suit the angle or cannot be told.
    """
    body, first = part.body, datums.bodies[0]
    if first.kind == "sphere" or body.kind == "sphere":
        raise InputError("orientation: expected planes and cylinders, got a sphere")
    alike = (body.kind == "plane") == (first.kind == "plane")
    turn = float(np.radians(angle_deg if alike else 90.0 - angle_deg))
    if datums.locked:
        way = _locked(body.direction, datums.axes(), turn, direction)
    else:
        way = _at_angle(body.direction, first.direction, turn)
    exact = replace(body, direction=way)
    return _width(part, exact, datums.free_turns(part.pivot, part.scale), sized=True)


def _locked(near: FloatMap, axes: FloatMap, turn: float, direction: FloatMap | None) -> FloatMap:
    """The direction at an angle to the frame's z, as it is given or at right angles to x or y."""
    z = axes[:, 2]
    if direction is None:
        sides = [sign * axes[:, k] for k in range(2) for sign in (1.0, -1.0)]
    else:
        given = axes @ (direction / np.linalg.norm(direction))
        given = given if given @ z > 0 else -given
        off = abs(float(np.arccos(min(float(given @ z), 1.0))) - turn)
        if off > SAME_ANGLE:
            raise InputError(
                f"direction: expected {number(float(np.degrees(turn)))}° to the first datum, got "
                f"{number(float(np.degrees(off)))}° more or less"
            )
        across = given - (given @ z) * z
        sides = [across / max(float(np.linalg.norm(across)), SAME)]
    ways = [np.cos(turn) * z + np.sin(turn) * one for one in sides]
    way = max(ways, key=lambda one: abs(float(one @ near)))
    way = way if way @ near > 0 else -way
    apart = float(np.degrees(np.arccos(min(float(way @ near), 1.0))))
    if apart > NEAR_DEG:
        raise InputError(
            f"orientation: expected a feature within {number(NEAR_DEG)}° of its exact direction, "
            f"got {number(apart)}°: give the direction in the frame of the datums"
        )
    return np.asarray(way)


def location(part: Feature, datums: System, exact: Body) -> float:
    """Position, coaxiality, symmetry: 17.13 to 17.15.

    Twice the largest distance of the plane, the axis or the centre from its exact place.
    """
    free = datums.free(part.pivot, part.scale)
    return _width(
        part, exact, _without(free, invariant(exact, part.pivot, part.scale)), sized=False
    )


def run_out(part: Feature, datums: System) -> float:
    """Circular and total run-out: 17.16 and 17.17.

    The range of the distances from the datum axis, or along it for a plane; the largest of all
    circles for circular run-out.
    """
    axis = datums.bodies[0]
    if axis.kind != "cylinder":
        raise InputError(f"run-out: expected a cylinder as datum, got a {axis.kind}")
    values = axis.along(part.points) if part.body.kind == "plane" else axis.distances(part.points)
    return max(float(np.ptp(values[at])) for at in part.skin.lines)


def _width(part: Feature, exact: Body, free: FloatMap, *, sized: bool) -> float:
    """Range, where the place is free, or twice the largest distance from an exact body."""
    pivot, scale = part.pivot, part.scale
    if part.body.kind == "plane":
        found = associate(exact, part.points, free, sized=False, pivot=pivot, scale=scale)
        away = found.distances(part.points)
        return float(np.ptp(away)) if sized else 2.0 * float(np.abs(away).max())
    centres = part.derived()
    if part.body.kind == "sphere":
        off = centres[0] - exact.point
        moves = twists(np.repeat(centres, 3, axis=0), np.eye(3), pivot, scale) @ free
        off = off - moves @ (np.linalg.pinv(moves, rcond=1e-6) @ off)
        return 2.0 * float(np.linalg.norm(off))
    axis = replace(exact, kind="axis", radius=0.0)
    found = associate(axis, centres, free, sized=False, pivot=pivot, scale=scale)
    return 2.0 * float(found.distances(centres).max())


def _without(free: FloatMap, fixed: FloatMap) -> FloatMap:
    """Motions without those that leave the zone as it is, (6, j)."""
    same = shared(free, fixed)
    left = free - same @ (np.linalg.pinv(same) @ free)
    u, size, _ = np.linalg.svd(left, full_matrices=False)
    return np.asarray(u[:, size > SAME])


def _at_angle(direction: FloatMap, other: FloatMap, angle: float) -> FloatMap:
    """The direction turned, in the plane of both, to an exact angle from the other one."""
    along = float(direction @ other)
    across = direction - along * other
    size = float(np.linalg.norm(across))
    across = across / size if size > 0 else np.linalg.svd(other[None])[2][1]
    side = 1.0 if along >= 0 else -1.0
    return np.asarray(np.cos(angle) * side * other + np.sin(angle) * across)
