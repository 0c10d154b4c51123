"""Poses of all views at once, from boards, a turntable and pairs of views that close a loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.pinhole import inverse, rotation, skew
from fringeworks.types import FloatMap, Frozen, InputError
from fringeworks.views.poses import ViewPose, carried, twist
from fringeworks.views.registration import Registration

HUBER = 3.0
"""Residual, in standard deviations, from which on it counts less than its square: one wrong pair
then bends the loop but does not break it."""
FIXED = 1e-6
"""Standard deviation by which the first view is held where nothing ties the views to the part, rad
and mm: it only chooses the coordinates."""
MAX_UNKNOWN_MM = 1.0
"""Standard deviation of a view's place, mm at the middle of the part, from which on it has no
pose."""

SETTLED = 1e-5
"""Step of all poses, in their standard deviations, below which they have settled."""
SHARES = (1.0, 0.1, 0.01, 0.001, 0.0)
"""Weights that are tried for residuals beyond ``HUBER``, over Gauss–Newton's HUBER/|r|; the last is
Newton's method. Each of them lowers the loss most for some steps of loops with wrong pairs."""
MAX_STEPS = 500
"""Largest number of steps. Views that agree take about five, and loops with a pair that is wrong by
thousands of σ up to a hundred."""
SMALL_RAD = 1e-4
"""Half a rotation, rad, below which the derivative of its logarithm is that of none, to 1e-10."""


@dataclass(frozen=True, eq=False, repr=False)
class Closure(Frozen):
    """What is left when the pairs of views around a loop are put together: nothing, ideally."""

    rotation_deg: float
    """Angle of the remaining rotation, degrees."""
    translation_mm: float
    """Length of the remaining displacement at the middle of the part, mm."""
    rotation_sigma_deg: float
    """Standard deviation of that rotation as a vector, by the stated covariances, degrees."""
    translation_sigma_mm: float
    """Standard deviation of that displacement as a vector, mm."""
    sigmas: float
    """Root mean square of the remaining error over its covariance, per direction: about 1, and
    below 3 where the covariances are right."""
    directions: int
    """Directions that all pairs determine together, 0 … 6; only they are judged."""


def solve_poses(
    count: int,
    pairs: Mapping[tuple[int, int], Registration],
    known: Mapping[int, ViewPose],
    starts: Sequence[FloatMap],
    *,
    middle_mm: FloatMap | None = None,
) -> list[ViewPose]:
    """Find the poses that agree best with pairs of views and with poses that are known.

    Parameters
    ----------
    count : int
        Number of views.
    pairs : Registration by (target, source)
    known : ViewPose by view
        From boards or a turntable; where there are none, the first view's coordinates are the
        part's.
    starts : sequence of (4, 4) arrays
        T_part_camera of every view to start from.
    middle_mm : (3,) array, optional
        Middle of the part in its coordinates, at which displacements of views are judged; by
        default the origin.

    Returns
    -------
    list of ViewPose

    Raises
    ------
    InputError where a view is tied to no other one well enough.

    Notes
    -----
    Least squares over SE(3), with residuals log(T̂⁻¹ T) weighted by their covariances and a Huber
    loss, by Gauss–Newton (``_settled``). Covariances are propagated. Independent parts add up. The
    calibration's error may be the same in all known poses, so theirs counts twice: once as one
    error in camera coordinates, and once as independent ones. For pairs it counts once: an error of
    all pairs alike changes no shape (see ``closure``).
    """
    known = dict(known) or {
        0: ViewPose(np.asarray(starts[0]), FIXED**2 * np.eye(6), np.zeros((6, 6)))
    }
    terms = [
        _Term(None, i, p.T_part_camera, p.noise, p.common, np.eye(6)) for i, p in known.items()
    ]
    terms += [
        _Term(i, j, r.T_target_source, r.noise, r.common, r.determined)
        for (i, j), r in pairs.items()
    ]
    poses = list(_settled(_Stacked.of(terms), np.stack(starts[:count]).astype(np.float64)))
    middle = np.zeros(3) if middle_mm is None else np.asarray(middle_mm, np.float64)
    return _with_covariance(poses, terms, middle)


@dataclass(frozen=True)
class _Term:
    """One measured pose: of a view in the part (target None), or in another view."""

    target: int | None
    source: int
    T: FloatMap
    noise: FloatMap
    common: FloatMap
    determined: FloatMap

    @cached_property
    def root(self) -> FloatMap:
        """Takes ξ to residuals of variance 1 along the determined directions, (k, 6)."""
        return _whitener(self.noise + self.common, self.determined)

    @property
    def common_root(self) -> FloatMap:
        """Takes errors of variance 1 in the camera to the common part of a known pose, (6, 6)."""
        to_camera = _adjoint(inverse(self.T))
        scale = np.append(np.full(3, 100.0), np.ones(3))
        inside = scale[:, None] * (to_camera @ self.common @ to_camera.T) * scale
        values, vectors = np.linalg.eigh(0.5 * (inside + inside.T))
        root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
        return np.asarray(np.linalg.solve(to_camera, root / scale[:, None]))

    def derivative(self, poses: Sequence[FloatMap]) -> FloatMap:
        """By the errors ξ of all poses in the part's coordinates, (6, 6 n)."""
        D = np.zeros((6, 6 * len(poses)))
        if self.target is None:
            D[:, 6 * self.source : 6 * self.source + 6] = np.eye(6)
            return D
        A = _adjoint(inverse(poses[self.target]))
        D[:, 6 * self.source : 6 * self.source + 6] = A
        D[:, 6 * self.target : 6 * self.target + 6] = -A
        return D


@dataclass(frozen=True)
class _Stacked:
    """All m measured poses as arrays. The part counts as one more view, n, whose pose is known."""

    sources: NDArray[np.intp]
    targets: NDArray[np.intp]
    """−1 for the part."""
    backs: FloatMap
    """Inverse of the measured poses, (m, 4, 4)."""
    roots: FloatMap
    """(m, 6, 6); rows of 0 stand for directions that are not determined."""

    @classmethod
    def of(cls, terms: Sequence[_Term]) -> _Stacked:
        roots = np.zeros((len(terms), 6, 6))
        for root, term in zip(roots, terms, strict=True):
            root[: len(term.root)] = term.root
        return cls(
            np.array([term.source for term in terms]),
            np.array([-1 if term.target is None else term.target for term in terms]),
            np.linalg.inv(np.stack([term.T for term in terms])),
            roots,
        )

    def off(self, poses: FloatMap) -> tuple[FloatMap, FloatMap, FloatMap]:
        """The poses' deviations from the measured ones as residuals, (m, 6), and as transforms,
        (m, 4, 4); and the transforms from the part to the targets."""
        to_targets = np.linalg.inv(np.concatenate((poses, np.eye(4)[None])))[self.targets]
        off = to_targets @ poses[self.sources] @ self.backs
        turns = scipy.spatial.transform.Rotation.from_matrix(off[:, :3, :3]).as_rotvec()
        twists = np.concatenate((turns, off[:, :3, 3]), axis=1)
        return np.einsum("mij,mj->mi", self.roots, twists), off, to_targets

    def loss(self, poses: FloatMap) -> float:
        """Huber's loss of all residuals: their square up to ``HUBER``, linear beyond."""
        size = np.abs(self.off(poses)[0])
        return float(np.sum(np.where(size <= HUBER, size * size, HUBER * (2.0 * size - HUBER))))

    def steps(self, poses: FloatMap) -> tuple[FloatMap, float]:
        """Steps of all poses by the weights of ``SHARES``, (k, n, 6), rad and mm; and how much the
        first one lowers the loss where residuals are linear.

        Directions that nothing determines stay as they are.
        """
        n = len(poses)
        residual, off, to_targets = self.off(poses)
        by_source = self.roots @ _twist_derivative(off) @ _adjoint(to_targets)
        weight = HUBER / np.maximum(np.abs(residual), HUBER)
        shares = np.asarray(SHARES if (weight < 1.0).any() else SHARES[:1])[:, None, None]
        weights = np.where(weight < 1.0, shares * weight, 1.0)
        turned = by_source.swapaxes(1, 2)
        inside = (turned * weights[:, :, None, :]) @ by_source
        pull = np.einsum("mij,mj->mi", turned, weight * residual)
        # Sources and targets move a residual in opposite senses; the part does not move.
        moves = (np.eye(n + 1)[self.sources] - np.eye(n + 1)[self.targets])[:, :n]
        normals = np.einsum("mi,mj,smab->siajb", moves, moves, inside, optimize=True)
        pulls = -np.einsum("mi,ma->ia", moves, pull).ravel()
        scale = np.tile(np.append(np.full(3, 0.01), np.ones(3)), n)
        scaled = scale[:, None] * normals.reshape(-1, 6 * n, 6 * n) * scale
        found = [scale * np.linalg.lstsq(one, scale * pulls, rcond=None)[0] for one in scaled]
        return np.reshape(found, (-1, n, 6)), float(pulls @ found[0])


def _settled(terms: _Stacked, starts: FloatMap) -> FloatMap:
    """Poses (n, 4, 4) that minimise the Huber loss of the terms.

    Gauss–Newton with exact derivatives about the poses of each step. It weighs a residual r beyond
    ``HUBER`` by HUBER/|r|, which always descends, but slowly where pairs contradict each other.
    Newton's method weighs it by 0, its second derivative, which ends after a few steps as soon as
    it is known which residuals are beyond. Of these two and three between, the step counts that
    lowers the loss most.
    """
    poses, loss = starts, terms.loss(starts)
    for _ in range(MAX_STEPS):
        steps, gain = terms.steps(poses)
        while gain > SETTLED**2:
            moved = min((_moved(poses, step) for step in steps), key=terms.loss)
            less = terms.loss(moved)
            if less <= loss:
                break
            steps, gain = 0.5 * steps, 0.5 * gain
        if gain <= SETTLED**2:
            return poses
        poses, loss = moved, less
    raise InputError(
        f"views: expected poses that settle within {MAX_STEPS} steps; known poses and pairs of "
        "views contradict each other"
    )


def _moved(poses: FloatMap, steps: FloatMap) -> FloatMap:
    """Poses (n, 4, 4) turned and displaced by errors ξ (n, 6) of the part's coordinates."""
    by = np.tile(np.eye(4), (len(poses), 1, 1))
    by[:, :3, :3], by[:, :3, 3] = rotation(steps[:, :3]), steps[:, 3:]
    return np.asarray(by @ poses)


def _twist_derivative(T: FloatMap) -> FloatMap:
    """Derivatives of ``twist(from_twist(ξ) @ T)`` by ξ at 0 for transforms (m, 4, 4), (m, 6, 6).

    For the rotation it is the inverse of the left Jacobian of SO(3) (J. Solà and others, A micro
    Lie theory, arXiv 1812.01537, equation 146).
    """
    vector = scipy.spatial.transform.Rotation.from_matrix(T[:, :3, :3]).as_rotvec()
    cross = skew(vector)
    half = 0.5 * np.linalg.norm(vector, axis=1)
    # (1 − x cot x) / (2 x)² at half the angle x. Its series starts with 1/12 + x²/180.
    safe = np.maximum(half, SMALL_RAD)
    square = np.where(half > SMALL_RAD, (1.0 - safe / np.tan(safe)) / (4.0 * safe**2), 1.0 / 12.0)
    D = np.tile(np.eye(6), (len(T), 1, 1))
    D[:, :3, :3] += -0.5 * cross + square[:, None, None] * (cross @ cross)
    D[:, 3:, :3] = -skew(T[:, :3, 3])
    return D


def _adjoint(T: FloatMap) -> FloatMap:
    """Convert ξ to the coordinates that transforms (..., 4, 4) map to, (..., 6, 6)."""
    A = np.zeros((*T.shape[:-2], 6, 6))
    A[..., :3, :3] = A[..., 3:, 3:] = T[..., :3, :3]
    A[..., 3:, :3] = skew(T[..., :3, 3]) @ T[..., :3, :3]
    return A


def _whitener(covariance: FloatMap, determined: FloatMap) -> FloatMap:
    """Rows that take ξ to independent residuals of variance 1, (k, 6).

    A direction that is not determined may hold any error and must not leak into the others, so the
    rows are dual to the determined directions.
    """
    scale = np.append(np.full(3, 100.0), np.ones(3))
    basis = np.linalg.qr(scale[:, None] * determined)[0] if determined.shape[1] < 6 else np.eye(6)
    inside = basis.T @ (scale[:, None] * covariance * scale) @ basis
    values, vectors = np.linalg.eigh(0.5 * (inside + inside.T))
    values = np.maximum(values, 1e-12 * values.max())
    return np.asarray((vectors / np.sqrt(values)).T @ basis.T * scale)


def _with_covariance(
    poses: Sequence[FloatMap], terms: Sequence[_Term], middle: FloatMap
) -> list[ViewPose]:
    n = len(poses)
    rows = np.concatenate([term.root @ term.derivative(poses) for term in terms])
    # Unknowns: rotations in units of 0.01 rad, and displacements of the part's middle.
    scaled = np.diag(np.append(np.full(3, 0.01), np.ones(3)))
    from_middle = np.eye(4)
    from_middle[:3, 3] = middle
    scale = np.kron(np.eye(n), _adjoint(from_middle) @ scaled)
    normal = scale.T @ (rows.T @ rows) @ scale
    values = np.linalg.eigvalsh(normal)
    if values[0] < 1.0 / (n * MAX_UNKNOWN_MM**2):
        raise InputError(
            "views: expected views that are tied to each other by their shape, a board or a "
            "turntable, got at least one that can move against the others"
        )
    inverse_normal = scale @ np.linalg.inv(normal) @ scale.T
    noise, common = np.zeros((6 * n, 6 * n)), np.zeros((6 * n, 6 * n))
    same = np.zeros((6 * n, 6))
    for term in terms:
        gain = inverse_normal @ term.derivative(poses).T @ term.root.T @ term.root
        noise += gain @ term.noise @ gain.T
        common += gain @ term.common @ gain.T
        if term.target is None:
            same += gain @ term.common_root
    common += same @ same.T
    blocks = [slice(6 * k, 6 * k + 6) for k in range(n)]
    return [ViewPose(T, noise[b, b], common[b, b]) for T, b in zip(poses, blocks, strict=True)]


def closure(
    pairs: Mapping[tuple[int, int], Registration], count: int, middle_mm: FloatMap
) -> Closure | None:
    """Combine the pairs (0, 1), (1, 2) … (n − 1, 0), and judge how far they are from the identity.

    Parameters
    ----------
    pairs : Registration by (target, source)
    count : int
        Number of views n.
    middle_mm : (3,) array
        Middle of the part in the first view's coordinates, at which displacements are stated.

    Returns
    -------
    Closure; None where a pair is missing.

    Notes
    -----
    The pairs' noise adds up as independent. Errors of the calibration do not open the loop: they
    bend all views alike, so that a pair's pose T becomes D T D⁻¹ with the same D for all pairs, and
    the product around the loop stays the identity. On the virtual rig with five calibrations the
    closure error is that of an exact one.
    """
    steps = [(k, (k + 1) % count) for k in range(count)]
    if count < 3 or any(step not in pairs for step in steps):
        return None
    T: FloatMap = np.eye(4)
    covariance: FloatMap = np.zeros((6, 6))
    free: FloatMap = np.zeros((6, 6))
    for step in steps:
        pair = pairs[step]
        covariance += carried(T, pair.noise)
        free += carried(T, _free(pair.determined))
        T = T @ pair.T_target_source
    to_middle = np.eye(4)
    to_middle[:3, 3] = -np.asarray(middle_mm)
    left = twist(to_middle @ T @ inverse(to_middle))
    covariance, free = carried(to_middle, covariance), carried(to_middle, free)
    scale = np.append(np.full(3, 100.0), np.ones(3))
    values, vectors = np.linalg.eigh(scale[:, None] * free * scale)
    known = vectors[:, values < 1e-6 * max(float(values.max()), 1.0)]
    inside = known.T @ (scale[:, None] * covariance * scale) @ known
    parts = known.T @ (scale * left)
    judged = float(np.sqrt(parts @ np.linalg.solve(inside, parts) / max(len(parts), 1)))
    return Closure(
        rotation_deg=float(np.degrees(np.linalg.norm(left[:3]))),
        translation_mm=float(np.linalg.norm(left[3:])),
        rotation_sigma_deg=float(np.degrees(np.sqrt(np.trace(covariance[:3, :3])))),
        translation_sigma_mm=float(np.sqrt(np.trace(covariance[3:, 3:]))),
        sigmas=judged,
        directions=known.shape[1],
    )


def _free(determined: FloatMap) -> FloatMap:
    """Projector on the directions that a pair does not determine, (6, 6)."""
    if determined.shape[1] == 6:
        return np.zeros((6, 6))
    scale = np.append(np.full(3, 100.0), np.ones(3))
    basis = np.linalg.qr(scale[:, None] * determined)[0]
    free = np.eye(6) - basis @ basis.T
    return np.asarray(free / scale[:, None] / scale)
