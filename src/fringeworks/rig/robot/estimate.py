"""Maximum likelihood of hand–eye transform and board, with errors of robot, corners and camera.

Every pose i tells M = X⁻¹ G Y: the board before the camera (M, from its corners), the robot's pose
between the two sides (G), the camera on its side (X) and the board on the other (Y). Corners, robot
poses and the camera's parameters have errors; all are unknowns with a known or estimated variance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fringeworks.rig.calibration.parameters import POSE_SIZE, moved_pose
from fringeworks.rig.pinhole import skew
from fringeworks.rig.robot.board_views import SeenBoards
from fringeworks.rig.robot.readings import inverses
from fringeworks.rig.robot.start import rotation_vectors
from fringeworks.types import BoolMap, FloatMap, InputError, Mount, RobotNoise

UNKNOWNS = 2 * POSE_SIZE
"""Parameters of both transforms."""
MAX_STEPS = 60
"""Largest number of Gauss–Newton steps; from the closed form fewer than ten are usual."""
MOST_TURN_RAD = 0.5
"""Largest rotation in one step, rad: beyond it the equations are not linear."""
TURNS = np.r_[0:3, POSE_SIZE : POSE_SIZE + 3]
"""Rotations among the parameters."""
SETTLED = 1e-8
"""Step below which the transforms have settled, rad and mm."""
NOISE_SETTLED = 1e-6
"""Relative change below which the estimated noise has settled."""
MAX_NOISE_STEPS = 60
"""Largest number of steps of the noise. Each is one of Fisher's scoring, halved where it would make
a variance negative."""
LEAST_INFORMATION = 1e-100
"""Lower bound of the information about a parameter, so that nothing is divided by 0."""
SMALLEST_SCALE = 1e-3
"""Smallest factor of the robot's translations: millimetres read as metres."""
FARTHEST_MM = 1e6
"""Distance of camera and board from the robot, mm, at which an adjustment has diverged: 1 km."""
HOPELESS_NOISE = RobotNoise(100.0, 20.0)
"""Noise at which poses and views do not belong together, far beyond that of any robot."""
CONTRADICT = "hand-eye: the robot's poses contradict the board views"
SAME_MOMENTS = (
    f"{CONTRADICT}: are they in the same order as the views, of the same moments, written as "
    "stated, and is the board's size right?"
)
"""What is said where an adjustment diverges."""
LEAST_ROTATION_RAD = 1e-7
"""Lower bound of an estimated rotation noise, rad: encoders resolve no less."""
LEAST_TRANSLATION_MM = 1e-5
"""Lower bound of an estimated translation noise, mm."""


@dataclass(frozen=True, eq=False)
class Data:
    """Robot poses and board views that belong together."""

    T_base_flange: FloatMap
    """(n, 4, 4), mm."""
    seen: SeenBoards
    mount: Mount

    @property
    def motions(self) -> FloatMap:
        """Robot poses from the board's side to the camera's, (n, 4, 4)."""
        return inverses(self.T_base_flange) if self.mount == "hand" else self.T_base_flange

    def at(self, kept: BoolMap) -> Data:
        """Some of the poses."""
        return Data(self.T_base_flange[kept], self.seen.at(kept), self.mount)


@dataclass(frozen=True, eq=False)
class Equations:
    """The model at one solution, linear in everything that is unknown."""

    r: FloatMap
    """Measured minus predicted pose of the board, (n, 6); rad, mm."""
    by_transforms: FloatMap
    """Derivative of the prediction by the errors of X and Y, (n, 6, 12)."""
    by_robot: FloatMap
    """Its derivative by the error of the robot's pose, (n, 6, 6)."""


def equations(data: Data, X: FloatMap, Y: FloatMap) -> Equations:
    """Residuals and derivatives; errors (ω, v) turn R into exp(ω) R and t into t + v."""
    G, M = data.motions, data.seen.T_camera_board
    back, Rg = X[:3, :3].T, G[:, :3, :3]
    held = Rg @ Y[:3, 3] + G[:, :3, 3]  # the board's origin on the camera's side
    rotation = back @ Rg @ Y[:3, :3]
    shift = (held - X[:3, 3]) @ X[:3, :3]
    turned = M[:, :3, :3] @ np.swapaxes(rotation, 1, 2)
    r = np.concatenate((rotation_vectors(turned), M[:, :3, 3] - shift), axis=1)
    n = len(G)
    by = np.zeros((n, POSE_SIZE, UNKNOWNS))
    by[:, :3, :3], by[:, 3:, 3:6] = -back, -back
    by[:, 3:, :3] = back @ skew(held - X[:3, 3])
    by[:, :3, 6:9] = by[:, 3:, 9:] = back @ Rg
    robot = np.zeros((n, POSE_SIZE, POSE_SIZE))
    if data.mount == "base":
        robot[:, :3, :3] = robot[:, 3:, 3:] = back
        robot[:, 3:, :3] = -back @ skew(Rg @ Y[:3, 3])
    else:
        robot[:, :3, :3] = robot[:, 3:, 3:] = -back @ Rg
        robot[:, 3:, :3] = back @ Rg @ skew(Y[:3, 3] - data.T_base_flange[:, :3, 3])
    return Equations(r, by, robot)


@dataclass(frozen=True, eq=False)
class Solution:
    """Both transforms, and how well everything agrees."""

    X: FloatMap
    """Camera on its side, (4, 4): T_flange_camera or T_base_camera, mm."""
    Y: FloatMap
    """Board on the other side, (4, 4): T_base_board or T_flange_board, mm."""
    variances: FloatMap
    """Of the robot's rotation (rad²) and translation (mm²), (6,)."""
    covariance: FloatMap
    """Of the errors of X and Y, (12, 12); rad, mm."""
    chi2: float
    """Weighted squares of all residuals; 6 n − 12 are expected."""
    converged: bool

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviations of the robot, mm and degrees."""
        return float(np.sqrt(self.variances[3])), float(np.degrees(np.sqrt(self.variances[0])))


@dataclass(frozen=True, eq=False)
class Whitened:
    """The equations with the covariance of everything but X and Y taken out."""

    inverse: FloatMap
    """Inverse of the covariance of all residuals, (6 n, 6 n)."""
    J: FloatMap
    """(6 n, 12)."""
    r: FloatMap
    """(6 n,)."""
    normal: FloatMap
    """(12, 12)."""

    @property
    def leftover(self) -> FloatMap:
        """Inverse covariance of the residuals that the estimated transforms leave, (6 n, 6 n)."""
        weighted = self.inverse @ self.J
        return np.asarray(self.inverse - weighted @ self.covariance @ weighted.T)

    @property
    def covariance(self) -> FloatMap:
        """Of the errors of X and Y, (12, 12)."""
        scale, scaled = self.scaled
        return np.linalg.pinv(scaled, hermitian=True) / np.outer(scale, scale)

    @property
    def scaled(self) -> tuple[FloatMap, FloatMap]:
        """The roots of the diagonal of ``normal``, and ``normal`` with ones there."""
        scale = np.sqrt(np.maximum(np.diag(self.normal), LEAST_INFORMATION))
        return scale, self.normal / np.outer(scale, scale)


def whitened(data: Data, found: Equations, variances: FloatMap) -> Whitened:
    """The covariance of all residuals and its normal equations."""
    n = len(found.r)
    blocks = data.seen.covariance + np.einsum(
        "nij,j,nkj->nik", found.by_robot, variances, found.by_robot
    )
    inverses_of = np.linalg.inv(blocks)
    weight = np.zeros((n, POSE_SIZE, n, POSE_SIZE))
    weight[np.arange(n), :, np.arange(n), :] = inverses_of
    inverse_of_all = weight.reshape(POSE_SIZE * n, POSE_SIZE * n)
    parts = data.seen.by_camera.shape[2]
    if parts:
        # The camera's errors are common to all poses (Woodbury's formula).
        D = data.seen.by_camera.reshape(-1, parts)
        weighted = inverse_of_all @ D
        inner = np.eye(parts) + D.T @ weighted
        inverse_of_all = inverse_of_all - weighted @ np.linalg.solve(inner, weighted.T)
    J = found.by_transforms.reshape(-1, UNKNOWNS)
    return Whitened(inverse_of_all, J, found.r.ravel(), J.T @ inverse_of_all @ J)


def solved(data: Data, X: FloatMap, Y: FloatMap, variances: FloatMap) -> Solution:
    """Refine both transforms with the robot's noise known (generalised least squares)."""
    converged = False
    for _ in range(MAX_STEPS):
        if not max(np.abs(X[:3, 3]).max(), np.abs(Y[:3, 3]).max()) < FARTHEST_MM:
            raise InputError(SAME_MOMENTS)
        white = whitened(data, equations(data, X, Y), variances)
        scale, scaled = white.scaled
        right = white.J.T @ white.inverse @ white.r / scale
        step = np.linalg.lstsq(scaled, right, rcond=None)[0] / scale
        step *= min(1.0, MOST_TURN_RAD / max(float(np.abs(step[TURNS]).max()), 1e-300))
        X, Y = moved_pose(X, step[:POSE_SIZE]), moved_pose(Y, step[POSE_SIZE:])
        if np.abs(step).max() < SETTLED:
            converged = True
            break
    white = whitened(data, equations(data, X, Y), variances)
    chi2 = float(white.r @ white.leftover @ white.r)
    return Solution(X, Y, variances, white.covariance, chi2, converged)


def solved_with_noise(data: Data, X: FloatMap, Y: FloatMap, start: FloatMap) -> Solution:
    """Refine both transforms, and estimate the robot's noise from the residuals.

    Notes
    -----
    Restricted maximum likelihood of two variances, which does not count the degrees of freedom of
    the transforms (Patterson and Thompson, Biometrika 58, 1971, doi:10.1093/biomet/58.3.545), by
    Fisher's scoring.
    """
    variances, found, settled = start, solved(data, X, Y, start), False
    least = np.repeat([LEAST_ROTATION_RAD**2, LEAST_TRANSLATION_MM**2], 3)
    for _ in range(MAX_NOISE_STEPS):
        new = np.maximum(_scored(data, found), least)
        settled = bool(np.abs(np.log(new / variances)).max() < NOISE_SETTLED)
        variances = new
        if (variances > HOPELESS_NOISE.variances).any():
            raise InputError(SAME_MOMENTS)
        found = solved(data, found.X, found.Y, variances)
        if settled:
            break
    return replace(found, converged=found.converged and settled)


def _scored(data: Data, found: Solution) -> FloatMap:
    """The variances after one step of Fisher's scoring, (6,)."""
    made = equations(data, found.X, found.Y)
    white = whitened(data, made, found.variances)
    P = white.leftover
    n = len(made.r)
    weighted = (P @ white.r).reshape(n, POSE_SIZE)
    # P in blocks (n, 6, n, 6), taken to the robot's own coordinates.
    whole = P.reshape(n, POSE_SIZE, n, POSE_SIZE)
    own = np.einsum("nia,nimj,mjb->namb", made.by_robot, whole, made.by_robot, optimize=True)
    squares = np.einsum("nij,ni->nj", made.by_robot, weighted) ** 2
    groups = (slice(0, 3), slice(3, 6))
    score = np.array(
        [np.sum(squares[:, g]) - np.einsum("nana->", own[:, g][:, :, :, g]) for g in groups]
    )
    information = np.array([[np.sum(own[:, g][:, :, :, h] ** 2) for h in groups] for g in groups])
    old = found.variances[[0, 3]]
    step = np.linalg.lstsq(information, score, rcond=None)[0]
    new = old + step
    for k in range(2):
        # A variance may fall by a factor of ten at most, so that it stays above 0.
        new[k] = min(max(new[k], 0.1 * old[k]), 100.0 * old[k])
    return np.repeat(new, 3)


@dataclass(frozen=True, eq=False)
class Scale:
    """Size of the board by the robot's motions."""

    value: float
    """Over its stated size; 1 where poses and views are in the same unit."""
    sigma: float
    chi2: float
    """By how much the weighted squares fall with it."""
    shift: FloatMap
    """By how much it changes the errors of X and Y, (12,)."""


def scale_of(data: Data, found: Solution) -> Scale:
    """Estimate one factor of all translations of the robot beside the transforms.

    A board of another size, and poses in another unit, look like noise of poses that move little.
    """
    made = equations(data, found.X, found.Y)
    white = whitened(data, made, found.variances)
    by = np.zeros_like(made.r)
    by[:, 3:] = data.motions[:, :3, 3] @ found.X[:3, :3]
    q, leftover = by.ravel(), white.leftover
    information = max(float(q @ leftover @ q), LEAST_INFORMATION)
    more = float(q @ leftover @ white.r) / information
    shift = -more * (white.covariance @ (white.J.T @ (white.inverse @ q)))
    # A longer way of the robot is a smaller board.
    size = 1.0 / max(1.0 + more, SMALLEST_SCALE)
    sigma = size**2 / np.sqrt(information)
    return Scale(size, float(sigma), more**2 * information, shift)


@dataclass(frozen=True, eq=False)
class LeftOutPoses:
    """Every pose as the others predict it."""

    chi2: FloatMap
    """Squared difference over its covariance, (n,); 6 are expected."""
    distance_mm: FloatMap
    """Root mean square distance of the board, (n,), mm."""
    sigma_mm: FloatMap
    """What is expected of it, (n,), mm."""


def left_out(data: Data, found: Solution) -> LeftOutPoses:
    """Predict every pose by the others, without solving again (by the residuals' covariance)."""
    made = equations(data, found.X, found.Y)
    white = whitened(data, made, found.variances)
    n = len(made.r)
    P = white.leftover.reshape(n, POSE_SIZE, n, POSE_SIZE)
    own = P[np.arange(n), :, np.arange(n), :]
    covariance = np.linalg.pinv(own, hermitian=True)
    weighted = (P.reshape(POSE_SIZE * n, -1) @ white.r).reshape(n, POSE_SIZE)
    error = np.einsum("nij,nj->ni", covariance, weighted)
    return _judged(data, error, covariance)


def predicted(data: Data, found: Solution) -> LeftOutPoses:
    """Predict poses that were not used by a solution from others."""
    made = equations(data, found.X, found.Y)
    alone = data.seen.covariance + np.einsum(
        "nij,j,nkj->nik", made.by_robot, found.variances, made.by_robot
    )
    by = made.by_transforms
    covariance = alone + by @ found.covariance @ np.swapaxes(by, 1, 2)
    camera = data.seen.by_camera
    return _judged(data, made.r, covariance + camera @ np.swapaxes(camera, 1, 2))


def _judged(data: Data, error: FloatMap, covariance: FloatMap) -> LeftOutPoses:
    turned = data.seen.T_camera_board[:, :3, :3] @ data.seen.middle_mm
    by_point = np.concatenate(
        (-skew(turned), np.broadcast_to(np.eye(3), (len(turned), 3, 3))), axis=2
    )
    spread = 2.0 / 3.0 * data.seen.radius_mm**2
    shift = np.einsum("nij,nj->ni", by_point, error)
    squares = np.sum(shift**2, axis=1) + spread * np.sum(error[:, :3] ** 2, axis=1)
    expected = np.einsum("nij,njk,nik->n", by_point, covariance, by_point)
    expected = expected + spread * np.einsum("nii->n", covariance[:, :3, :3])
    chi2 = np.einsum("ni,nij,nj->n", error, np.linalg.pinv(covariance, hermitian=True), error)
    return LeftOutPoses(chi2, np.sqrt(squares), np.sqrt(expected))
