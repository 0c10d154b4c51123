"""Datum systems of ISO 5459: frames from up to three features, and the motions they leave free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fringeworks.evaluate.tolerances.association import associate
from fringeworks.evaluate.tolerances.bodies import (
    SAME,
    Body,
    everything,
    invariant,
    shared,
    translations,
)
from fringeworks.types import FloatMap, InputError
from fringeworks.types.numbers import number
from fringeworks.types.recipe import Association

NEAR_DEG = 10.0
"""Angle between the directions of datums and a multiple of 90° up to which that is their nominal
angle, degrees."""


@dataclass(frozen=True)
class DatumFeature:
    """A feature that a datum is associated with."""

    body: Body
    """Body of least squares, near it."""
    by: Association
    weights: FloatMap
    """Of its points in least squares, (n,)."""


@dataclass(frozen=True)
class System:
    """Bodies of the datums in their order, at their nominal angles."""

    bodies: tuple[Body, ...]

    def free(self, pivot: FloatMap, scale: float) -> FloatMap:
        """Return the motions that leave all datums where they are, (6, f)."""
        found = everything()
        for body in self.bodies:
            found = shared(found, invariant(body, pivot, scale))
        return found

    def free_turns(self, pivot: FloatMap, scale: float) -> FloatMap:
        """Return the motions that keep all datums parallel to where they are, (6, f): what a
        tolerance of orientation leaves free. The columns need not be independent.

        Two parallel axes lock the turn about them: so do a plane and two holes across it.
        """
        return np.column_stack((translations(), self.free(pivot, scale)))

    @property
    def locked(self) -> bool:
        """Whether the datums leave no turn free."""
        turns = self.free(self.bodies[0].point, 1.0)[:3]
        return not turns.size or bool(np.linalg.norm(turns, 2) < SAME)

    @property
    def directed(self) -> bool:
        """Whether any datum has a direction."""
        return any(body.kind != "sphere" for body in self.bodies)

    def axes(self) -> FloatMap:
        """Return the axes of the frame as columns, (3, 3), in the coordinates of the points.

        z is the direction of the first datum that has one. x is the next direction across it, or
        leads from the first axis or centre to the next one.
        """
        directions = [b.direction for b in self.bodies if b.kind != "sphere"]
        places = [b.point for b in self.bodies if b.kind != "plane"]
        ways = [b - a for a, b in pairwise(places)]
        z = (directions or ways or [np.array([0.0, 0.0, 1.0])])[0]
        z = z / np.linalg.norm(z)
        for one in [*directions[1:], *ways, *np.eye(3)[np.argsort(np.abs(z))]]:
            x = one - (one @ z) * z
            if np.linalg.norm(x) > np.sin(np.radians(NEAR_DEG)) * np.linalg.norm(one):
                break
        x = x / np.linalg.norm(x)
        return np.column_stack((x, np.cross(z, x), z))

    def origin(self) -> FloatMap:
        """Return the origin of the frame, (3,), mm: on the first datum, then on the next ones as
        far as those before leave it free; of an axis or plane, the point next to its own."""
        at = self.bodies[0].point
        free: FloatMap = np.eye(3)
        for body in self.bodies:
            across: FloatMap = np.eye(3)
            if body.kind == "plane":
                across = body.direction[None]
            elif body.kind == "cylinder":
                across = np.linalg.svd(body.direction[None])[2][1:]
            rows = across @ free
            at = at + free @ (np.linalg.pinv(rows, rcond=SAME) @ (across @ (body.point - at)))
            _, size, turn = np.linalg.svd(rows)
            free = free @ turn[int(np.sum(size > SAME)) :].T
            if not free.shape[1]:
                break
        return np.asarray(at)

    def placed(self, at_mm: FloatMap, direction: FloatMap, body: Body) -> Body:
        """Return a body at its theoretically exact place in the frame."""
        axes = self.axes()
        way = axes @ (direction / np.linalg.norm(direction))
        return replace(body, point=self.origin() + axes @ at_mm, direction=way)


def system(features: Sequence[DatumFeature], points: Sequence[FloatMap]) -> System:
    """Associate the datums with the points of their features, in their order.

    Notes
    -----
    Each datum keeps its nominal angle to those before it and is free to move (ISO 5459:2011, 6.3).
    The nominal angle is 0° or 90°, whichever is near.
    """
    found = System(())
    for feature, xyz in zip(features, points, strict=True):
        body, pivot = feature.body, xyz.mean(axis=0)
        scale = float(np.sqrt(np.mean(np.sum((xyz - pivot) ** 2, axis=1))))
        free = everything()
        if found.bodies and found.directed and body.kind != "sphere":
            body = replace(body, direction=_nominal(body.direction, found))
            free = found.free_turns(pivot, scale)
        body = associate(
            body, xyz, free, feature.by, weights=feature.weights, pivot=pivot, scale=scale
        )
        found = System((*found.bodies, body))
    return found


def _nominal(direction: FloatMap, before: System) -> FloatMap:
    """The direction at its nominal angle to those of the datums before."""
    known = [body.direction for body in before.bodies if body.kind != "sphere"]
    fixed = any(abs(one @ known[0]) < np.cos(np.radians(NEAR_DEG)) for one in known)
    axes = before.axes() if fixed else known[0][:, None]
    share = axes.T @ direction
    along = int(np.argmax(np.abs(share)))
    if abs(share[along]) > np.cos(np.radians(NEAR_DEG)):
        return np.asarray(np.sign(share[along]) * axes[:, along])
    if not fixed and abs(share[0]) < np.sin(np.radians(NEAR_DEG)):
        across = direction - share[0] * axes[:, 0]
        return np.asarray(across / np.linalg.norm(across))
    off = np.degrees(np.arccos(min(abs(share[along]), 1.0)))
    raise InputError(
        f"datums: expected directions within {number(NEAR_DEG)}° of 0° or 90° to each other, got "
        f"{number(float(off))}°"
    )
