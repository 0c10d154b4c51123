"""By which changes a rig may have drifted: each fitted to poses of a board, with its evidence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, product

import numpy as np

from fringeworks.rig.calibration.adjusted import Adjusted
from fringeworks.rig.calibration.bundle import adjust, refit
from fringeworks.rig.calibration.parameters import (
    DEVICE_SIZE,
    RIG_SIZE,
    RigPrior,
    moved_rig,
    parameter_change,
)
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.types import BoolMap, FloatMap, Rig

POSSIBLE_TURN_RAD = 0.1
"""Standard deviation of the rotation in the prior of a rig that was knocked, rad: 6°. A larger turn
moves the light off the object, which nobody needs a check for."""
POSSIBLE_SHIFT = 0.1
"""The same for a translation, over the baseline."""
POSSIBLE_FOCUS = 0.05
"""The same for focal lengths, relative. Refocusing from infinity to 0.5 m makes the focal length of
a lens of 25 mm longer by 5 %."""
SIZES = 10.0 ** -np.arange(0.0, 5.0)
"""Sizes that a change may have, over the standard deviations above. All are equally probable
beforehand, because a knock may be of any size: the prior of a size is uniform in its logarithm.
The smallest (0.0006°, 3 µm on 300 mm, 5 · 10⁻⁶ of a focal length) is below what a board shows."""
SHAPES = np.array([np.diag(axes) for axes in product((1.0, 0.0), repeat=3) if any(axes)])
"""Shapes of a rotation or translation: with all three components in the axes of the projector, or
with some of them, because devices turn in their mounts and slide on rails. Without the latter, a
focal length would explain a shift along z better than the shift itself."""
SHAPE_SHARES = np.array([1 / 2, *[1 / 12] * 6])
"""Probability of each shape beforehand: as often in any direction as in particular ones."""
TOGETHER = 0.1
"""Probability beforehand that a further event has changed the rig as well, over that of one event.
Events are a knock (rotation, translation or both), a change of the camera's focal length and one of
the projector's; lenses that warm up alike are one event. With 1, a refocus was the first cause that
was named in 9 of 20 simulated knocks; with 0.1 in 1 of 20."""
SHARED_SCATTER = 2.0
"""Factor on the scatter of corners within one pose. Corners of one pose share errors (blur, light,
edges along the pixel grid), which no residual shows; between poses of real photographs the factor
is up to 3 (docs/rig.md), on the virtual rig 0.9 to 1.3."""
SMALLEST_VARIANCE = 1e-13
"""Smallest eigenvalue of a correlation matrix that is inverted; rig files hold 12 digits."""

ROTATION = slice(2 * DEVICE_SIZE, 2 * DEVICE_SIZE + 3)
"""Place of the rotation among the parameters of a rig."""
TRANSLATION = slice(2 * DEVICE_SIZE + 3, RIG_SIZE)
"""Place of the translation among the parameters of a rig."""
Causes = frozenset[str]
"""Names of causes that act together."""
CAUSES = ("rotation", "translation", "camera focus", "projector focus")
"""What may change independently of each other."""
NOTHING: Causes = frozenset()
"""No change."""
BASELINE: Causes = frozenset(("baseline",))
"""A translation along the baseline alone."""
POSE: Causes = frozenset(("rotation", "translation"))
"""Any change of the relative pose."""
FOCI: Causes = frozenset(("camera focus", "projector focus"))
"""Both focal lengths, alike or not."""
EVERYTHING: Causes = frozenset(CAUSES)
"""All changes together."""


@dataclass(frozen=True, eq=False)
class Change:
    """By how much the parameters of a rig have changed, and what they are now."""

    change: FloatMap
    """Change since the calibration, (24,)."""
    covariance: FloatMap
    """Covariance of ``change``, (24, 24)."""
    now: FloatMap
    """The parameters now, less those of the calibration, (24,). They differ from ``change`` by the
    error of the calibration that the board shows."""
    now_covariance: FloatMap
    """Covariance of ``now``, (24, 24)."""

    @classmethod
    def mean(cls, weights: FloatMap, changes: Sequence[Change]) -> Change:
        """Average over exclusive possibilities; the covariance holds their differences as well."""
        p = weights / weights.sum()
        change, covariance = _mixture(
            p, np.array([c.change for c in changes]), np.array([c.covariance for c in changes])
        )
        now = _mixture(
            p, np.array([c.now for c in changes]), np.array([c.now_covariance for c in changes])
        )
        return cls(change, covariance, *now)


def _mixture(p: FloatMap, means: FloatMap, covariances: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Mean and covariance of a mixture with the weights p (n,)."""
    mean = p @ means
    off = means - mean
    return mean, np.einsum("n,nij->ij", p, covariances) + (p * off.T) @ off


@dataclass(frozen=True, eq=False)
class Fit(Change):
    """A rig in which certain causes have acted, fitted to poses of a board."""

    freedom: int
    """Number of directions of the change."""
    cost: float
    """Weighted sum of squares of all residuals and deviations, for the largest possible changes."""
    log_evidence: float
    """Logarithm of the probability density of what was seen, averaged over all sizes and shapes of
    the change, times the probability of the causes beforehand; without a constant that all fits
    share."""
    of_largest: FloatMap
    """Covariance of the change where the largest changes are possible, (24, 24)."""


@dataclass(frozen=True, eq=False)
class Fits:
    """What every set of causes makes of poses of a board."""

    rig: Rig
    """As it was calibrated."""
    of: dict[Causes, Fit]
    scatter_px: tuple[float, float]
    """Standard deviation of the corners in camera and projector, median of the poses, px."""

    def __getitem__(self, causes: Iterable[str]) -> Fit:
        return self.of[frozenset(causes)]

    def share(self, causes: Causes) -> float:
        """Probability of a set of causes, over that of the most probable set."""
        most = max(fit.log_evidence for fit in self.of.values())
        return float(np.exp(self.of[causes].log_evidence - most))

    def mean(self, causes: Causes = NOTHING) -> Change:
        """Average by probability over all sets in which these causes act, with others or alone."""
        sets = [other for other in self.of if contains(other, causes)]
        most = max(self.of[s].log_evidence for s in sets)
        weights = np.exp([self.of[s].log_evidence - most for s in sets])
        return Change.mean(weights, [self.of[s] for s in sets])

    def adjusted(self) -> Rig:
        """Return the rig now, averaged over all sets of causes, with its covariance.

        Notes
        -----
        The board may be that of the calibration, whose errors of print are then in both. What it
        says about an unchanged rig is therefore not counted: the covariance that it took off the
        calibration's is put back.
        """
        mean = self.mean()
        now = moved_rig(self.rig, mean.now)
        assert now is not None
        again = _known(self.rig) - self.of[NOTHING].now_covariance
        structure_px = self.rig.structure_px
        return replace(now, covariance=mean.now_covariance + again, structure_px=structure_px)


def contains(causes: Causes, others: Causes) -> bool:
    """Whether a change by ``others`` is possible where ``causes`` act."""
    return others <= causes or (others == BASELINE and "translation" in causes)


def possible_changes(rig: Rig) -> dict[str, FloatMap]:
    """Return the directions in which each cause changes a rig, (24, k).

    Columns are as long as the standard deviation of the largest possible change.
    """
    unit = np.eye(RIG_SIZE)
    focus = []
    for first, device in ((0, rig.camera), (DEVICE_SIZE, rig.projector)):
        focus.append(POSSIBLE_FOCUS * unit[:, first : first + 2] @ device.focal_px)
    camera, projector = np.array(focus)[:, :, None]
    return {
        "baseline": POSSIBLE_SHIFT * unit[:, TRANSLATION] @ rig.T_projector_camera[:3, 3:],
        "rotation": POSSIBLE_TURN_RAD * unit[:, ROTATION],
        "translation": POSSIBLE_SHIFT * rig.baseline_mm * unit[:, TRANSLATION],
        "camera focus": camera,
        "projector focus": projector,
    }


def fit_changes(rig: Rig, sightings: Sequence[Sighting], poses: Sequence[FloatMap]) -> Fits:
    """Fit every set of causes to poses of a board.

    Parameters
    ----------
    rig : Rig
        As it was calibrated. Without a covariance, it is taken as exact.
    sightings : sequence of Sighting
        One or more.
    poses : sequence of (4, 4) arrays
        Start: T_camera_board of every sighting, mm.

    Notes
    -----
    The parameters of the rig now are those of the calibration, normal with its covariance C, plus
    the change A a with a standard normal: their prior is normal with C + A Aᵀ. Scatter, weights
    and the board's prior are estimated once, with every change possible. Differences of the costs
    are then those of a likelihood ratio test, χ² with as many degrees of freedom as directions.
    """
    directions = possible_changes(rig)
    sets = [frozenset(c) for k in range(len(CAUSES) + 1) for c in combinations(CAUSES, k)]
    known = _known(rig)
    A = np.hstack([directions[name] for name in CAUSES])
    all_free = known + A @ A.T
    free = np.diag(all_free) > 0
    adjusted = adjust(sightings, rig, poses, free=free, prior=RigPrior(rig, _inverse(all_free)))
    scatter = SHARED_SCATTER * adjusted.weighting.scatter
    if rig.residual_px is not None:
        # In a single pose, errors of corners look like errors of the board's print.
        scatter[:, 0] = np.maximum(scatter[:, 0], rig.residual_px[0] / np.sqrt(2.0))
    weighted = replace(adjusted, weighting=replace(adjusted.weighting, scatter=scatter))
    fits = {causes: _fit(rig, sightings, weighted, causes) for causes in (*sets, BASELINE)}
    camera, projector = np.median(adjusted.scatter_px, axis=0)
    return Fits(rig, fits, (float(camera), float(projector)))


def _fit(rig: Rig, sightings: Sequence[Sighting], adjusted: Adjusted, causes: Causes) -> Fit:
    """Fit a rig in which some causes may have acted.

    Notes
    -----
    The parameters are x = x₀ + L u + A a with C = L Lᵀ and standard normal u and a. With Λ the
    information of the corners about x, a has the information
    G = Aᵀ Λ B beside its prior, where B = A − L (1 + Lᵀ Λ L)⁻¹ Lᵀ Λ A is the derivative of x by a.
    For other sizes and shapes a = S b, with b standard normal (``_scales``), the evidence follows
    from G by Laplace's approximation (MacKay, Neural Computation 4, 1992,
    doi:10.1162/neco.1992.4.3.415).
    """
    directions, known = possible_changes(rig), _known(rig)
    A = np.hstack([np.zeros((RIG_SIZE, 0)), *(directions[n] for n in directions if n in causes)])
    before = known + A @ A.T
    free: BoolMap = np.diag(before) > 0
    # What is not free stays at the calibration's value.
    start = replace(adjusted, rig=replace(rig, covariance=None))
    found, cost, information = refit(
        sightings, start, free=free, prior=RigPrior(rig, _inverse(before))
    )
    moved = parameter_change(found, rig)
    values, vectors = np.linalg.eigh(known)
    L = vectors * np.sqrt(np.maximum(values, 0.0))
    most = (np.linalg.pinv(np.hstack((L, A))) @ moved)[RIG_SIZE:]
    of_rig = np.linalg.inv(np.eye(RIG_SIZE) + L.T @ information @ L)
    B = A - L @ of_rig @ (L.T @ information @ A)
    G = A.T @ (information @ B)
    scale, share = _scales(causes)
    h = G @ most + most
    across = scale.transpose(0, 2, 1)
    Q = across @ G @ scale + np.eye(A.shape[1])
    left = scale @ np.linalg.inv(Q) @ across
    a = left @ h
    log = 0.5 * (a @ h) - 0.5 * np.linalg.slogdet(Q)[1] + np.log(share)
    weights = np.exp(log - log.max())
    mean, covariance = _mixture(weights / weights.sum(), a, left)
    return Fit(
        change=A @ mean,
        covariance=A @ covariance @ A.T,
        now=moved + B @ (mean - most),
        now_covariance=L @ of_rig @ L.T + B @ covariance @ B.T,
        freedom=A.shape[1],
        cost=cost,
        log_evidence=float(log.max() + np.log(weights.sum()) - 0.5 * (cost + most @ h)),
        of_largest=A @ np.linalg.inv(G + np.eye(A.shape[1])) @ A.T,
    )


@lru_cache
def _scales(causes: Causes) -> tuple[FloatMap, FloatMap]:
    """Factors (n, k, k) that make standard normal numbers a change in units of the largest one,
    for all sizes and shapes; and their probabilities beforehand (n,), over that of one event."""
    n = len(SIZES)
    alone = SIZES[:, None, None], np.full(n, 1.0 / n)
    spatial = (
        (SIZES[:, None, None, None] * SHAPES).reshape(-1, 3, 3),
        np.tile(SHAPE_SHARES / n, n),
    )
    apart = np.array([np.diag(t) for t in product(SIZES, repeat=2)])
    alike = alone[0] * np.array([[1.0, 0.0], [1.0, 0.0]])
    both = (
        np.concatenate((apart, alike)),
        np.repeat((TOGETHER / len(apart), 1.0 / n), (len(apart), n)),
    )
    parts = [spatial] * len(causes & POSE) + [alone] * len(causes & BASELINE)
    parts += [both] if causes >= FOCI else [alone] * len(causes & FOCI)
    knocked_as_well = bool(causes & POSE and causes & FOCI)
    scale, share = np.zeros((1, 0, 0)), np.array([TOGETHER if knocked_as_well else 1.0])
    for part, own in parts:
        k, size = scale.shape[1], scale.shape[1] + part.shape[1]
        blocks = np.zeros((len(scale), len(part), size, size))
        blocks[:, :, :k, :k], blocks[:, :, k:, k:] = scale[:, None], part
        scale, share = blocks.reshape(-1, size, size), np.outer(share, own).ravel()
    return scale, share


def _known(rig: Rig) -> FloatMap:
    """Covariance of a rig; 0 where it states none."""
    return np.zeros((RIG_SIZE, RIG_SIZE)) if rig.covariance is None else rig.covariance


def _inverse(covariance: FloatMap) -> FloatMap:
    """Invert a covariance; parameters without a variance get zeros."""
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0, 1.0 / np.where(sigma > 0, sigma, 1.0), 0.0)
    free = sigma > 0
    found = np.zeros_like(covariance)
    values, vectors = np.linalg.eigh((covariance * np.outer(scale, scale))[np.ix_(free, free)])
    kept = vectors / np.sqrt(np.maximum(values, SMALLEST_VARIANCE * max(values.max(initial=0), 1)))
    found[np.ix_(free, free)] = kept @ kept.T
    return np.asarray(found * np.outer(scale, scale))
