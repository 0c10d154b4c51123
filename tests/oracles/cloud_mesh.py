"""Triangles between neighbouring points, by the corners of every one of them."""

from __future__ import annotations

import numpy as np

from fringeworks.surface.cloud import GRAZING_COSINE, LONG_SIDE


def triangles(cloud):
    """Flat pixel indices of the triangles, (m, 3)."""
    h, w = cloud.shape
    index = np.arange(h * w, dtype=np.int64).reshape(h, w)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, c, b), (b, c, d))])
    points = cloud.xyz_mm.reshape(-1, 3).astype(np.float64)
    ok = (cloud.reason == 0).reshape(-1) & np.isfinite(points).all(axis=1)
    faces = faces[ok[faces].all(axis=1)]
    p, q, r = (points[faces[:, k]] for k in range(3))
    normal = np.cross(q - p, r - p)
    sine = np.abs(np.sum(normal * p, axis=1))
    grazing = sine < GRAZING_COSINE * np.linalg.norm(normal, axis=1) * np.linalg.norm(p, axis=1)
    sides = [np.linalg.norm(s - t, axis=1) for s, t in ((p, q), (q, r), (r, p))]
    per_depth = np.max(sides, axis=0) / p[:, 2]
    return faces[~grazing & (per_depth < LONG_SIDE * np.median(per_depth))]
