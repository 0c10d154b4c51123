"""Bundle adjustment of a camera, a projector, their pose, and a board in several poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.pinhole import (
    inverse,
    pose,
    project_with_derivatives,
    rotation,
    skew,
    transform,
)
from fringeworks.types import BoolMap, FloatMap, InputError, Pinhole, Rig

DEVICE = 9
RIG = 24
POSE = 6
ROUNDS = 8
"""Estimates of the scatter, each with weights from the one before."""
STEPS = 40
HUBER = 2.5
"""Residuals beyond this many standard deviations are held back."""
OUTLIER = 6.0
"""Residuals beyond this many are left out at the end."""
USUAL = 20
"""Corners that the usual scatter counts for beside a pose's own."""
FLOOR = (1e-4, 1e-4)
"""Least scatter, px: without noise there would be none to divide by."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """A board as camera and projector see it in one pose."""

    points_mm: FloatMap
    """Corners on the board, (m, 3), mm."""
    camera_px: FloatMap
    """(m, 2)"""
    projector_px: FloatMap
    """(m, 2), read at those pixels."""
    by_pixel: FloatMap
    """Derivative of what is read by the pixel, (m, 2, 2)."""


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A bundle adjustment's result."""

    rig: Rig
    poses: tuple[FloatMap, ...]
    """T_camera_board of every sighting, (4, 4)."""
    covariance: FloatMap
    """Of the rig's 24 and then of every pose's 6 parameters."""
    camera_residual_px: tuple[FloatMap, ...]
    """Seen minus predicted, (m, 2) per sighting."""
    projector_residual_px: tuple[FloatMap, ...]
    used: tuple[BoolMap, ...]
    """Corners that were not left out as outliers, (m,) per sighting."""
    scatter_px: tuple[tuple[float, float], ...]
    """Per sighting: standard deviations of a corner in the camera, and of what is read at the
    predicted pixel."""


def adjust(
    sightings: Sequence[Sighting],
    rig: Rig,
    poses: Sequence[FloatMap],
    *,
    free: BoolMap | None = None,
) -> Adjusted:
    """Least squares over all corners with a robust loss.

    Parameters
    ----------
    sightings : sequence of Sighting
    rig, poses : start
    free : (24,) bool array, optional
        Which of the rig's parameters are estimated; all by default.

    Raises
    ------
    InputError where the sightings do not determine the parameters.

    Notes
    -----
    Residuals are the camera's, c − π_c(X), and the projector's *at the predicted pixel*,
    q + Q (π_c(X) − c) − π_p(X), with Q the derivative of what is read: reading at a corner that is
    off by δ is off by Q δ, and only so are the two independent. The second is far the smaller, for
    phase is averaged over a window while a corner is a point.
    """
    problem = _Problem(sightings, np.ones(RIG, bool) if free is None else free)
    state = _State(rig, tuple(poses))
    scatter = problem.scatter(state, None)
    weights: FloatMap | None = None
    for _ in range(ROUNDS):
        state = problem.minimise(state, scatter, weights)
        new = problem.scatter(state, weights)
        weights = problem.weights(state, new)
        settled = np.allclose(new, scatter, rtol=1e-3)
        scatter = new
        if settled:
            break
    state = problem.minimise(state, scatter, weights)
    return problem.result(state, scatter, weights)


@dataclass(frozen=True)
class _State:
    rig: Rig
    poses: tuple[FloatMap, ...]


class _Problem:
    def __init__(self, sightings: Sequence[Sighting], free: BoolMap) -> None:
        self.sightings = sightings
        self.free = np.concatenate((free, np.ones(POSE * len(sightings), bool)))
        self.corners = sum(len(s.points_mm) for s in sightings)
        ends = np.cumsum([len(s.points_mm) for s in sightings])
        self.rows = [
            slice(int(end) - len(s.points_mm), int(end))
            for end, s in zip(ends, sightings, strict=True)
        ]
        if 4 * self.corners <= self.free.sum():
            raise InputError(
                f"calibration: expected more than {int(self.free.sum()) // 4} corners, "
                f"got {self.corners}"
            )

    def residuals(
        self, state: _State, derivatives: bool = False
    ) -> tuple[FloatMap, FloatMap, FloatMap]:
        """(n, 4) px: camera's, then projector's at the predicted pixel; (n, 2) projector's at the
        corner as seen; and (n, 4, parameters)."""
        rig = state.rig
        R = rig.T_projector_camera[:3, :3]
        out = np.empty((self.corners, 4))
        plain = np.empty((self.corners, 2))
        size = RIG + POSE * len(self.sightings)
        jacobian = np.zeros((self.corners if derivatives else 0, 4, size))
        for k, (seen, T) in enumerate(zip(self.sightings, state.poses, strict=True)):
            rows = self.rows[k]
            turned = seen.points_mm @ T[:3, :3].T
            in_camera = turned + T[:3, 3]
            in_projector = transform(rig.T_projector_camera, in_camera)
            c, c_by_point, c_by_device = project_with_derivatives(rig.camera, in_camera)
            q, q_by_point, q_by_device = project_with_derivatives(rig.projector, in_projector)
            out[rows, :2] = seen.camera_px - c
            plain[rows] = seen.projector_px - q
            Q = seen.by_pixel
            out[rows, 2:] = plain[rows] - np.einsum("nij,nj->ni", Q, out[rows, :2])
            if not derivatives:
                continue
            by_pose = np.concatenate(
                (-skew(turned), np.broadcast_to(np.eye(3), (len(c), 3, 3))), axis=2
            )
            by_rig = np.concatenate(
                (-skew(in_camera @ R.T), np.broadcast_to(np.eye(3), (len(c), 3, 3))), axis=2
            )
            J = jacobian[rows]
            place = slice(RIG + POSE * k, RIG + POSE * (k + 1))
            J[:, :2, :DEVICE] = c_by_device
            J[:, :2, place] = c_by_point @ by_pose
            J[:, 2:, DEVICE : 2 * DEVICE] = q_by_device
            J[:, 2:, 2 * DEVICE : RIG] = q_by_point @ by_rig
            J[:, 2:, place] = q_by_point @ R @ by_pose
            J[:, 2:] -= Q @ J[:, :2]
        return out, plain, jacobian

    def scatter(self, state: _State, weights: FloatMap | None) -> FloatMap:
        """Standard deviation per coordinate of both devices' residuals at every corner, (n, 2), px.

        Poses differ: edges along the pixels' grid, blur and light make some of them worse.
        """
        out, _, _ = self.residuals(state)
        dof = max(1.0 - 0.5 * self.free.sum() / (2.0 * self.corners), 0.2)
        spread = np.empty((self.corners, 2))
        for device in (0, 1):
            length = np.hypot(*out[:, 2 * device : 2 * device + 2].T)
            usual = _scatter_of(length, refined=weights is not None)
            for rows in self.rows:
                n = rows.stop - rows.start
                own = _scatter_of(length[rows], refined=weights is not None)
                square = (n * own**2 + USUAL * usual**2) / (n + USUAL)
                spread[rows, device] = max(np.sqrt(square / dof), FLOOR[device])
        return spread

    def weights(self, state: _State, scatter: FloatMap) -> FloatMap:
        """Huber's weights of every corner for both devices, (n, 2), 0 for outliers."""
        out, _, _ = self.residuals(state)
        weights = np.empty((self.corners, 2))
        for device in (0, 1):
            length = np.hypot(*out[:, 2 * device : 2 * device + 2].T) / scatter[:, device]
            weights[:, device] = np.minimum(1.0, HUBER / np.maximum(length, 1e-9))
            weights[length > OUTLIER, device] = 0.0
        # A corner that one device has wrong is wrong.
        weights[(weights == 0).any(axis=1)] = 0.0
        return weights

    def normal(
        self, state: _State, scatter: FloatMap, weights: FloatMap | None
    ) -> tuple[FloatMap, FloatMap, float]:
        out, _, jacobian = self.residuals(state, derivatives=True)
        root = self._roots(scatter, weights)
        J = (jacobian[:, :, self.free] * root[:, :, None]).reshape(-1, int(self.free.sum()))
        r = (out * root).ravel()
        return J.T @ J, J.T @ r, float(r @ r)

    def _roots(self, scatter: FloatMap, weights: FloatMap | None) -> FloatMap:
        root = np.ones((self.corners, 2)) if weights is None else np.sqrt(weights)
        return np.repeat(root / scatter, 2, axis=1)

    def cost(self, state: _State, scatter: FloatMap, weights: FloatMap | None) -> float:
        out, _, _ = self.residuals(state)
        r = (out * self._roots(scatter, weights)).ravel()
        total = float(r @ r)
        return total if np.isfinite(total) else np.inf

    def minimise(self, state: _State, scatter: FloatMap, weights: FloatMap | None) -> _State:
        """Levenberg's and Marquardt's method with fixed weights."""
        damping = 1e-4
        for _ in range(STEPS):
            A, b, cost = self.normal(state, scatter, weights)
            scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
            A, b = A / np.outer(scale, scale), b / scale
            for _ in range(12):
                step = np.linalg.solve(A + damping * np.eye(len(b)), b) / scale
                trial = self.moved(state, step)
                new = np.inf if trial is None else self.cost(trial, scatter, weights)
                if new <= cost:
                    break
                damping = max(damping * 8.0, 1e-8)
            else:
                return state
            assert trial is not None
            state, damping = trial, damping * 0.1
            if cost - new <= 1e-9 * cost:
                break
        return state

    def moved(self, state: _State, step: FloatMap) -> _State | None:
        full = np.zeros(self.free.size)
        full[self.free] = step
        devices = []
        for k, device in enumerate((state.rig.camera, state.rig.projector)):
            v = device.parameters + full[DEVICE * k : DEVICE * (k + 1)]
            if not (np.isfinite(v).all() and v[0] > 0 and v[1] > 0):
                return None
            devices.append(pinhole_of(v, device))
        turned = _moved_pose(state.rig.T_projector_camera, full[2 * DEVICE : RIG])
        rig = Rig(devices[0], devices[1], turned)
        poses = tuple(
            _moved_pose(T, full[RIG + POSE * k : RIG + POSE * (k + 1)])
            for k, T in enumerate(state.poses)
        )
        return _State(rig, poses)

    def result(self, state: _State, scatter: FloatMap, weights: FloatMap | None) -> Adjusted:
        A, _, _ = self.normal(state, scatter, weights)
        scale = np.sqrt(np.diag(A))
        if not (scale > 0).all() or np.linalg.cond(A / np.outer(scale, scale)) > 1e14:
            raise InputError(
                "calibration: expected poses that determine all parameters, got too few or too "
                "much alike"
            )
        inner = np.linalg.inv(A / np.outer(scale, scale)) / np.outer(scale, scale)
        covariance = np.zeros((self.free.size, self.free.size))
        covariance[np.ix_(self.free, self.free)] = inner
        out, plain, _ = self.residuals(state)
        kept = np.ones((self.corners, 2)) if weights is None else weights
        used = np.asarray((kept > 0).all(axis=1))
        rms = tuple(
            float(np.sqrt(np.mean(np.sum(r[used] ** 2, axis=1)))) for r in (out[:, :2], plain)
        )
        rig = Rig(
            state.rig.camera,
            state.rig.projector,
            state.rig.T_projector_camera,
            covariance[:RIG, :RIG],
            (rms[0], rms[1]),
        )
        return Adjusted(
            rig=rig,
            poses=state.poses,
            covariance=covariance,
            camera_residual_px=tuple(out[rows, :2] for rows in self.rows),
            projector_residual_px=tuple(plain[rows] for rows in self.rows),
            used=tuple(used[rows] for rows in self.rows),
            scatter_px=tuple(
                (float(scatter[rows.start, 0]), float(scatter[rows.start, 1])) for rows in self.rows
            ),
        )


def _scatter_of(length: FloatMap, *, refined: bool) -> float:
    """Standard deviation per coordinate of residuals of these lengths, without outliers."""
    # The median length of two normal coordinates is 1.1774 of their deviation.
    rough = float(np.median(length)) / 1.1774
    if not refined:
        return rough
    return float(np.sqrt(0.5 * np.mean(length[length <= OUTLIER * rough] ** 2)))


def board_bow(
    sightings: Sequence[Sighting], adjusted: Adjusted, *, free: BoolMap | None = None
) -> tuple[FloatMap, FloatMap]:
    """By how much the board is bent, if all poses show the same board.

    Returns
    -------
    (3,) heights mm that x², x y and y² reach half a board away from its middle, and their (3, 3)
    covariance: one step of least squares with all other parameters free.
    """
    problem = _Problem(sightings, np.ones(RIG, bool) if free is None else free)
    state = _State(adjusted.rig, adjusted.poses)
    out, _, jacobian = problem.residuals(state, derivatives=True)
    rig = adjusted.rig
    R = rig.T_projector_camera[:3, :3]
    everything = np.concatenate([s.points_mm for s in sightings])
    low, high = everything.min(axis=0), everything.max(axis=0)
    extra = []
    for seen, T in zip(sightings, adjusted.poses, strict=True):
        x, y = ((seen.points_mm - 0.5 * (low + high)) / (0.5 * np.max(high - low)))[:, :2].T
        in_camera = transform(T, seen.points_mm)
        _, c_by_point, _ = project_with_derivatives(rig.camera, in_camera)
        _, q_by_point, _ = project_with_derivatives(
            rig.projector, transform(rig.T_projector_camera, in_camera)
        )
        up = T[:3, 2]
        shape = np.stack((x * x, x * y, y * y), axis=1)[:, None, :]
        by_camera = (c_by_point @ up)[..., None] * shape
        by_projector = (q_by_point @ (R @ up))[..., None] * shape - seen.by_pixel @ by_camera
        extra.append(np.concatenate((by_camera, by_projector), axis=1))
    used = np.concatenate(adjusted.used)
    sizes = [len(s.points_mm) for s in sightings]
    scatter = np.repeat(np.array(adjusted.scatter_px), sizes, axis=0)
    root = np.repeat(used[:, None] / scatter, 2, axis=1)
    J = np.concatenate((np.concatenate(extra), jacobian[:, :, problem.free]), axis=2)
    J = (J * root[:, :, None]).reshape(-1, J.shape[2])
    r = (out * root).ravel()
    scale = np.linalg.norm(J, axis=0)
    A = (J / scale).T @ (J / scale)
    covariance = np.linalg.inv(A) / np.outer(scale, scale)
    step = covariance @ (J.T @ r)
    left = r - J @ step
    # What the bent board leaves is noise; what the flat one left may have been its bend.
    variance = float(left @ left) / max(4.0 * used.sum() - len(step), 1.0)
    return step[:3], covariance[:3, :3] * max(variance, 1e-12)


def pinhole_of(values: FloatMap, like: Pinhole) -> Pinhole:
    """A device of nine parameters and another's size."""
    v = [float(x) for x in values]
    return Pinhole(
        like.width_px, like.height_px, (v[0], v[1]), (v[2], v[3]), (v[4], v[5], v[6], v[7], v[8])
    )


def _moved_pose(T: FloatMap, step: FloatMap) -> FloatMap:
    turned = rotation(step[:3]) @ T[:3, :3]
    # Rounding adds up over many steps: back to the nearest rotation.
    u, _, v = np.linalg.svd(turned)
    return pose(u @ v, T[:3, 3] + step[3:])


def fit_pose(sighting: Sighting, rig: Rig, start: FloatMap) -> FloatMap:
    """T_camera_board of a board by the camera's corners alone, with the rig as it is."""
    T = start
    for _ in range(STEPS):
        turned = sighting.points_mm @ T[:3, :3].T
        c, by_point, _ = project_with_derivatives(rig.camera, turned + T[:3, 3])
        by_pose = np.concatenate(
            (-skew(turned), np.broadcast_to(np.eye(3), (len(c), 3, 3))), axis=2
        )
        J = (by_point @ by_pose).reshape(-1, POSE)
        step = np.linalg.lstsq(J, (sighting.camera_px - c).ravel(), rcond=None)[0]
        T = _moved_pose(T, step)
        if np.linalg.norm(step[:3]) < 1e-10 and np.linalg.norm(step[3:]) < 1e-8:
            break
    return T


def relative_pose(camera: Sequence[FloatMap], projector: Sequence[FloatMap]) -> FloatMap:
    """T_projector_camera from poses of the same boards: the one that is most like all others."""
    each: list[NDArray[np.float64]] = [
        p @ inverse(c) for c, p in zip(camera, projector, strict=True)
    ]
    offsets = np.array([T[:3, 3] for T in each])
    far = np.linalg.norm(offsets[:, None] - offsets[None], axis=2)
    return each[int(np.argmin(np.median(far, axis=1)))]
