"""Poses of views by SciPy's least squares, with differences as derivatives: the correct twin."""

from __future__ import annotations

import numpy as np
import scipy

from fringeworks.rig.pinhole import inverse
from fringeworks.types import FloatMap
from fringeworks.views.pose_graph import HUBER, _Term
from fringeworks.views.poses import from_twist, twist


def residuals(terms: list[_Term], poses: list[FloatMap]) -> FloatMap:
    """What remains of every measured pose, in its standard deviations."""
    found: list[FloatMap] = []
    for term in terms:
        here = poses[term.source]
        if term.target is not None:
            here = inverse(poses[term.target]) @ here
        found.append(term.root @ twist(here @ inverse(term.T)))
    return np.concatenate(found)


def loss(terms: list[_Term], poses: list[FloatMap]) -> float:
    """Huber's loss: squares up to the limit, and their tangent beyond."""
    size = np.abs(residuals(terms, poses))
    return float(np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2).sum())


def settled_poses(terms: list[_Term], starts: list[FloatMap]) -> list[FloatMap]:
    """Poses that minimise the Huber loss of the terms."""

    def poses(x: FloatMap) -> list[FloatMap]:
        return [from_twist(xi) @ T for xi, T in zip(x.reshape(-1, 6), starts, strict=True)]

    found = scipy.optimize.least_squares(
        lambda x: residuals(terms, poses(x)),
        np.zeros(6 * len(starts)),
        x_scale=np.tile(np.append(np.full(3, 1e-2), np.ones(3)), len(starts)),
        loss="huber",
        f_scale=HUBER,
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    return poses(found.x)
