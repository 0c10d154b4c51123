"""Nominal bodies of features: distances of points, and the motions that do not change them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fringeworks.rig.pinhole import rotation, skew
from fringeworks.types import FloatMap

Kind = Literal["plane", "cylinder", "sphere", "axis"]
SAME = 1e-6
"""Size of what two spaces of motions do not share, relative to 1, below which they share it."""
SIDES = 64
"""Directions across an axis in which the places of centres count: a circle's zone is then too
small by 0.12 % at most."""


@dataclass(frozen=True)
class Body:
    """A plane, cylinder or sphere in space, or the axis of a cylindrical zone."""

    kind: Kind
    point: FloatMap
    """Of the plane or axis, or the centre of the sphere, (3,), mm."""
    direction: FloatMap
    """Normal of the plane or direction of the axis, of length 1, (3,)."""
    radius: float = 0.0
    """mm; 0 for planes and axes."""
    hollow: bool = False
    """Whether the material lies outside of it, as around a hole."""

    def distances(self, points: FloatMap) -> FloatMap:
        """Return signed distances of points, along the normal or outwards, (n,), mm."""
        away = points - self.point
        if self.kind == "plane":
            return np.asarray(away @ self.direction)
        return np.asarray(np.linalg.norm(self._across(away), axis=1) - self.radius)

    def normals(self, points: FloatMap) -> FloatMap:
        """Return the directions in which these distances grow, (n, 3)."""
        if self.kind == "plane":
            return np.broadcast_to(self.direction, points.shape)
        out = self._across(points - self.point)
        return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))

    def _across(self, away: FloatMap) -> FloatMap:
        if self.kind == "sphere":
            return away
        return np.asarray(away - np.outer(away @ self.direction, self.direction))

    def along(self, points: FloatMap) -> FloatMap:
        """Return the places of points along the direction, (n,), mm."""
        return np.asarray((points - self.point) @ self.direction)

    def offsets(self, points: FloatMap) -> tuple[FloatMap, FloatMap, FloatMap]:
        """Return values whose largest is that of the zone, the normals and the points they are of.

        The distance from an axis has no derivative at the axis. It is the largest of the offsets
        in many directions across it, which all have one.
        """
        if self.kind != "axis":
            return self.distances(points), self.normals(points), points
        u, v = np.linalg.svd(self.direction[None, :])[2][1:]
        turn = 2.0 * np.pi * np.arange(SIDES) / SIDES
        n = np.tile(np.outer(np.cos(turn), u) + np.outer(np.sin(turn), v), (len(points), 1))
        every = np.repeat(points, SIDES, axis=0)
        return np.asarray(np.einsum("nc,nc->n", every - self.point, n)), n, every

    def moved(self, twist: FloatMap, pivot: FloatMap, scale: float) -> Body:
        """Return the body after a motion: a rotation of twist[:3] / scale rad about the pivot, then
        a translation of twist[3:], mm."""
        R = rotation(twist[:3] / scale)
        direction = R @ self.direction
        point = pivot + R @ (self.point - pivot) + twist[3:]
        return replace(self, point=point, direction=direction / np.linalg.norm(direction))

    def larger(self, size: float) -> Body:
        """Return the body of a radius that is larger by so much, or the plane moved by it, mm."""
        if self.kind == "plane":
            return replace(self, point=self.point + size * self.direction)
        return replace(self, radius=self.radius + size)


def twists(points: FloatMap, normals: FloatMap, pivot: FloatMap, scale: float) -> FloatMap:
    """Return the derivative of distances by a motion of the points, (n, 6), mm per mm.

    A motion is a rotation about the pivot, in rad times the scale, and a translation in mm.
    """
    return np.column_stack((np.cross(points - pivot, normals) / scale, normals))


def everything() -> FloatMap:
    """Return all six motions, (6, 6): what a tolerance without datums leaves free."""
    return np.eye(6)


def translations() -> FloatMap:
    """Return the three translations, (6, 3)."""
    return np.eye(6)[:, 3:]


def invariant(body: Body, pivot: FloatMap, scale: float) -> FloatMap:
    """Return the motions that leave a body where it is, as independent columns, (6, j).

    Notes
    -----
    The invariance classes of ISO 17450-1: planar, cylindrical and spherical. A rotation ω about a
    point p moves the pivot c by ω × (c − p).
    """
    turned = np.vstack((np.eye(3), skew(body.point - pivot) / scale))
    if body.kind == "sphere":
        return turned
    about = turned @ body.direction
    if body.kind == "plane":
        across = np.linalg.svd(body.direction[None, :])[2][1:].T
        return np.column_stack((about, translations() @ across))
    return np.column_stack((about, translations() @ body.direction))


def shared(one: FloatMap, other: FloatMap) -> FloatMap:
    """Return the space that the columns of two matrices share, (6, j)."""
    if not one.shape[1] or not other.shape[1]:
        return np.zeros((6, 0))
    bases = [np.linalg.svd(m, full_matrices=False) for m in (one, other)]
    p, q = (u[:, s > SAME * s[0]] for u, s, _ in bases)
    u, size, _ = np.linalg.svd(p.T @ q)
    return np.asarray(p @ u[:, : len(size)][:, size > 1.0 - SAME])
