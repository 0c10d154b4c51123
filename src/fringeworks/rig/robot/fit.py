"""One reading of the robot's poses fitted to the board views: noise, and poses that stand out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks._lazy import scipy
from fringeworks.rig.calibration.parameters import POSE_SIZE
from fringeworks.rig.robot.estimate import (
    CONTRADICT,
    UNKNOWNS,
    Data,
    LeftOutPoses,
    Scale,
    Solution,
    left_out,
    predicted,
    scale_of,
    solved,
    solved_with_noise,
)
from fringeworks.rig.robot.motion import FLOOR_DEG, MIN_POSES, check_motion
from fringeworks.rig.robot.start import distances_mm, robust_start
from fringeworks.types import BoolMap, FloatMap, InputError, RobotNoise

FALSE_ALARM = 1e-4
"""Probability that a set of good poses is said to contradict its noise, or to hold a bad one."""
GENEROUS = 6.0
"""Distance from the start, over its median, from which on a pose is left out at first. Of Gaussian
errors in six parameters, one pose in 10⁸ is as far; those that belong come back."""
MOST_MM = 5.0
"""Largest translation noise, mm. Robots that are not calibrated are off by up to 2 mm; beyond this,
poses and views do not belong together."""
MOST_DEG = 2.0
"""The same for rotations, degrees."""
MOST_SCALE = 0.01
"""Largest deviation of the board's size by the robot's motions from its stated one. Prints and arms
are off by less; beyond it, a size or a unit is wrong."""
START_NOISE = RobotNoise(0.1, 0.02)
"""Noise from which its estimate starts: usual for robots of industry."""
ROUNDS = 20
"""Largest number of rounds in which poses are left out or come back."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit with the poses that it was made from."""

    data: Data
    """All poses."""
    used: BoolMap
    """(n,), False for poses that stand out."""
    solution: Solution
    others: LeftOutPoses
    """Every pose as those that were used predict it without itself, (n,)."""
    stated: RobotNoise | None
    """The noise that was stated."""
    contradicted: bool
    """Whether the residuals are larger than the stated noise explains."""
    turned: BoolMap
    """(n,), True for views in which the board was recognised turned by half a turn."""
    scale: Scale
    """Size of the board by the robot's motions."""

    @property
    def freedom(self) -> int:
        """Residuals minus unknowns."""
        return POSE_SIZE * int(np.count_nonzero(self.used)) - UNKNOWNS

    @property
    def estimated(self) -> bool:
        """Whether the noise comes from the residuals."""
        return self.stated is None or self.contradicted

    @property
    def noise(self) -> RobotNoise:
        """The robot's noise, stated or estimated."""
        return RobotNoise(*self.solution.noise)

    @property
    def rescaled(self) -> bool:
        """Whether the poses contradict the stated size of the board."""
        gain, freedom = self.scale.chi2, self.freedom
        if self.estimated:
            rest = max(self.solution.chi2 - gain, 1e-9) / max(freedom - 1, 1)
            return bool(scipy.stats.f.sf(gain / rest, 1, max(freedom - 1, 1)) < FALSE_ALARM)
        return bool(scipy.stats.chi2.sf(gain, 1) < FALSE_ALARM)

    @property
    def covariance(self) -> FloatMap:
        """Of the errors of X and Y, (12, 12), with what an uncertain size of the board adds."""
        total = self.widening * self.solution.covariance
        if self.rescaled:
            total = total + np.outer(self.scale.shift, self.scale.shift)
        return np.asarray(total)

    @property
    def widening(self) -> float:
        """Factor of variances whose noise is estimated: one σ still holds 68 %.

        Each of the two variances has about half of the degrees of freedom; Student's distribution.
        """
        if not self.estimated:
            return 1.0
        share = scipy.stats.norm.cdf(1.0)
        return float(scipy.stats.t.ppf(share, max(0.5 * self.freedom, 1.0)) ** 2)


def fitted(data: Data, stated: RobotNoise | None) -> Fit:
    """Fit both transforms to all poses but those that stand out.

    Raises
    ------
    InputError where the motion determines no result, and where poses and views do not belong
    together.
    """
    check_motion(data.motions, FLOOR_DEG if stated is None else stated.rotation_deg, data.mount)
    X, Y, distance = started(data)
    turned = _half_turned(data, X, Y, distance)
    if turned.any():
        data = Data(data.T_base_flange, data.seen.turned(turned), data.mount)
        X, Y, distance = started(data)
    used = distance <= GENEROUS * np.median(distance)
    least = max(MIN_POSES, len(used) // 2 + 1)
    for _ in range(ROUNDS):
        solution, contradicted = _solved(data.at(used), X, Y, stated)
        others = _others(data, used, solution)
        likely = _likely(others, used, estimated=stated is None or contradicted)
        back = ~used & likely
        worst = np.where(used & ~likely, others.chi2, 0.0)
        if back.any():
            used = used | back
        elif worst.any():
            used = used & (np.arange(len(used)) != np.argmax(worst))
        else:
            break
        if np.count_nonzero(used) < least:
            break
        X, Y = solution.X, solution.Y
    scale = scale_of(data.at(used), solution)
    fit = Fit(data, used, solution, others, stated, contradicted, turned, scale)
    _check(fit, least)
    return fit


def started(data: Data) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Both transforms, and the distance of every pose; see ``robust_start``."""
    seen = data.seen
    return robust_start(data.motions, seen.T_camera_board, seen.middle_mm, seen.radius_mm)


def _half_turned(data: Data, X: FloatMap, Y: FloatMap, distance: FloatMap) -> BoolMap:
    """Views that fit better with the board turned by half a turn, where nothing tells its sides."""
    seen = data.seen
    if not seen.half_turn:
        return np.zeros(len(seen), bool)
    other = seen.turned(np.ones(len(seen), bool)).T_camera_board
    turned = distances_mm(X[None], Y[None], data.motions, other, seen.middle_mm, seen.radius_mm)
    return np.asarray(turned[0] < distance)


def size_text(value: float, sigma: float) -> str:
    """What is said of a board whose size over the stated one is another."""
    return (
        f"{CONTRADICT}: by the robot's translations, the board has {100.0 * value:.4g} ± "
        f"{100.0 * sigma:.2g} % of its stated size; measure the board, and check the unit of the "
        "poses"
    )


def _check(fit: Fit, least: int) -> None:
    count = int(np.count_nonzero(fit.used))
    noise = fit.noise
    if count < least or noise.translation_mm > MOST_MM or noise.rotation_deg > MOST_DEG:
        median = float(np.median(fit.others.distance_mm))
        few = f"only {count} of {len(fit.used)} agree, and "
        raise InputError(
            f"{CONTRADICT}: {few if count < least else ''}the board is {median:.3g} mm from where "
            "they predict it (median); are they in the same order as the views, of the same "
            "moments, and written as stated?"
        )
    if fit.rescaled and abs(fit.scale.value - 1.0) > MOST_SCALE:
        raise InputError(size_text(fit.scale.value, fit.scale.sigma))
    data = fit.data.at(fit.used)
    of_corners = float(np.mean([np.trace(c[:3, :3]) for c in data.seen.covariance])) / 3.0
    error = float(np.hypot(noise.rotation_deg, np.degrees(np.sqrt(of_corners))))
    check_motion(data.motions, error, data.mount)


def _solved(
    data: Data, X: FloatMap, Y: FloatMap, stated: RobotNoise | None
) -> tuple[Solution, bool]:
    """The solution, and whether it contradicts the stated noise."""
    if stated is None:
        return solved_with_noise(data, X, Y, START_NOISE.variances), False
    found = solved(data, X, Y, np.maximum(stated.variances, np.finfo(float).tiny))
    freedom = POSE_SIZE * len(data.seen) - UNKNOWNS
    if scipy.stats.chi2.sf(found.chi2, freedom) >= FALSE_ALARM:
        return found, False
    start = np.maximum(stated.variances, 0.01 * START_NOISE.variances)
    larger = solved_with_noise(data, found.X, found.Y, start)
    variances = np.maximum(larger.variances, stated.variances)
    return solved(data, larger.X, larger.Y, variances), True


def _others(data: Data, used: BoolMap, solution: Solution) -> LeftOutPoses:
    """All poses as those that were used predict them."""
    kept = data.at(used)
    inside, outside = left_out(kept, solution), predicted(data, solution)
    found = []
    for name in ("chi2", "distance_mm", "sigma_mm"):
        values = getattr(outside, name).copy()
        values[used] = getattr(inside, name)
        found.append(values)
    return LeftOutPoses(*found)


def _likely(others: LeftOutPoses, used: BoolMap, *, estimated: bool) -> BoolMap:
    """Poses that noise explains, by Fisher's F where the noise is estimated."""
    freedom = POSE_SIZE * int(np.count_nonzero(used)) - UNKNOWNS
    if not estimated:
        share = scipy.stats.chi2.sf(others.chi2, POSE_SIZE)
    else:
        # The pose itself is in the estimate where it was used.
        rest = np.maximum(0.5 * (freedom - POSE_SIZE * used), 1.0)
        value = others.chi2 / POSE_SIZE
        own = np.where(used, np.maximum(0.5 * freedom - 0.5 * others.chi2, 1e-9) / rest, 1.0)
        share = scipy.stats.f.sf(value / own, POSE_SIZE, rest)
    return np.asarray(share * len(used) >= FALSE_ALARM)
