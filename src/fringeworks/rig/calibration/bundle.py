"""Bundle adjustment of a camera, a projector, their relative pose, and a board in several poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.rig.calibration.adjusted import Adjusted, Weighting, Without
from fringeworks.rig.calibration.board_shape import (
    BOW_SIZE,
    OFFSET_SIZE,
    SMOOTH_SIZE,
    BoardShape,
    estimated_prior,
    first_prior,
)
from fringeworks.rig.calibration.normal_equations import Covariance, NormalEquations
from fringeworks.rig.calibration.parameters import (
    POSE_SIZE,
    RIG_SIZE,
    FurtherCamera,
    RigPrior,
    State,
)
from fringeworks.rig.calibration.residuals import (
    Corners,
    Residuals,
    Sighting,
    board_places,
    corners_of,
    residuals_of,
)
from fringeworks.rig.calibration.robust import first_scatter, scatter_of, weights_of
from fringeworks.types import BoolMap, FloatMap, InputError, Rig

MAX_ROUNDS = 20
"""Largest number of rounds. Every round minimises with fixed weights, then estimates scatter,
weights and the board's prior anew; five to eight rounds are usual."""
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
PRIOR_SETTLED = 2e-3
"""Relative change of the board's prior between two rounds below which it has settled. The
result then changes by far less than a standard deviation."""
NEGLIGIBLE_PRIOR = 1e-5
"""Change of the board's prior, over the bow's prior, that does not matter: 0.2 µm on a board of
120 mm, below what corners show."""


def adjust(
    sightings: Sequence[Sighting],
    rig: Rig,
    poses: Sequence[FloatMap],
    *,
    free: BoolMap | None = None,
    prior: RigPrior | None = None,
    further: Sequence[FurtherCamera] = (),
    smooth: bool = False,
) -> Adjusted:
    """Fit the rig, all poses and the board's shape to all corners by robust least squares.

    Parameters
    ----------
    sightings : sequence of Sighting
    rig : Rig
        Start.
    poses : sequence of (4, 4) arrays
        Start: T_camera_board of the board in every pose before the first camera, mm.
    free : (24 …,) bool array, optional
        Which of the devices' parameters are estimated; the others keep their start. All by default.
    prior : RigPrior, optional
        What is known about the rig beside the sightings. With it, one sighting is enough.
    further : sequence of FurtherCamera, optional
        Start of the cameras after the first. Sightings name their camera and pose.
    smooth : bool
        Whether the board's points have smooth errors as well, beside the bow. What the corners of
        single poses have in common can look like them.

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

    A printed board is off at the same points in every pose, and bowed. Its points are estimated
    as well (object-releasing calibration: Strobl and Hirzinger, ICCV Workshops 2011,
    doi:10.1109/ICCVW.2011.6130369), with a prior for print, flatness and bow. Paper and printers
    err smoothly: errors of neighbouring points are alike, and hardly vanish in the mean of all
    points. With ``smooth``, such errors are polynomials over the board with priors of their own.
    The standard deviations of all are estimated from the errors that were found
    (``estimated_prior``). Otherwise they would be taken as independent in every pose, and the
    covariance would be too small.
    """
    corners = corners_of(sightings)
    shape = BoardShape(
        np.zeros(BOW_SIZE), np.zeros(SMOOTH_SIZE), np.zeros((corners.board_points, OFFSET_SIZE))
    )
    state = State(rig, tuple(poses), shape, tuple(further))
    free = np.ones(state.devices_size, bool) if free is None else free
    problem = _Problem(corners, free, state, prior, smooth=smooth)
    first = residuals_of(corners, state).independent
    scatter = first_scatter(first, corners.rows, problem.of_rig_and_poses, corners.camera_of)
    weighting = Weighting(scatter, None, first_prior(corners.points_mm))
    converged = False
    for _ in range(MAX_ROUNDS):
        at = problem.minimise(state, weighting)
        state = at.state
        before, weighting = weighting, problem.reweighted(at, weighting)
        if _settled(before, weighting):
            converged = True
            break
    return problem.result(problem.minimise(state, weighting), weighting, converged)


def without(sightings: Sequence[Sighting], adjusted: Adjusted, k: int, *, free: BoolMap) -> Without:
    """Fit again without the k-th pose of the board, with the same scatter, weights and prior.

    Raises
    ------
    InputError where the others do not determine the parameters.
    """
    every = corners_of(sightings)
    others = [
        s if s.pose is None else replace(s, pose=s.pose - int(s.pose > k))
        for n, s in enumerate(sightings)
        if every.pose_of[n] != k
    ]
    left_out = every.pose == k
    poses = tuple(T for n, T in enumerate(adjusted.poses) if n != k)
    state = State(adjusted.rig, poses, adjusted.shape, adjusted.further)
    # Points that only this pose shows are points of the board all the same.
    corners = corners_of(others)
    corners = replace(corners, height=every.height[~left_out], smooth=every.smooth[~left_out])
    problem = _Problem(corners, free, state, smooth=adjusted.smooth)
    weighting = adjusted.weighting.of_rows(~left_out)
    at = problem.minimise(state, weighting)
    state = at.state
    size = state.devices_size
    covariance = problem.covariance(at, weighting).shared[:size, :size]
    return Without(
        state.rig,
        state.further,
        covariance,
        board_places(every, state.shape)[left_out],
        state.shape.smooth_mm,
    )


def refit(
    sightings: Sequence[Sighting], adjusted: Adjusted, *, free: BoolMap, prior: RigPrior
) -> tuple[Rig, float, FloatMap]:
    """Fit again with another prior of the rig, and the same scatter, weights and board's prior.

    Returns
    -------
    The rig; the cost, the weighted sum of squares of all residuals and deviations from priors
    (costs of several priors can be compared); and the information of the sightings about the rig's
    parameters, without the prior, (24, 24).
    """
    state = State(adjusted.rig, adjusted.poses, adjusted.shape, adjusted.further)
    corners = corners_of(sightings)
    at = _Problem(corners, free, state, prior).minimise(state, adjusted.weighting)
    every = _Problem(corners, np.ones(free.size, bool), at.state, prior)
    information = every.normal_equations(at, adjusted.weighting, known=False).information(RIG_SIZE)
    return at.state.rig, at.cost, information


def linearised(
    corners: Corners, adjusted: Adjusted, *, free: BoolMap
) -> tuple[Residuals, NormalEquations]:
    """Residuals at an adjustment, with their derivatives, and the normal equations there."""
    state = State(adjusted.rig, adjusted.poses, adjusted.shape, adjusted.further)
    problem = _Problem(corners, free, state, smooth=adjusted.smooth)
    at = problem.evaluate(state, adjusted.weighting)
    return at.residuals, problem.normal_equations(at, adjusted.weighting)


def _settled(before: Weighting, after: Weighting) -> bool:
    """Whether scatter and prior hardly changed; far below the corners' scatter, a prior that still
    shrinks changes nothing."""
    priors = [
        np.array([w.prior.print_mm, w.prior.flat_mm, *w.prior.smooth_mm]) for w in (before, after)
    ]
    small = NEGLIGIBLE_PRIOR * after.prior.bow_mm
    return bool(
        np.allclose(after.scatter, before.scatter, rtol=SETTLED)
        and np.allclose(priors[1], priors[0], rtol=PRIOR_SETTLED, atol=small)
    )


@dataclass(frozen=True, eq=False)
class _Evaluated:
    """A state, with the residuals and the cost there."""

    state: State
    residuals: Residuals
    cost: float
    """Weighted sum of squared residuals and deviations; ∞ where a point is behind a device."""


class _Problem:
    """The corners to fit, and which of all parameters are free."""

    def __init__(
        self,
        corners: Corners,
        free_of_rig: BoolMap,
        state: State,
        prior: RigPrior | None = None,
        *,
        smooth: bool = False,
    ) -> None:
        self.corners, self.prior, self.smooth = corners, prior, smooth
        self.points = len(state.shape.offset_mm)
        self.of_rig_and_poses = int(free_of_rig.sum()) + POSE_SIZE * corners.poses
        always = np.ones(POSE_SIZE * corners.poses + BOW_SIZE, bool)
        self.free = np.concatenate((free_of_rig, always, np.full(SMOOTH_SIZE, smooth)))
        count, unknowns = len(corners.pose), self.of_rig_and_poses
        if prior is None and 4 * count <= unknowns:
            raise InputError(
                f"calibration: expected more than {unknowns // 4} corners to determine {unknowns} "
                f"parameters, got {count}"
            )

    def reweighted(self, at: _Evaluated, before: Weighting) -> Weighting:
        """Estimate scatter, weights and prior anew at a minimum."""
        covariance = self.covariance(at, before)
        J = at.residuals.jacobian * before.root[:, :, None]
        leverage = covariance.of_residuals(self.corners, J)
        determined = 2.0 - leverage.reshape(-1, 2, 2).sum(axis=2)
        independent = at.residuals.independent
        scatter = scatter_of(independent, self.corners.rows, determined, self.corners.camera_of)
        prior = before.prior
        # The first scatter comes from a rough start and says little about the board.
        if before.weights is not None:
            variance = np.diagonal(covariance.points, axis1=1, axis2=2)
            smooth = np.diag(covariance.shared)[-SMOOTH_SIZE:] if self.smooth else None
            shape, places = at.state.shape, self.corners.points_mm
            prior = estimated_prior(prior, shape, variance, smooth, places)
        return Weighting(scatter, weights_of(independent, scatter), prior)

    def evaluate(self, state: State, weighting: Weighting) -> _Evaluated:
        """Compute the residuals at a state, with their derivatives, and the cost."""
        residuals = residuals_of(self.corners, state, derivatives=True)
        precision, off = self._prior(state, weighting)
        weighted = residuals.independent * weighting.root
        cost = float(np.sum(weighted**2) + np.sum(precision * off**2))
        if self.prior is not None:
            known, change = self.prior.information(state.rig)
            cost += float(change @ known @ change)
        return _Evaluated(state, residuals, cost if np.isfinite(cost) else np.inf)

    def normal_equations(
        self, at: _Evaluated, weighting: Weighting, *, known: bool = True
    ) -> NormalEquations:
        """Normal equations of the free parameters, with the prior of the rig or without."""
        root = weighting.root
        J, r = at.residuals.jacobian * root[:, :, None], at.residuals.independent * root
        of_rig = self.prior.information(at.state.rig) if self.prior and known else None
        of_board = self._prior(at.state, weighting)
        return NormalEquations.of(self.corners, J, r, of_board, self.free, of_rig)

    def _prior(self, state: State, weighting: Weighting) -> tuple[FloatMap, FloatMap]:
        shape = state.shape
        values = np.concatenate((shape.bow_mm, shape.smooth_mm, shape.offset_mm.ravel()))
        return weighting.prior.precision(self.points), values

    def minimise(self, state: State, weighting: Weighting) -> _Evaluated:
        """Lower the cost by Levenberg–Marquardt steps with fixed scatter and weights."""
        damping = FIRST_DAMPING
        at = self.evaluate(state, weighting)
        for _ in range(MAX_LM_STEPS):
            equations = self.normal_equations(at, weighting)
            for _ in range(MAX_TRIALS):
                trial = self.stepped(at, equations, damping, weighting)
                if trial is not None and trial.cost < at.cost:
                    break
                damping = max(damping * MORE_DAMPING, MIN_RAISED_DAMPING)
            else:
                return at
            before, at, damping = at.cost, trial, damping * LESS_DAMPING
            if before - at.cost <= COST_SETTLED * before:
                break
        return at

    def stepped(
        self, at: _Evaluated, equations: NormalEquations, damping: float, weighting: Weighting
    ) -> _Evaluated | None:
        """Take a damped step; None where no devices have such parameters."""
        of_shared, of_points = equations.step(damping)
        step = np.zeros(self.free.size + of_points.size)
        step[: self.free.size][self.free] = of_shared
        step[self.free.size :] = of_points.ravel()
        state = at.state.moved(step)
        if state is None:
            return None
        with np.errstate(all="ignore"):
            return self.evaluate(state, weighting)

    def covariance(self, at: _Evaluated, weighting: Weighting) -> Covariance:
        """Covariance of all parameters; 0 where not free."""
        undetermined = InputError(
            "calibration: expected poses that determine all parameters, got too few poses or "
            "poses that are too similar; turn the board further, and move it nearer and further"
        )
        try:
            of_free = self.normal_equations(at, weighting).covariance()
        except np.linalg.LinAlgError as error:
            raise undetermined from error
        # The prior determines the board; the rig and the poses must be determined by the corners.
        n = self.of_rig_and_poses
        sigma = np.sqrt(np.maximum(np.diag(of_free.shared)[:n], 0.0))
        if not (sigma > 0).all() or (
            np.linalg.cond(of_free.shared[:n, :n] / np.outer(sigma, sigma)) > MAX_CONDITION
        ):
            raise undetermined
        return of_free.with_fixed(self.free)

    def result(self, at: _Evaluated, weighting: Weighting, converged: bool) -> Adjusted:
        """Collect the result at the minimum."""
        covariance, state = self.covariance(at, weighting).shared, at.state
        camera, projector = at.residuals.independent[:, :2], at.residuals.projector_seen
        kept = np.ones(camera.shape) if weighting.weights is None else weighting.weights
        used = np.asarray((kept > 0).all(axis=1))
        by_camera = self.corners.camera_of[self.corners.sighting]
        rms = [_rms_length(camera[used & (by_camera == k)]) for k in range(1 + len(state.further))]
        rig = Rig(
            state.rig.camera,
            state.rig.projector,
            state.rig.T_projector_camera,
            covariance[:RIG_SIZE, :RIG_SIZE],
            (rms[0], _rms_length(projector[used])),
        )
        rows = self.corners.rows
        return Adjusted(
            rig=rig,
            poses=state.poses,
            shape=state.shape,
            prior=weighting.prior,
            covariance=covariance,
            camera_residual_px=tuple(camera[r] for r in rows),
            projector_residual_px=tuple(projector[r] for r in rows),
            used=tuple(used[r] for r in rows),
            weighting=weighting,
            converged=converged,
            further=state.further,
            further_rms_px=tuple(rms[1:]),
            smooth=self.smooth,
        )


def _rms_length(residual: FloatMap) -> float:
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))
