"""Poses of all views at once, from boards, a turntable and pairs of views that close a loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from fringeworks.rig.pinhole import inverse
from fringeworks.types import FloatMap, Frozen, InputError
from fringeworks.views.poses import ViewPose, carried, from_twist, twist
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
    loss. Covariances are propagated. Independent parts add up. The calibration's error may be the
    same in all known poses, so theirs counts twice: once as one error in camera coordinates, and
    once as independent ones. For pairs it counts once: an error of all pairs alike changes no
    shape (see ``closure``).
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
    starts = [np.asarray(T, np.float64) for T in starts]

    def poses(x: FloatMap) -> list[FloatMap]:
        return [from_twist(xi) @ T for xi, T in zip(x.reshape(-1, 6), starts, strict=True)]

    def residuals(x: FloatMap) -> FloatMap:
        here = poses(x)
        return np.concatenate([term.residual(here) for term in terms])

    scale = np.tile(np.append(np.full(3, 1e-2), np.ones(3)), count)
    found = scipy.optimize.least_squares(
        residuals, np.zeros(6 * count), x_scale=scale, loss="huber", f_scale=HUBER
    )
    middle = np.zeros(3) if middle_mm is None else np.asarray(middle_mm, np.float64)
    return _with_covariance(poses(found.x), terms, middle)


@dataclass(frozen=True)
class _Term:
    """One measured pose: of a view in the part (target None), or in another view."""

    target: int | None
    source: int
    T: FloatMap
    noise: FloatMap
    common: FloatMap
    determined: FloatMap

    @property
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

    def residual(self, poses: Sequence[FloatMap]) -> FloatMap:
        here = poses[self.source]
        if self.target is not None:
            here = inverse(poses[self.target]) @ here
        return np.asarray(self.root @ twist(here @ inverse(self.T)))

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


def _adjoint(T: FloatMap) -> FloatMap:
    """Converts ξ to the coordinates that ``T`` maps to, (6, 6)."""
    A = np.zeros((6, 6))
    x, y, z = T[:3, 3]
    A[:3, :3] = A[3:, 3:] = T[:3, :3]
    A[3:, :3] = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ T[:3, :3]
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
