"""Ratios of the fringe periods of several sets, as the lines of a sample show them.

From one pixel of a line to another, the phases of all sets turn by the same distance on the
projector over their periods. The ratio of two phases' turns is therefore that of the frequencies,
whatever the scene, and whatever the start of the steps. It is negative where a set runs backwards.
"""

from __future__ import annotations

from dataclasses import dataclass

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

WIDEST = 0.3
"""The same for a deviation that is certainly no rounded period: where it fits better, the frames
are of another plan."""

FEWEST = 300
"""Smallest number of pairs for a statement."""

ALIKE_TURNS = 0.06
"""Largest scatter of the turns of a set, turns: unrelated phases have 0.37, and those of a set with
a wrong frame about 0.1."""

CLEAR_TURNS = 0.03
"""The same for a period that is refused without a look at other causes. Three steps of which one
has 0.7 times the exposure scatter by 0.04 or more; noise of a tenth of the modulation by 0.02."""

ALIKE_SHARE = 0.6
"""Smallest share of the pairs within that scatter; the others lie across edges of the depth, where
whole turns of the reference are unknown."""

GRID_TURNS = 0.05
"""Distance of the rates that are tried, in turns of the farthest pixels: less than the scatter."""

PASSES = 4
"""Least-squares fits after one another, each without the pairs that the last one left out."""

OUTLYING = 3.0
"""Deviation of a pair from which on it is left out, standard deviations."""

SMALLEST = 1e-6
"""Smallest scatter of rendered frames, turns."""

FEWEST_FRINGES = 2.0
"""Fewest fringes of a set in the view: of less, a wrong frame changes the turns like a period."""

FEWEST_TURNS = 0.3
"""Smallest turns of a set between two pixels, rms, for the same reason."""

CLEAR_SIGMAS = 5.0
"""Standard deviations by which a ratio differs clearly from the plan's."""

RIPPLE_RAD = 0.4
"""Change of a phase's ripple over a part of a fringe that a response which is not linear (γ 2.2)
makes, rad. Over whole fringes it averages out."""

SYSTEMATIC = 5e-4
"""Relative error of a ratio that is no noise: periods that are rounded to four digits."""

SAME_RATIO = 0.2
"""Relative difference of two deviations that have one cause."""


@dataclass(frozen=True)
class Ratio:
    """Frequency of a set over that of the reference, relative to the plan's."""

    of_set: int
    reference: int
    value: float
    """1 expected; negative for a set that runs backwards."""
    sigma: float
    """Its standard deviation, with what ripple may add."""
    skewed: float
    """What errors that depend on the phase may add: they are not symmetric, and the median of the
    pairs may be off by their size. Infinite where the turns scatter more than noise makes them."""

    def off(self, *, clear: bool) -> float:
        """Deviation of its size from the plan's where it is larger than its error and no larger
        than a rounded period makes it, else 0; ``clear`` for no other cause that is likely."""
        off = abs(self.value) - 1.0
        least = CLEAR_SIGMAS * self.sigma + SYSTEMATIC + (self.skewed if clear else 0.0)
        return off if least < abs(off) < SEARCHED else 0.0


def ratios_of_sets(decoding: Decoding, lines: Lines) -> list[Ratio]:
    """Ratios of the frequencies of the sets to that of the set which tells them best.

    Parameters
    ----------
    decoding : Decoding
    lines : (r, l) arrays, one per frame of the plan, counts

    Returns
    -------
    One ratio for each other set whose fringes are seen; nothing for a single set.

    Notes
    -----
    For pairs of pixels at one distance, the turns Δ of the reference are added up from pixel to
    pixel. The ratio is the rate g of Δφ = g Δ, modulo whole turns, by least squares without
    outliers, from the rate whose median deviation is the smallest.
    """
    sets = decoding.sets
    if len(sets) < 2 or any(phases.line_px is not None for phases in sets):
        return []
    rows = slice(None, None, max(1, lines[0].size // MOST_PIXELS))
    waves = [wave_of(phases, [lines[k][rows] for k in phases.frames])[1] for phases in sets]
    lit = np.logical_and.reduce([_lit(wave) for wave in waves])
    steps = [np.angle(w[:, 1:] * np.conj(w[:, :-1])) / TURN for w in waves]
    pairs = lit[:, 1:] & lit[:, :-1]
    if np.count_nonzero(pairs) < FEWEST:
        return []
    usual = [quantile(np.abs(step[pairs]), 0.5) for step in steps]
    fit = [k for k, step in enumerate(usual) if step < STEEPEST_TURNS]
    if not fit:
        return []
    reference = min(fit, key=lambda k: sets[k].period_px)
    shortest, longest = LAGS[0], max(LAGS[0], int(LAGS[1] * lit.shape[1]))
    lag = int(np.clip(LAG_TURNS / max(usual[reference], 1e-9), shortest, longest))
    turns, known = _turns(steps[reference], lit, lag)
    fringes = float(np.max(np.sum(np.abs(np.where(pairs, steps[reference], 0.0)), axis=1)))
    found = []
    for k, wave in enumerate(waves):
        if k == reference or np.count_nonzero(known) < FEWEST:
            continue
        share = sets[reference].period_px / sets[k].period_px
        turned = (wave[:, lag:] * np.conj(wave[:, :-lag]))[known]
        seen = _rate(turned, share * turns[known], lag, fringes * share)
        if seen is not None:
            found.append(Ratio(k, reference, *seen))
    return found


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


def _rate(
    turned: NDArray[np.complex128], expected: FloatMap, lag: int, fringes: float
) -> tuple[float, float, float] | None:
    """Rate of turned phases over the expected turns, its standard deviation, and the error by
    phases that are skewed; None where they are unrelated."""
    if fringes < FEWEST_FRINGES or float(np.mean(expected**2)) < FEWEST_TURNS**2:
        return None
    angles = np.angle(turned) / TURN

    def left(rate: float) -> FloatMap:
        off = angles - rate * expected
        return np.asarray(off - np.rint(off))

    def best(searched: float) -> float:
        count = 2 * int(np.ceil(searched * np.max(np.abs(expected)) / GRID_TURNS)) + 1
        rates = 1.0 + np.linspace(-searched, searched, count)
        spreads = {rate: robust_sigma(left(rate)) for rate in (*rates, *-rates)}
        return float(min(spreads, key=spreads.__getitem__))

    rate = best(SEARCHED)
    if abs(abs(rate) - 1.0) > SYSTEMATIC and abs(abs(best(WIDEST)) - 1.0) > SEARCHED:
        return None  # another plan
    for _ in range(PASSES):
        off = left(rate)
        scatter = max(robust_sigma(off), SMALLEST)
        kept = np.abs(off) < OUTLYING * scatter
        rate += float(np.sum((off * expected)[kept]) / np.sum(expected[kept] ** 2))
    if scatter > ALIKE_TURNS or np.mean(kept) < ALIKE_SHARE:
        return None
    free = np.count_nonzero(kept) / lag
    sigma = scatter / float(np.sqrt(free * np.mean(expected[kept] ** 2)))
    ripple = (scatter + RIPPLE_RAD / TURN / max(fringes, 1.0)) / max(fringes, 1e-9)
    skewed = scatter / float(np.sqrt(np.mean(expected[kept] ** 2)))
    skewed = skewed if scatter < CLEAR_TURNS else float("inf")
    return rate, float(np.hypot(sigma, ripple / CLEAR_SIGMAS)), skewed


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


def periods_by_ratios(decoding: Decoding, lines: Lines, *, clear: bool) -> list[tuple[int, float]]:
    """Sets that have another period than the plan says, by number, and the period, projector px:
    what explains the ratios of all sets. Of two sets, either one may be it."""
    period = [phases.period_px for phases in decoding.sets]
    found = ratios_of_sets(decoding, lines)
    off = [ratio for ratio in found if ratio.off(clear=clear)]
    if not off:
        return []
    reference, first = off[0].reference, off[0].off(clear=clear)
    common = all(abs(ratio.off(clear=clear) - first) < SAME_RATIO * abs(first) for ratio in off)
    periods = [(r.of_set, period[r.of_set] / abs(r.value)) for r in off]
    if len(off) == len(found) and common:
        scale = float(np.mean([abs(ratio.value) for ratio in off]))
        of_reference = (reference, period[reference] * scale)
        return [of_reference] if len(found) > 1 else [of_reference, *periods]
    return periods
