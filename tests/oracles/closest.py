"""The nearest point of a triangle mesh, by a search through all triangles."""

from __future__ import annotations

import numpy as np


def nearest(points, corners):
    """Distance from the nearest of the triangles (m, 3, 3), for each point, (n,)."""
    best = np.full(len(points), np.inf)
    for a, b, c in corners:
        best = np.minimum(best, _inside(points, a, b, c))
        for p, q in ((a, b), (b, c), (c, a)):
            t = np.clip((points - p) @ (q - p) / ((q - p) @ (q - p)), 0.0, 1.0)
            best = np.minimum(best, np.linalg.norm(points - p - t[:, None] * (q - p), axis=1))
    return best


def _inside(points, a, b, c):
    """Distance from the plane of a triangle where its foot lies inside; ∞ elsewhere."""
    n = np.cross(b - a, c - a)
    n = n / np.linalg.norm(n)
    height = (points - a) @ n
    foot = points - height[:, None] * n
    sides = [np.cross(q - p, foot - p) @ n >= 0 for p, q in ((a, b), (b, c), (c, a))]
    return np.where(np.all(sides, axis=0), np.abs(height), np.inf)
