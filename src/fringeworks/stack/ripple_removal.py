"""Ripple of every set of a stack: measured in a sample, and taken out where frames cause it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.agreement import decode_sample
from fringeworks.stack.kernel_settings import Decoding, PhaseFrames, lit_pixels
from fringeworks.stack.noise import MIN_JUDGED_PIXELS
from fringeworks.stack.real_frames import design_rows
from fringeworks.stack.ripple import Ripple, measure_ripple, ripple_of_residuals
from fringeworks.stack.set_residuals import Known, phase_variance, set_residuals
from fringeworks.statistics.quantiles import median
from fringeworks.types import FloatMap

MAX_ORDER = 8
"""Highest order of a ripple that is looked for, periods per fringe; higher ones are weak."""

MAX_RIPPLE_NOISE_RAD = 0.2
"""Largest phase noise of a pixel that a ripple is measured from, rad. An empirical choice: noisier
pixels only add noise."""

RIPPLE_PASSES = 2
"""Passes of taking a ripple out. One leaves the square of a ripple in radians, the second nothing
that matters."""

LONGER = 2.0
"""Period over the finest one from which on a ripple must not contradict the other sets. The finest
set, which determines the coordinate, has errors of its own: in shares of a longer fringe they are
at most half as large."""


def without_ripples(
    decoding: Decoding, lines: list[NDArray[Any]], planes: list[NDArray[Any]], known: Known
) -> tuple[Decoding, list[Ripple | None]]:
    """The decoding without the ripple that steps and gains make, and the ripple of every set.

    The ripple of a set is measured along lines. Where they hold too few of its fringes, it is that
    of the differences from the other sets.
    """
    ripples: list[Ripple | None] = [None] * len(decoding.sets)
    changed = set(range(len(decoding.sets)))
    for _ in range(RIPPLE_PASSES):
        maps = decode_sample(decoding, lines, known.noise, known.limits.open)
        for k in changed:
            ripples[k] = line_ripple(decoding.sets[k], maps, k, known)
        if len(decoding.sets) > 1:
            ripples = _with_set_ripples(decoding, planes, known, ripples, changed)
        # A set that has no such ripple stays as it is, and so does its ripple.
        changed = {k for k in changed if _removable(ripples[k])}
        if not known.estimate_steps or not changed:
            break
        sets = [
            replace(phases, design=_without_ripple(phases, ripple))
            if k in changed and ripple is not None
            else phases
            for k, (phases, ripple) in enumerate(zip(decoding.sets, ripples, strict=True))
        ]
        decoding = replace(decoding, sets=tuple(sets))
    return decoding, ripples


def _removable(ripple: Ripple | None) -> bool:
    return ripple is not None and any(ripple.significant(order) != 0 for order in (1, 2))


def _orders(phases: PhaseFrames) -> tuple[int, ...]:
    """Orders of a ripple that wrong frames or a response that is not linear can make."""
    steps = len(phases.frames)
    return tuple(sorted({1, 2, 3, 4, steps, min(2 * steps, MAX_ORDER)}))


def line_ripple(phases: PhaseFrames, maps: dict[str, Any], k: int, known: Known) -> Ripple | None:
    """Ripple of a set along lines; None where they hold too few fringes."""
    modulation, background = maps["modulations"][k], maps["background"]
    with np.errstate(invalid="ignore"):  # pixels that are not finite
        sigma = np.sqrt(phase_variance(phases, modulation, background, known.noise))
        bright = lit_pixels(maps) & (sigma < MAX_RIPPLE_NOISE_RAD)
    if not bright.any():
        return None
    turns = np.where(bright, maps["phases"][k] / TURN, 0.0)
    found = measure_ripple(turns, bright, sigma, _orders(phases))
    if found is None:
        return None
    return replace(found, background_ratio=median(background[bright] / modulation[bright]))


def _with_set_ripples(
    decoding: Decoding,
    planes: list[NDArray[Any]],
    known: Known,
    ripples: list[Ripple | None],
    changed: set[int],
) -> list[Ripple | None]:
    """The ripples, with those of the ``changed`` sets that lines do not show, or show wrongly, from
    the residuals of the sets.

    A crease that crosses the lines at the same phase, as that of a groove, looks like a ripple of
    long fringes there. The sets do not disagree by it.
    """
    finest = min(phases.period_px for phases in decoding.sets)
    doubtful = [k for k in sorted(changed) if ripples[k] is None]
    doubtful += [k for k in _seen(ripples, changed) if decoding.sets[k].period_px > LONGER * finest]
    if not doubtful:
        return ripples
    residuals, _, maps = set_residuals(decoding, planes, known)
    if residuals.shape[1] < MIN_JUDGED_PIXELS:
        return ripples
    used = maps["used"]
    out = list(ripples)
    for k in doubtful:
        phase = maps["phases"][k][used].astype(np.float64)
        residual = TURN * residuals[k].astype(np.float64)
        seen = out[k]
        if seen is not None and _lessens(seen, phase, residual):
            continue
        ratio = median(maps["background"][used] / maps["modulations"][k][used])
        found = ripple_of_residuals(phase, residual, _orders(decoding.sets[k]))
        out[k] = None if found is None else replace(found, background_ratio=ratio)
    return out


def _seen(ripples: list[Ripple | None], sets: set[int]) -> list[int]:
    """Sets with a significant ripple."""
    return [
        k
        for k in sorted(sets)
        if (r := ripples[k]) is not None and any(r.significant(order) != 0 for order in r.orders)
    ]


def _lessens(ripple: Ripple, phase_rad: FloatMap, residual_rad: FloatMap) -> bool:
    """Whether the residuals of a set are smaller without its significant harmonics."""
    z = np.array([ripple.significant(order) for order in ripple.orders])
    series = [0.0, *np.stack((z.real, z.imag), axis=-1).ravel().tolist()]
    left = _core.without_series(phase_rad, residual_rad, list(ripple.orders), series)
    return median(np.abs(left)) < median(np.abs(residual_rad))


def _without_ripple(phases: PhaseFrames, ripple: Ripple) -> tuple[tuple[float, float, float], ...]:
    """The design whose fits do not have the ripple of one and two per fringe.

    A fit that mixes A, c and s shifts the phase by (A/B)(ν cos φ − μ sin φ) + ζ cos 2φ − γ sin 2φ,
    where μ and ν are the shares of A in c and s, and (γ, ζ; ζ, −γ) mixes c and s.
    """
    once, twice = ripple.significant(1), ripple.significant(2)
    if once == 0 and twice == 0:
        return phases.design
    nu, mu = once.real / ripple.background_ratio, -once.imag / ripple.background_ratio
    zeta, gamma = twice.real, -twice.imag
    mixing = np.array([[1.0, 0.0, 0.0], [mu, 1.0 + gamma, zeta], [nu, zeta, 1.0 - gamma]])
    return design_rows(np.array(phases.rows) @ mixing)
