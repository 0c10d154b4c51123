"""Periods of several sets, by how fast their phases turn along the lines of a sample.

From one pixel of a line to another, the phases of all sets turn by the same distance on the
projector over their periods. The ratio of two phases' turns is therefore that of the frequencies,
whatever the scene, and whatever the start of the steps. It is negative where a set runs backwards.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.fits import wave_of
from fringeworks.stack.kernel_settings import Decoding
from fringeworks.stack.sample import Lines
from fringeworks.statistics.quantiles import quantile, robust_sigma
from fringeworks.types import BoolMap, FloatMap

MOST_PIXELS = 6000
"""Pixels of the lines that are compared, at most. A ratio is then known to some 1e-4."""

LIT = 0.3
"""Smallest modulation of a pixel that is used, as a share of the 95th percentile. Indirect light in
shadows makes less."""

LAG_TURNS = 2.0
"""Distance of two pixels that are compared, turns of the reference: four noises of a phase are then
a hundredth of it."""

LAGS = (4, 0.17)
"""Shortest distance of two pixels, px, and the longest, as a share of the line: surfaces end."""

SMOOTH_TURNS = 0.1
"""Largest second difference of the reference between two pixels, turns: more is an edge, beyond
which its whole turns are unknown."""

STEEPEST_TURNS = 0.25
"""Largest mean step of the reference from pixel to pixel, turns: whole turns stay certain."""

SEARCHED = 0.06
"""Largest relative deviation of a frequency that is looked for: a period of 16 px that was meant as
17 px."""

FEWEST = 300
"""Smallest number of pairs for a statement."""

NOTABLE_TURNS = 0.1
"""Smallest change of the reference's phase over the view by another period, turns: less makes no
wrong order, and the ripple of a response that is not linear (γ 2.2) makes 0.06."""


PASSES = 3
"""Least-squares fits after one another, each without the pairs that the last one left out."""

OUTLYING = 3.0
"""Deviation of a pair from which on it is left out, standard deviations."""


def periods_by_ratios(decoding: Decoding, lines: Lines) -> Iterator[tuple[int, float]]:
    """Sets that may have another period than the plan says, by number, and the period, projector
    px: each set by the one that tells most, and that one by the mean of the others.
    """
    sets = decoding.sets
    if len(sets) < 2 or any(phases.line_px is not None for phases in sets):
        return
    rows = slice(None, None, max(1, lines[0].size // MOST_PIXELS))
    waves = [wave_of(phases, [lines[k][rows] for k in phases.frames])[1] for phases in sets]
    lit = np.logical_and.reduce([_lit(wave) for wave in waves])
    steps = [np.angle(w[:, 1:] * np.conj(w[:, :-1])) / TURN for w in waves]
    pairs = lit[:, 1:] & lit[:, :-1]
    if np.count_nonzero(pairs) < FEWEST:
        return
    usual = [quantile(np.abs(step[pairs]), 0.5) for step in steps]
    fit = [k for k, step in enumerate(usual) if step < STEEPEST_TURNS]
    if not fit:
        return
    reference = min(fit, key=lambda k: sets[k].period_px)
    shortest, longest = LAGS[0], max(LAGS[0], int(LAGS[1] * lit.shape[1]))
    lag = int(np.clip(LAG_TURNS / max(usual[reference], 1e-9), shortest, longest))
    turns, known = _turns(steps[reference], lit, lag)
    if np.count_nonzero(known) < FEWEST:
        return
    fringes = float(np.max(np.sum(np.abs(np.where(pairs, steps[reference], 0.0)), axis=1)))
    rates = {}
    for k, wave in enumerate(waves):
        share = sets[reference].period_px / sets[k].period_px
        if k == reference:
            continue
        turned = np.exp(1j * np.angle(wave[:, lag:] * np.conj(wave[:, :-lag])))[known]
        rate = _rate(turned, share * turns[known])
        if NOTABLE_TURNS / fringes < abs(rate - 1.0) < SEARCHED:
            rates[k] = rate
    if rates:
        fine = [sets[k].period_px ** -2.0 for k in rates]
        scale = float(np.average(list(rates.values()), weights=fine))
        yield reference, sets[reference].period_px * scale
    for k, rate in rates.items():
        yield k, sets[k].period_px / rate


def _rate(turned: NDArray[np.complex128], turns: FloatMap) -> float:
    """Turns of a set over those that the plan expects, without those across edges."""
    # Pairs count in both directions: no turns, no phase.
    both, expected = np.concatenate((turned, turned.conj())), np.concatenate((turns, -turns))
    ways = [rate_of(both, expected, sign, SEARCHED) for sign in (1.0, -1.0)]
    rate = max(ways, key=lambda found: found[1])[0]
    for _ in range(PASSES):
        off = np.angle(turned * np.exp(-1j * TURN * rate * turns)) / TURN
        kept = np.abs(off) <= OUTLYING * robust_sigma(off)
        rate += float(np.sum((off * turns)[kept]) / max(np.sum(turns[kept] ** 2), 1e-9))
    return abs(rate)


def _lit(wave: NDArray[np.complex128]) -> BoolMap:
    modulation = np.nan_to_num(np.abs(wave))
    return np.asarray(modulation > max(LIT * quantile(modulation, 0.95), 0.0))


def _turns(step: FloatMap, lit: BoolMap, lag: int) -> tuple[FloatMap, BoolMap]:
    """Turns of the reference between pixels at a distance, (r, l − lag), and where all pixels
    between are lit and smooth."""
    smooth = np.abs(np.diff(step, axis=1)) < SMOOTH_TURNS
    broken = np.zeros(lit.shape, np.int64)
    broken[:, 1:-1] = ~smooth
    broken = np.cumsum(broken + ~lit, axis=1)
    place = np.zeros(lit.shape)
    np.cumsum(np.where(np.isfinite(step), step, 0.0), axis=1, out=place[:, 1:])
    known = (broken[:, lag:] == broken[:, :-lag]) & lit[:, :-lag]
    return place[:, lag:] - place[:, :-lag], known


def rate_of(
    waves: NDArray[np.complex128], turns: FloatMap, around: float, searched: float
) -> tuple[float, float]:
    """The rate g near another one with the largest mean of waves · exp(−2πi g turns), and the
    length of that mean."""
    spread = float(np.max(np.abs(turns), initial=0.0))
    count = 2 * int(np.ceil(4.0 * searched * spread)) + 1
    rates = around + np.linspace(-searched, searched, max(count, 3))
    for _ in range(2):
        lengths = np.array([abs(np.mean(waves * np.exp(-1j * TURN * g * turns))) for g in rates])
        at = int(np.clip(np.argmax(lengths), 1, len(rates) - 2))
        low, top, high = lengths[at - 1 : at + 2]
        bend = low - 2.0 * top + high
        shift = 0.5 * (low - high) / bend if bend < 0.0 else 0.0
        step = float(rates[1] - rates[0])
        best = float(rates[at] + np.clip(shift, -1.0, 1.0) * step)
        rates = best + np.linspace(-0.5, 0.5, 5) * step
    return best, float(lengths.max())
