"""Exact distances from the nominal forms of a drawing's faces."""

from __future__ import annotations

import math

import numpy as np

from fringeworks.types import FloatMap, NominalFace

ROUND = ("cylinder", "cone", "sphere", "torus")
"""Kinds of faces whose triangles only approximate them."""


def nominal_distance(face: NominalFace, points_mm: FloatMap) -> tuple[FloatMap, FloatMap] | None:
    """Return the distances of points from the unlimited nominal form of a face.

    Parameters
    ----------
    face : NominalFace
    points_mm : (n, 3) array
        mm.

    Returns
    -------
    Distances (n,), positive outside of the round body, mm, and their gradients (n, 3); None for a
    free form.
    """
    axis = np.asarray(face.axis)
    way = points_mm - np.asarray(face.origin_mm)
    height = way @ axis
    if face.kind == "plane":
        return height, np.broadcast_to(axis, way.shape)
    if face.kind == "sphere":
        size, outwards = _sized(way)
        return size - _known(face.radius_mm), outwards
    size, outwards = _sized(way - height[:, None] * axis)
    if face.kind == "cylinder":
        return size - _known(face.radius_mm), outwards
    if face.kind == "cone":
        angle = math.radians(_known(face.half_angle_deg))
        side = np.where(height < 0, -1.0, 1.0)
        distance = size * math.cos(angle) - np.abs(height) * math.sin(angle)
        return distance, math.cos(angle) * outwards - math.sin(angle) * side[:, None] * axis
    if face.kind == "torus":
        across = size - _known(face.radius_mm)
        from_tube, turned = _sized(across[:, None] * outwards + height[:, None] * axis)
        return from_tube - _known(face.tube_mm), turned
    return None


def _sized(vectors: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Lengths of vectors (n, 3), and their directions."""
    size = np.sqrt(np.einsum("nc,nc->n", vectors, vectors))
    return size, vectors / np.maximum(size, np.finfo(np.float64).tiny)[:, None]


def _known(value: float | None) -> float:
    return math.nan if value is None else value
