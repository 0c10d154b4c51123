"""Ripple of the phases from what the sets of a stack, and its Gray code, leave of each other.

The coordinate cancels in the differences of the sets, so that the shape of the surface does not
matter. Gray-code cells that are far narrower than the fringes tell the coordinate as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.decoded_sample import decode_by_gray_code
from fringeworks.stack.fits import times
from fringeworks.stack.frames import STRETCH
from fringeworks.stack.kernel_settings import Decoding, PhaseFrames
from fringeworks.stack.noise import MIN_JUDGED_PIXELS
from fringeworks.stack.ripple import RESPONSE_ORDER, STEP_RIPPLE_RAD, Ripple, usual_rad
from fringeworks.stack.set_residuals import Known, set_residuals
from fringeworks.statistics.quantiles import MAD_TO_SIGMA, median, quantile
from fringeworks.types import FloatMap

MAX_ORDER = 12
"""Highest order of a ripple that is looked for, periods per fringe: of γ = 2.2, three steps leave
0.007 rad of higher ones."""

SET_RIPPLE_PIXELS = 12_000
"""Largest number of pixels whose sets are compared: a ripple is found to a hundredth of the noise
of a pixel; more only take time."""

BRIGHTNESS_GROUPS = 5
"""Number of groups of similar brightness that ripple is measured in: light that is reflected
between surfaces, and the camera's own response, change it with the brightness."""

MIN_SPREAD = 1.3
"""Smallest ratio of the brightness of the brightest and the darkest group. With less, and with
ripple that moves the brightness itself, all pixels are alike."""

OUTLIER_SIGMAS = 4.0
"""Residuals beyond this many standard deviations do not take part, for example wrong orders."""

PASSES = 10
"""Largest number of fits. Each uses the phases without the ripple that the fits before found."""

SETTLED_RAD = 0.01
"""Change of those phases, rms, below which another fit changes a ripple of three per fringe by less
than 3 % of itself. Without ripple, the first fit is the last."""

MAX_RESIDUAL_RAD = 0.5
"""Largest standard deviation of residuals that a ripple is measured from, rad. Residuals are known
modulo a turn; beyond, too many of them are a turn off. Empirical."""


@dataclass(frozen=True)
class SetPhases:
    """Phases of the sets of a sample, and what they leave of each other."""

    phase_rad: FloatMap
    """(M, n): phases of the coordinate."""
    residual_rad: FloatMap
    """(M, n): phases less those of the coordinate."""
    variance: FloatMap
    """(M,): usual variances of the phases by noise, rad²."""
    frequency: FloatMap
    """(M,): 1 / period of the sets, 1/px."""
    steps: tuple[int, ...]
    """Number of steps of the sets."""
    group: NDArray[np.intp]
    """(n,): number of the group of neighbouring pixels, rising."""

    def at(self, kept: NDArray[np.bool_]) -> SetPhases:
        """The same at some of the pixels."""
        return replace(
            self,
            phase_rad=self.phase_rad.compress(kept, axis=1),
            residual_rad=self.residual_rad.compress(kept, axis=1),
            group=self.group[kept],
        )

    def joined(self, off_px: FloatMap, sigma_px: float) -> SetPhases:
        """The same with a coordinate of another kind as a set that has no ripple.

        Parameters
        ----------
        off_px : (n,) that coordinate less the sets' one, px
        sigma_px : its standard deviation, px
        """
        # A frequency of one rad per px, so that its phase is the coordinate.
        frequency = np.append(self.frequency, 1.0 / TURN)
        variance = np.append(self.variance, sigma_px**2)
        residual = np.vstack((self.residual_rad, off_px))
        share = frequency / variance
        # Of the joint coordinate, rad per unit of the frequency.
        shift = share @ residual / (share @ frequency)
        return SetPhases(
            np.vstack((self.phase_rad + np.outer(self.frequency, shift), 0.0 * off_px)),
            residual - np.outer(frequency, shift),
            variance,
            frequency,
            (*self.steps, 1),
            self.group,
        )

    def seen(self) -> FloatMap:
        """(M, M) matrix: what residual m shows of an error of set j, whose share in the coordinate
        is taken from all residuals."""
        share = self.frequency / self.variance
        return np.eye(len(share)) - np.outer(self.frequency, share) / (share @ self.frequency)


def ripples_of_sets(phases: SetPhases, orders: Sequence[tuple[int, ...]]) -> list[Ripple | None]:
    """Ripple of every set from the differences of the sets, whatever the surface.

    Parameters
    ----------
    phases : SetPhases
    orders : sequence of tuples of int
        Numbers of periods per fringe that each set may have.

    Returns
    -------
    list of Ripple, one per set; None where residuals are so large that they may be a turn off.

    Notes
    -----
    Least squares over all sets at once, because the coordinate contains the ripple of all. Ripple
    is a function of the true phases, from which the ripple of the coordinate is taken out, pass by
    pass: otherwise the products of the ripples of two sets look like ripple of other orders. Orders
    may look alike: several of one set where it shows a part of a fringe, or those of two sets whose
    periods have a common multiple. What the residuals do not tell stays near zero, as far as ripple
    of that order usually goes, and in the error.
    """
    if np.std(phases.residual_rad[: len(orders)], axis=1).max() > MAX_RESIDUAL_RAD:
        return [None] * len(orders)
    sums = _sums(phases.phase_rad, phases, orders)
    kept = _inliers(phases, orders, sums)
    dropped = phases.at(~kept)
    # Sums over the pixels that are kept, without those that are not.
    sums = sums - _sums(dropped.phase_rad, dropped, orders)
    phases = phases.at(kept)
    products, expected, covariance = _fitted(phases, orders, sums)
    found: list[Ripple | None] = []
    for first_row, of_set in zip(_first_rows(orders), orders, strict=True):
        at = slice(first_row, first_row + 2 * len(of_set))
        alike = products[at, at] / phases.group.size  # over the phases that were seen
        pairs = expected[at].reshape(-1, 2)
        unsure = float(np.sum(covariance[at, at] * alike))
        # What is unsure of the phase turns into other orders where ripple changes with the phase.
        slope = 0.5 * float(np.sum(np.repeat(of_set, 2) ** 2 * expected[at] ** 2))
        variance = np.diag(covariance)[at].reshape(-1, 2).max(axis=1) + slope * unsure
        found.append(
            Ripple(
                of_set,
                pairs[:, 0] + 1j * pairs[:, 1],
                # A response is usual: what is expected of it counts. Steps and gains need evidence.
                np.where(np.array(of_set) < RESPONSE_ORDER, np.sqrt(variance), 0.0),
                1.0,
                error_rad=unsure**0.5,
                all_rad=float(expected[at] @ alike @ expected[at]) ** 0.5,
            )
        )
    return found


def _inliers(
    phases: SetPhases, orders: Sequence[tuple[int, ...]], sums: FloatMap
) -> NDArray[np.bool_]:
    """Pixels whose residuals a first fit explains."""
    _, first, _ = _expected(phases.phase_rad, phases, orders, sums)
    left = np.abs(phases.residual_rad - _explained(phases.phase_rad, phases, orders, first))
    limit = OUTLIER_SIGMAS * MAD_TO_SIGMA * np.array([[median(row)] for row in left])
    return np.asarray(np.all(left <= limit, axis=0))


def _fitted(
    phases: SetPhases, orders: Sequence[tuple[int, ...]], sums: FloatMap
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Products of the waves at the true phases, expected coefficients and covariance.

    Where sets show hardly more than a fringe, orders look alike, and fits may run away from pass to
    pass. They are those of the first one where orders of steps and gains grow beyond usual ones.
    """
    first = last = _expected(phases.phase_rad, phases, orders, sums)
    taken, phase = first[1], phases.phase_rad
    for _ in range(PASSES):
        phase, before = _true_phases(phase, phases, orders, taken), phase
        if np.std(phase - before) < SETTLED_RAD:
            break
        last = _expected(phase, phases, orders, _sums(phase, phases, orders))
        taken = 0.5 * (taken + last[1])  # whole steps go too far
    low = np.concatenate([np.repeat(of_set, 2) < RESPONSE_ORDER for of_set in orders])
    sizes = [float(np.sum(one[1][low] ** 2)) for one in (first, last)]
    usual = 0.5 * np.count_nonzero(low) * STEP_RIPPLE_RAD**2
    return first if sizes[1] > max(sizes[0], usual) else last


def _waves(phase_rad: FloatMap, orders: Sequence[tuple[int, ...]]) -> _core._SetWaves:
    """Cosines and sines of all orders of all sets, p functions, as the kernels take them."""
    return {"phase": phase_rad[: len(orders)], "orders": orders}


def _true_phases(
    phase_rad: FloatMap,
    phases: SetPhases,
    orders: Sequence[tuple[int, ...]],
    coefficients: FloatMap,
) -> FloatMap:
    """Phases of the coordinate without its ripple, (M, n), rad."""
    share = (phases.frequency / phases.variance)[: len(orders)]
    total = phases.frequency @ (phases.frequency / phases.variance)
    own = _core.ripple_values(_waves(phase_rad, orders), coefficients)
    return np.asarray(phases.phase_rad - np.outer(phases.frequency, share @ own / total))


def _first_rows(orders: Sequence[tuple[int, ...]]) -> NDArray[np.intp]:
    """(M,) first one of every set's rows of waves, two per order."""
    rows = np.array([2 * len(of_set) for of_set in orders], np.intp)
    return np.asarray(np.cumsum(rows) - rows)


def _explained(
    phase_rad: FloatMap,
    phases: SetPhases,
    orders: Sequence[tuple[int, ...]],
    coefficients: FloatMap,
) -> FloatMap:
    """Residuals of the sets that ripple makes, (M, n), rad."""
    own = _core.ripple_values(_waves(phase_rad, orders), coefficients)
    return times(phases.seen()[:, : len(orders)], own)


def _sums(phase_rad: FloatMap, phases: SetPhases, orders: Sequence[tuple[int, ...]]) -> FloatMap:
    """Sums of the products of all pairs of waves of some phases, residuals and ones."""
    return _core.ripple_sums(_waves(phase_rad, orders), phases.residual_rad)


def _expected(
    phase_rad: FloatMap, phases: SetPhases, orders: Sequence[tuple[int, ...]], sums: FloatMap
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Products of the waves of some phases, their expected coefficients and the covariance of
    these, given the residuals.

    Waves and residuals count without their means: every set has an offset of its own.
    """
    waves, residual = _waves(phase_rad, orders), phases.residual_rad
    set_of = np.repeat(np.arange(len(orders)), [2 * len(of_set) for of_set in orders])
    count, number = len(set_of), residual.shape[1]
    products, mean = sums[:count, :count], sums[:-1, -1] / number
    central = sums[:count, :-1] - number * np.outer(mean[:count], mean)
    seen = phases.seen()
    pulling = seen.T * (1.0 / phases.variance)
    normal = central[:, :count] * (pulling @ seen)[np.ix_(set_of, set_of)]
    projected = np.einsum("pm,pm->p", central[:, count:], pulling[set_of])
    inverse = np.linalg.pinv(normal, hermitian=True)
    first = inverse @ projected
    # What the waves without their means explain: the mean of what they explain is taken out.
    left = residual - _explained(phase_rad, phases, orders, first)
    left -= left.mean(axis=1, keepdims=True)
    pulls = times(pulling[: len(orders)], left)
    # Errors of neighbouring pixels belong together: sums over groups scatter accordingly.
    scatter = _core.ripple_scores(waves, pulls, mean[:count], phases.group)
    unit = max(1.0, float(np.sum(inverse * scatter)) / count)
    sets = zip(orders, phases.steps, strict=False)  # a coordinate of another kind has no waves
    usual = np.repeat([usual_rad(k, steps) for of_set, steps in sets for k in of_set], 2)
    covariance = np.linalg.inv(normal / unit + np.diag(usual**-2.0))
    return products, covariance @ projected / unit, covariance


def orders_of(phases: PhaseFrames) -> tuple[int, ...]:
    """Orders of a ripple that wrong frames or a response that is not linear can make."""
    steps = len(phases.frames)
    return tuple(sorted({1, 2, 3, 4, *range(steps, max(MAX_ORDER, steps) + 1, steps)}))


def set_ripples(
    decoding: Decoding, planes: list[NDArray[Any]], known: Known
) -> list[Ripple | None]:
    """Ripple of every set of a sample, also by brightness.

    Parameters
    ----------
    decoding : Decoding
    planes : (1, n) arrays in the decoding's order, counts
    known : Known

    Returns
    -------
    list of Ripple, one per set; None where the sample does not tell.
    """
    nothing: list[Ripple | None] = [None] * len(decoding.sets)
    cells = _cells(decoding, planes, known)
    if len(decoding.sets) < 2 and cells is None:
        return nothing
    residuals, variances, maps = set_residuals(decoding, planes, known)
    used = np.flatnonzero(maps["used"])
    if used.size < MIN_JUDGED_PIXELS:
        return nothing
    few = slice(None, None, -(-used.size // SET_RIPPLE_PIXELS))
    used = used[few]
    coordinate = maps["coordinate"].ravel()[used].astype(np.float64)
    frequency = np.array([1.0 / phases.period_px for phases in decoding.sets])
    seen = SetPhases(
        TURN * np.outer(frequency, coordinate),
        TURN * residuals[:, few].astype(np.float64),
        TURN**2 * np.array([median(row) for row in variances]),
        frequency,
        tuple(len(phases.frames) for phases in decoding.sets),
        used // STRETCH,
    )
    kept = np.ones(used.size, bool)
    if cells is not None:
        place, sigma = (values.ravel()[used].astype(np.float64) for values in cells)
        kept = np.isfinite(place)
        if np.count_nonzero(kept) < MIN_JUDGED_PIXELS:
            return nothing
        seen = seen.at(kept).joined(place[kept] - coordinate[kept], median(sigma[kept]))
    background = maps["background"].ravel()[used][kept]
    modulations = np.stack([m.ravel()[used][kept] for m in maps["modulations"]])
    orders = [orders_of(phases) for phases in decoding.sets]
    found = _by_brightness(seen, orders, background + modulations)
    return [
        ripple and replace(ripple, background_ratio=median(background / modulation))
        for ripple, modulation in zip(found, modulations, strict=True)
    ]


def _cells(
    decoding: Decoding, planes: list[NDArray[Any]], known: Known
) -> tuple[FloatMap, FloatMap] | None:
    """Coordinates of a sample and their σ by the Gray code alone; None where its cells are too wide
    to show the ripple that is looked for."""
    gray = decoding.gray
    finest = min((phases.period_px for phases in decoding.sets), default=0.0)
    if gray is None or not (gray.inverse or gray.white_black) or gray.levels > 2:
        return None
    if gray.step_px * MAX_ORDER > finest:
        return None
    maps = decode_by_gray_code(decoding, planes, known.noise, known.limits)
    return maps["coordinate"], maps["sigma"]


def _by_brightness(
    seen: SetPhases, orders: Sequence[tuple[int, ...]], brightness: FloatMap
) -> list[Ripple | None]:
    """Ripple of the sets, with its amplitudes in groups of similar brightness, (M, n) counts."""
    found = ripples_of_sets(seen, orders)
    if not any(r is not None and r.rms_rad > r.error_rad for r in found):
        return found  # groups would show nothing either
    mean = brightness.mean(axis=0)
    limits = [quantile(mean, k / BRIGHTNESS_GROUPS) for k in range(1, BRIGHTNESS_GROUPS)]
    group = np.digitize(mean, limits)
    middles = [
        median(mean[group == k]) if (group == k).any() else 0.0 for k in range(BRIGHTNESS_GROUPS)
    ]
    if not middles[-1] > MIN_SPREAD * middles[0] > 0.0:
        return found
    parts = [ripples_of_sets(seen.at(group == k), orders) for k in range(BRIGHTNESS_GROUPS)]
    out: list[Ripple | None] = []
    for j, ripple in enumerate(found):
        groups = [(k, r) for k, part in enumerate(parts) if (r := part[j]) is not None]
        rows = [(median(brightness[j, group == k]), r.phasors_rad) for k, r in groups]
        rows.sort(key=lambda row: row[0])
        if ripple is not None and len(rows) == BRIGHTNESS_GROUPS:
            out.append(replace(ripple, by_brightness=tuple(rows)))
        else:
            out.append(ripple)
    return out
