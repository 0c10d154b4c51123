"""Hand–eye start in closed form, from small sets of poses: outlying poses do no harm."""

from __future__ import annotations

from itertools import combinations, islice
from math import comb

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.robot.readings import inverses
from fringeworks.types import FloatMap

SET_SIZE = 4
"""Poses of a set. Three determine the transform; a fourth averages noise, and with four of ten
poses wrong, one set in thirty is still free of them."""
MOST_SETS = 240
"""Largest number of sets that are tried. With 30 % of wrong poses a quarter of all sets is free of
them, with 45 % one in eleven."""
SEED = 47
"""Seed of the choice of sets where there are more: the same poses give the same result."""
NEAR_STRAIGHT = 1e-12
"""Lower bound of an angle, rad, and of a weight, so that nothing is divided by 0."""


def closed_form(A: FloatMap, B: FloatMap) -> FloatMap:
    """Solve A X = X B for the transforms X of many sets of motions.

    Parameters
    ----------
    A, B : (s, m, 4, 4) arrays
        m motions of s sets, as the two sides of X see them, mm.

    Returns
    -------
    (s, 4, 4) array

    Notes
    -----
    Rotation: X turns the rotation vectors of B into those of A; the rotation with the least squares
    is that of the singular values of Σ α βᵀ. Translation: (R_A − 1) t_X = R_X t_B − t_A, by least
    squares (Park and Martin, IEEE Transactions on Robotics and Automation 10, 1994,
    doi:10.1109/70.326576).
    """
    alpha, beta = rotation_vectors(A[..., :3, :3]), rotation_vectors(B[..., :3, :3])
    u, _, vt = np.linalg.svd(np.swapaxes(alpha, -1, -2) @ beta)
    u = u.copy()
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    R = u @ vt
    left = A[..., :3, :3] - np.eye(3)
    right = np.einsum("sij,smj->smi", R, B[..., :3, 3]) - A[..., :3, 3]
    normal = np.einsum("smki,smkj->sij", left, left)
    moment = np.einsum("smki,smk->si", left, right)
    found = np.tile(np.eye(4), (len(A), 1, 1))
    found[:, :3, :3] = R
    found[:, :3, 3] = np.einsum("sij,sj->si", np.linalg.pinv(normal, hermitian=True), moment)
    return found


def rotation_vectors(R: FloatMap) -> FloatMap:
    """Rotation vectors of rotations (…, 3, 3), of up to half a turn, rad."""
    twice = np.stack(
        (
            R[..., 2, 1] - R[..., 1, 2],
            R[..., 0, 2] - R[..., 2, 0],
            R[..., 1, 0] - R[..., 0, 1],
        ),
        axis=-1,
    )
    sine = 0.5 * np.linalg.norm(twice, axis=-1)
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    # Near half a turn the axis is the column of R + 1 with the largest diagonal.
    column = np.argmax(np.diagonal(R, axis1=-2, axis2=-1), axis=-1)
    about = np.take_along_axis(R + np.eye(3), column[..., None, None], axis=-1)[..., 0]
    about = about / np.maximum(np.linalg.norm(about, axis=-1, keepdims=True), NEAR_STRAIGHT)
    about = about * np.where(np.sum(about * twice, axis=-1, keepdims=True) < 0, -1.0, 1.0)
    plain = 0.5 * twice / np.maximum(sine, NEAR_STRAIGHT)[..., None]
    axis = np.where((cosine < -0.9)[..., None], about, plain)
    return np.asarray(axis * angle[..., None])


def start_transforms(G: FloatMap, M: FloatMap, sets: NDArray[np.intp]) -> tuple[FloatMap, FloatMap]:
    """Solve M = X⁻¹ G Y for many sets of poses.

    Parameters
    ----------
    G : (n, 4, 4) array
        Robot poses, from the far side to the camera's side, mm.
    M : (n, 4, 4) array
        T_camera_board, mm.
    sets : (s, k) array of int
        Numbers of the poses of each set.

    Returns
    -------
    X, Y : (s, 4, 4) arrays
    """
    one, two = (list(part) for part in zip(*combinations(range(sets.shape[1]), 2), strict=True))
    first, second = sets[:, one], sets[:, two]
    # M_j M_i⁻¹ = X⁻¹ (G_j G_i⁻¹) X
    A = G[second] @ _inverse(G[first])
    B = M[second] @ _inverse(M[first])
    X = closed_form(A, B)
    every = _inverse(G[sets]) @ X[:, None] @ M[sets]
    u, _, vt = np.linalg.svd(every[..., :3, :3].mean(axis=1))
    u = u.copy()
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    Y = np.tile(np.eye(4), (len(sets), 1, 1))
    Y[:, :3, :3], Y[:, :3, 3] = u @ vt, every[..., :3, 3].mean(axis=1)
    return X, Y


def _inverse(T: FloatMap) -> FloatMap:
    return inverses(T.reshape(-1, 4, 4)).reshape(T.shape)


def sets_of(n: int) -> NDArray[np.intp]:
    """Sets of poses to start from, (s, k): all of them, or a choice."""
    size = min(SET_SIZE, n)
    if comb(n, size) <= MOST_SETS:
        return np.array(list(islice(combinations(range(n), size), MOST_SETS)))
    rng = np.random.default_rng(SEED)
    return np.array([rng.choice(n, size, replace=False) for _ in range(MOST_SETS)])


def distances_mm(
    X: FloatMap, Y: FloatMap, G: FloatMap, M: FloatMap, middle: FloatMap, radius: float
) -> FloatMap:
    """How far the board lies from where the robot puts it, for s solutions and n poses, (s, n), mm.

    Root mean square over points on a sphere around the board's middle.
    """
    seen = X[:, None] @ M[None]
    held = G[None] @ Y[:, None]
    turn = seen[..., :3, :3] - held[..., :3, :3]
    shift = turn @ middle + seen[..., :3, 3] - held[..., :3, 3]
    squares = np.sum(shift**2, axis=-1) + radius**2 / 3.0 * np.sum(turn**2, axis=(-1, -2))
    return np.asarray(np.sqrt(squares))


def robust_start(
    G: FloatMap, M: FloatMap, middle: FloatMap, radius: float
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """The solution of all sets with the smallest median distance.

    Returns
    -------
    X, Y : (4, 4) arrays
    distance : (n,) array, mm
        Of every pose.

    Notes
    -----
    Least median of squares (Rousseeuw, Journal of the American Statistical Association 79, 1984,
    doi:10.1080/01621459.1984.10477105). The set is then widened twice to all poses within the
    median distance, whose noise averages out.
    """
    X, Y = start_transforms(G, M, sets_of(len(G)))
    distance = distances_mm(X, Y, G, M, middle, radius)
    best = int(np.argmin(np.median(distance, axis=1)))
    found = (X[best], Y[best], distance[best])
    for _ in range(2):
        near = np.argsort(found[2])[: max(SET_SIZE, (len(G) + 1) // 2 + 1)]
        X, Y = start_transforms(G, M, np.sort(near)[None])
        distance = distances_mm(X, Y, G, M, middle, radius)
        if np.median(distance[0]) > np.median(found[2]):
            break
        found = (X[0], Y[0], distance[0])
    return found
