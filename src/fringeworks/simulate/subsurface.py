"""Light that enters a material, spreads in it and leaves beside the place where it entered."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.simulate.exposure import Transport
from fringeworks.simulate.virtual_rig import View
from fringeworks.types import FloatMap, InputError

STEP_SHARE = 0.9
"""Length of a time step over the longest that is stable."""
LEAST_FACING = 0.3
"""Smallest cosine between a triangle of neighbouring points and the surface at its corners: at a
depth step, triangles span the gap, and light does not cross them."""


def subsurface(view: View, *, spread_mm: float, share: float = 1.0) -> Transport:
    """Let light spread within the material of the surfaces in view.

    Parameters
    ----------
    view : View
    spread_mm : float ≥ 0
        Standard deviation along one axis by which light moves on the surface, mm. Usual values are
        0.1 mm for paper, 0.5 mm for plastics, 1 mm and more for skin and wax.
    share : float, 0…1
        Share of the reflected light that entered the material; the rest leaves where it arrived.

    Returns
    -------
    Transport: (1 − share) E + share · G E for the irradiance E and a blur G in the object's plane.

    Raises
    ------
    InputError for values out of their range.

    Notes
    -----
    G solves the equation of diffusion ∂E/∂t = ΔE up to t = σ²/2 on the surface, which on a plane is
    a Gaussian blur of standard deviation σ. Fringes of the period p, measured on the surface, keep
    1 − share + share · exp(−2 π² σ² / p²) of their modulation. Light is conserved, and does not
    cross from one body to another or over a depth step. The Laplacian on the points that the
    pixels see is that of Pinkall and Polthier (1993, doi:10.1080/10586458.1993.10504266). The
    albedo counts once, where light leaves.
    """
    if not spread_mm >= 0:
        raise InputError(f"spread_mm: expected >= 0 mm, got {spread_mm}")
    if not 0 <= share <= 1:
        raise InputError(f"share: expected 0 to 1, got {share}")
    seen = view.body >= 0
    change = _diffusion(view)
    # By Gershgorin's circles, no eigenvalue is beyond twice the largest diagonal.
    fastest = 2.0 * float(np.abs(change.diagonal()).max(initial=0.0))
    duration = 0.5 * spread_mm**2
    count = int(np.ceil(duration * fastest / (2.0 * STEP_SHARE)))
    step = change * (duration / max(count, 1))

    def spread(direct: FloatMap) -> FloatMap:
        light = direct[seen]
        for _ in range(count):
            light = light + step @ light
        result = direct.copy()
        result[seen] = (1.0 - share) * direct[seen] + share * light
        return result

    return spread


def _diffusion(view: View) -> scipy.sparse.csr_array:
    """Laplacian of the surface at the pixels that see a body, 1/mm²."""
    seen = view.body >= 0
    n = int(seen.sum())
    points = view.points_mm[seen]
    faces = _triangles(view)
    weights = scipy.sparse.csr_array((n, n))
    for k in range(3):
        at, one, other = faces[:, k], faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        a, b = points[one] - points[at], points[other] - points[at]
        cotangent = np.sum(a * b, axis=1) / np.linalg.norm(np.cross(a, b), axis=1)
        weights += scipy.sparse.csr_array((0.5 * cotangent, (one, other)), shape=(n, n))
    weights = weights + weights.T
    balance = scipy.sparse.diags_array(np.asarray(weights.sum(axis=1)).ravel())
    # What leaves a pixel arrives at its neighbours: flux is light times area.
    area = view.area_mm2[seen]
    return scipy.sparse.csr_array(scipy.sparse.diags_array(1.0 / area) @ (weights - balance))


def _triangles(view: View) -> NDArray[np.intp]:
    """Triangles of neighbouring pixels on one smooth surface, (m, 3), as numbers of seen pixels."""
    seen = view.body >= 0
    index = np.full(seen.shape, -1)
    index[seen] = np.arange(int(seen.sum()))
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (b, d, c))])
    faces = faces[(faces >= 0).all(axis=1)]
    body = view.body[seen][faces]
    faces = faces[(body == body[:, :1]).all(axis=1)]
    corners = view.points_mm[seen][faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    facing = np.abs(np.einsum("mk,mjk->mj", across, view.normals[seen][faces]))
    return np.asarray(faces[(facing > LEAST_FACING).all(axis=1)])
