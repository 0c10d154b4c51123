"""Bundle adjustment of a camera, a projector, their relative pose, and all poses of a board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fringeworks.rig.calibration.parameters import POSE_SIZE, RIG_SIZE, State
from fringeworks.rig.calibration.residuals import Sighting, residuals_of, rows_of
from fringeworks.rig.calibration.robust import root_weights, scatter_of, weights_of
from fringeworks.types import BoolMap, FloatMap, InputError, Rig

MAX_ROUNDS = 8
"""Largest number of rounds. Every round minimises with fixed weights, then estimates scatter and
weights anew; three or four rounds are usual."""
SETTLED = 1e-3
"""Relative change of the scatter between two rounds below which it has settled. The weights, and
with them the result, then change by far less than a standard deviation."""
MAX_LM_STEPS = 40
"""Largest number of Levenberg–Marquardt steps in a round; five to seven are usual."""
MAX_TRIALS = 12
"""Largest number of dampings tried in one step. If all of them raise the cost, the minimum is
reached to rounding."""
FIRST_DAMPING = 1e-4
"""Damping of the first step, relative to the diagonal of the normal matrix: nearly a plain
Gauss–Newton step, because the start is good."""
MORE_DAMPING = 8.0
"""Factor of the damping after a step that raised the cost. Empirical."""
LESS_DAMPING = 0.1
"""Factor of the damping after a step that lowered the cost. Empirical."""
MIN_RAISED_DAMPING = 1e-8
"""Damping to begin with after a failed step, however small it was before: below, the next step
would be the same to rounding."""
COST_SETTLED = 1e-9
"""Relative decrease of the cost below which a round ends. The cost is quadratic in the step and
about as large as the number of residuals, so with some thousand residuals the parameters then move
by about 0.001 of their standard deviations."""
MAX_CONDITION = 1e14
"""Largest condition number of the scaled normal matrix. Beyond, its inverse has hardly a
correct digit in double precision: the poses do not determine the parameters."""


@dataclass(frozen=True, eq=False)
class Adjusted:
    """The result of a bundle adjustment."""

    rig: Rig
    """With the covariance of its 24 parameters and the root mean square residuals."""
    poses: tuple[FloatMap, ...]
    """T_camera_board of every sighting, (4, 4), mm."""
    covariance: FloatMap
    """Covariance of the rig's 24 parameters and then of every pose's 6, square; 0 for parameters
    that were held fixed."""
    camera_residual_px: tuple[FloatMap, ...]
    """Measured minus predicted camera pixels, (m, 2) per sighting, px."""
    projector_residual_px: tuple[FloatMap, ...]
    """Measured minus predicted projector pixels, (m, 2) per sighting, px."""
    used: tuple[BoolMap, ...]
    """False for corners that were left out as outliers, (m,) per sighting."""
    scatter_px: tuple[tuple[float, float], ...]
    """Per sighting: standard deviation of a corner in the camera, and of the projector coordinate
    read at the predicted camera pixel, per coordinate, px."""


def adjust(
    sightings: Sequence[Sighting],
    rig: Rig,
    poses: Sequence[FloatMap],
    *,
    free: BoolMap | None = None,
) -> Adjusted:
    """Fit the rig and all poses to all corners by robust least squares.

    Parameters
    ----------
    sightings : sequence of Sighting
    rig : Rig
        Start.
    poses : sequence of (4, 4) arrays
        Start: T_camera_board of every sighting, mm.
    free : (24,) bool array, optional
        Which of the rig's parameters are estimated; the others keep their start. All by default.

    Returns
    -------
    Adjusted

    Raises
    ------
    InputError where the sightings do not determine the parameters.

    Notes
    -----
    Levenberg–Marquardt over the residuals of ``residuals_of`` (theory §8; Triggs et al., LNCS
    1883, 2000), each divided by its scatter, with Huber's weights. The scatter is estimated from
    the residuals, for each device and pose. The projector's is usually far smaller than the
    camera's, because its coordinate is averaged over a window while a corner is a point.
    """
    problem = _Problem(sightings, np.ones(RIG_SIZE, bool) if free is None else free)
    state = State(rig, tuple(poses))
    scatter = problem.scatter(state, refined=False)
    weights: FloatMap | None = None
    for _ in range(MAX_ROUNDS):
        state = problem.minimise(state, scatter, weights)
        before, scatter = scatter, problem.scatter(state, refined=weights is not None)
        weights = weights_of(residuals_of(sightings, state).independent, scatter)
        if np.allclose(scatter, before, rtol=SETTLED):
            break
    state = problem.minimise(state, scatter, weights)
    return problem.result(state, scatter, weights)


class _Problem:
    """The sightings to fit, and which of all parameters are free."""

    def __init__(self, sightings: Sequence[Sighting], free_of_rig: BoolMap) -> None:
        self.sightings = sightings
        self.free = free_parameters(len(sightings), free_of_rig)
        self.rows = rows_of(sightings)
        corners = sum(len(s.points_mm) for s in sightings)
        unknowns = int(self.free.sum())
        if 4 * corners <= unknowns:
            raise InputError(
                f"calibration: expected more than {unknowns // 4} corners to determine {unknowns} "
                f"parameters, got {corners}"
            )

    def scatter(self, state: State, *, refined: bool) -> FloatMap:
        """Standard deviation of every corner's residuals, (n, 2), px; see ``scatter_of``."""
        independent = residuals_of(self.sightings, state).independent
        return scatter_of(independent, self.rows, int(self.free.sum()), refined=refined)

    def normal_equations(
        self, state: State, scatter: FloatMap, weights: FloatMap | None
    ) -> tuple[FloatMap, FloatMap, float]:
        """Normal matrix, right-hand side and cost of the free parameters."""
        residuals = residuals_of(self.sightings, state, derivatives=True)
        root = root_weights(scatter, weights)
        J = (residuals.jacobian[:, :, self.free] * root[:, :, None]).reshape(
            -1, int(self.free.sum())
        )
        r = (residuals.independent * root).ravel()
        return J.T @ J, J.T @ r, float(r @ r)

    def cost(self, state: State, scatter: FloatMap, weights: FloatMap | None) -> float:
        """Weighted sum of squared residuals; ∞ where a point is behind a device."""
        independent = residuals_of(self.sightings, state).independent
        r = (independent * root_weights(scatter, weights)).ravel()
        total = float(r @ r)
        return total if np.isfinite(total) else np.inf

    def minimise(self, state: State, scatter: FloatMap, weights: FloatMap | None) -> State:
        """Lower the cost by Levenberg–Marquardt steps with fixed scatter and weights."""
        damping = FIRST_DAMPING
        for _ in range(MAX_LM_STEPS):
            A, b, cost = self.normal_equations(state, scatter, weights)
            scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
            A, b = A / np.outer(scale, scale), b / scale
            for _ in range(MAX_TRIALS):
                step = np.zeros(self.free.size)
                step[self.free] = np.linalg.solve(A + damping * np.eye(len(b)), b) / scale
                trial = state.moved(step)
                new_cost = np.inf if trial is None else self.cost(trial, scatter, weights)
                if new_cost <= cost:
                    break
                damping = max(damping * MORE_DAMPING, MIN_RAISED_DAMPING)
            else:
                return state
            assert trial is not None
            state, damping = trial, damping * LESS_DAMPING
            if cost - new_cost <= COST_SETTLED * cost:
                break
        return state

    def covariance(self, state: State, scatter: FloatMap, weights: FloatMap | None) -> FloatMap:
        """Covariance of all parameters: the inverse of the normal matrix; 0 where not free."""
        A, _, _ = self.normal_equations(state, scatter, weights)
        scale = np.sqrt(np.diag(A))
        if not (scale > 0).all() or np.linalg.cond(A / np.outer(scale, scale)) > MAX_CONDITION:
            raise InputError(
                "calibration: expected poses that determine all parameters, got too few poses or "
                "poses that are too similar; turn the board further, and move it nearer and further"
            )
        of_free = np.linalg.inv(A / np.outer(scale, scale)) / np.outer(scale, scale)
        covariance = np.zeros((self.free.size, self.free.size))
        covariance[np.ix_(self.free, self.free)] = of_free
        return covariance

    def result(self, state: State, scatter: FloatMap, weights: FloatMap | None) -> Adjusted:
        """Collect the result at the minimum."""
        covariance = self.covariance(state, scatter, weights)
        residuals = residuals_of(self.sightings, state)
        camera, projector = residuals.independent[:, :2], residuals.projector_seen
        kept = np.ones(camera.shape) if weights is None else weights
        used = np.asarray((kept > 0).all(axis=1))
        rig = Rig(
            state.rig.camera,
            state.rig.projector,
            state.rig.T_projector_camera,
            covariance[:RIG_SIZE, :RIG_SIZE],
            (_rms_length(camera[used]), _rms_length(projector[used])),
        )
        return Adjusted(
            rig=rig,
            poses=state.poses,
            covariance=covariance,
            camera_residual_px=tuple(camera[rows] for rows in self.rows),
            projector_residual_px=tuple(projector[rows] for rows in self.rows),
            used=tuple(used[rows] for rows in self.rows),
            scatter_px=tuple(
                (float(scatter[rows.start, 0]), float(scatter[rows.start, 1])) for rows in self.rows
            ),
        )


def free_parameters(poses: int, free_of_rig: BoolMap) -> BoolMap:
    """Return which of all parameters are estimated: those of the rig as given, and every pose."""
    return np.concatenate((free_of_rig, np.ones(POSE_SIZE * poses, bool)))


def _rms_length(residual: FloatMap) -> float:
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))
