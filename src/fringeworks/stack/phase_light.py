"""Ripple of a response and of wrong frames from how the brightness of fringes changes with phase.

A response that is not linear adds harmonics to the fringes. In sets of few steps, they move the
phase, and change the modulation and the background with it, N times per fringe. Wrong frames, as
those in light of the room that flickers, do the same once and twice per fringe, in sets of any
number of steps. Surfaces change the brightness as well, but not in step with the fringes: whatever
the relief, and wherever the fringes lie.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.signal.phase_table import TABLE_BINS
from fringeworks.stack.fits import gram, parts_of_orders, times
from fringeworks.stack.phase_spread import ALIKE, PLACES, Evidence, mean_of, spread_of
from fringeworks.stack.ripple import (
    LINES_NOISE_ALONE,
    MIN_PLACES,
    STEP_RIPPLE_RAD,
    Ripple,
    usual_rad,
)
from fringeworks.types import BoolMap, FloatMap

MOST_STEPS = 4
"""Largest number of steps whose ripple the brightness tells. With five and more, what steps leave
of a fringe shows the harmonics of usual responses, and their ripple is small."""

NEXT_OF_ODD, NEXT_OF_EVEN = 0.4, 0.2
"""Standard deviation of the harmonic N + 1 of a response, in units of that of N − 1, or of N if N
is odd and the harmonic smaller. Of power laws from 0.45 to 2.8, S-shaped and clipped curves, it is
0.1 to 0.7 for three steps, and 0 to 0.4 for four. A curve that is odd about its middle has no even
harmonics: they do not limit the odd ones."""

FRAME_ORDERS = (1, 2)
"""Orders of what wrong frames make: steps, gains, and light of the room that flickers."""

MOST_ALIKE = 1e4
"""Largest condition number of the regression, beyond which the phases are too alike."""

TINY_RAD = 1e-9
"""Divides instead of an error of zero, rad."""


SPREAD_RAD = 0.005
"""Error of a ripple by the brightness from which on the spread of the phases is looked at as well,
rad: its own error is seldom smaller."""

PART = 4
"""Smallest number of pixels of a part along the lines: neighbours are not independent."""

MIN_PIXELS = 200
"""Smallest number of pixels that tell a ripple: noise of the modulation of 0.1 leaves 0.01."""


@dataclass(frozen=True)
class Light:
    """What a set shows at pixels of lines, (r, l), beside what other frames show there."""

    phase_rad: FloatMap
    """Wrapped phases, rad."""
    used: BoolMap
    """Pixels that every phase would show clearly, by the other frames."""
    modulation: FloatMap
    """Modulation over that of the other frames: free of what the surface reflects."""
    mean: FloatMap
    """Mean of the set's samples less that of the other frames, over their modulation."""
    fringe: FloatMap | None = None
    """Number of the fringe that each pixel sees, NaN where it is not known; None where the other
    frames are those of other sets: frames that are wrong themselves."""


def with_light(
    ripple: Ripple, light: Light, steps: int, table_turns: NDArray[np.float64]
) -> Ripple | None:
    """Combine a ripple along lines with that from the brightness of the fringes.

    Parameters
    ----------
    ripple : Ripple
        What is left along lines, unless the surface is smooth: then lines tell it by themselves.
    light : Light
        Of a set of at most ``MOST_STEPS`` steps.
    steps : int
        Number of steps N.
    table_turns : (256,) float array
        Phase errors that the phases are already without, turns.

    Returns
    -------
    Ripple, optional
        The mean of the brightness, the lines and the spread of the phases, weighted by the inverse
        of their variances, in the orders that a response makes. Without what contradicts the
        brightness, and without lines that show it at few places only, where relief looks like
        ripple. None where the brightness tells nothing.

    Notes
    -----
    With harmonics c_k of the response, in units of the first one, N steps measure
    B e^{iφ} (1 + c_{N−1} e^{−iNφ} + c_{N+1} e^{iNφ}): the phase is off by −(c_{N−1} − c_{N+1}) sin
    Nφ, and the logarithm of the modulation by (c_{N−1} + c_{N+1}) cos Nφ. c_{N+1} is not seen by
    itself: c_N, which the mean shows, limits it where N is odd. What is expected of a response is
    what it usually has, and what is seen.
    """
    response = [k for k, order in enumerate(ripple.orders) if order % steps == 0]
    power = np.array([ripple.orders[k] // steps for k in response])
    regression = _Regression.of(light, steps)
    if regression is None:
        return None
    seen = _of_response(regression, light, steps, power, table_turns)
    lines = Evidence(ripple.phasors_rad[response], ripple.errors_rad[response], ripple.places)
    counted = [lines] if ripple.places >= PLACES else []
    if seen.errors_rad[0] > SPREAD_RAD:
        spread = spread_of(ripple, light.phase_rad, light.used, steps)
        counted += [spread] if spread is not None else []
    few = ripple.places < MIN_PLACES and ripple.excess > LINES_NOISE_ALONE
    every = np.zeros_like(ripple.phasors_rad) if few else ripple.phasors_rad.copy()
    every[response], errors = mean_of([seen, *(one for one in counted if _alike(one, seen))])
    expected = ripple.errors_rad.copy()
    expected[response] = 0.0  # a response is usual: what is expected of it counts
    error = float(np.hypot.reduce(errors))
    told = replace(ripple, phasors_rad=every, errors_rad=expected, error_rad=error, told_rad=error)
    return _with_frames(told, ripple, regression)


def with_frames(ripple: Ripple, light: Light, steps: int) -> Ripple:
    """Replace a ripple along lines by that of wrong frames from the brightness of the fringes.

    Parameters
    ----------
    ripple : Ripple
        Of a set of more than ``MOST_STEPS`` steps, along lines that are rough.
    light : Light
    steps : int
        Number of steps N.

    Returns
    -------
    Ripple
        That of one and two per fringe. The same as before where the brightness tells nothing.
    """
    regression = _Regression.of(light, steps) if _rough(ripple) else None
    if regression is None or regression.fringes is None:
        return ripple
    nothing = np.zeros_like(ripple.phasors_rad)
    told = replace(ripple, phasors_rad=nothing, error_rad=0.0, told_rad=0.0)
    return _with_frames(told, ripple, regression)


def _rough(ripple: Ripple) -> bool:
    """Whether lines are so rough, or so short, that they do not show the low orders."""
    return ripple.excess > LINES_NOISE_ALONE or not ripple.places


def _with_frames(ripple: Ripple, lines: Ripple, regression: _Regression) -> Ripple:
    """The ripple with what wrong frames make, of one and two per fringe, by the brightness.

    Frames that show A (μ, ν) besides c and s, as of light of the room that flickers, move the phase
    by (A/B)(ν cos φ − μ sin φ), and the logarithm of the modulation by (A/B)(μ cos φ + ν sin φ).
    Mixing of c and s does the same, twice per fringe. Lines that show it at many places, and agree,
    count as well. What is expected is what frames usually make, and what is seen.
    """
    if regression.fringes is None or not _rough(lines):
        return ripple
    at = [ripple.orders.index(order) for order in FRAME_ORDERS]
    seen = regression.of_frames()
    counted = [seen]
    if lines.places >= MIN_PLACES:
        along = Evidence(lines.phasors_rad[at], lines.errors_rad[at], lines.places)
        counted += [along] if _alike(along, seen) else []
    found, errors = mean_of(counted)
    usual = np.maximum(STEP_RIPPLE_RAD, np.abs(found)) ** 2
    share = usual / (usual + errors**2)
    phasors, expected = ripple.phasors_rad.copy(), ripple.errors_rad.copy()
    phasors[at], expected[at] = share * found, 0.0
    error = float(np.hypot.reduce([ripple.error_rad, *(share**0.5 * errors)]))
    return replace(
        ripple, phasors_rad=phasors, errors_rad=expected, error_rad=error, told_rad=error
    )


def _alike(one: Evidence, other: Evidence) -> bool:
    """Whether two measurements of the lowest order agree."""
    off = abs(one.phasors_rad[0] - other.phasors_rad[0])
    return bool(off < ALIKE * np.hypot(one.errors_rad[0], other.errors_rad[0]))


def _of_response(
    regression: _Regression,
    light: Light,
    steps: int,
    power: NDArray[np.intp],
    table_turns: NDArray[np.float64],
) -> Evidence:
    """What is left of the ripple of a response, of N, 2N, … per fringe, by the brightness."""
    size, error = _harmonic(regression, light, steps)
    total = np.asarray(1j * (-1.0) ** power * size**power / power, np.complex128)
    errors = np.maximum(error * np.abs(size) ** (power - 1), TINY_RAD)
    return Evidence(total - _of_table(table_turns, steps * power), errors, regression.places)


def _of_table(table_turns: NDArray[np.float64], orders: NDArray[np.intp]) -> FloatMap:
    """Phasors of the errors in a table, over the true phases, rad."""
    corrected = TURN * ((np.arange(TABLE_BINS) + 0.5) / TABLE_BINS - 0.5 - table_turns)
    phase = TURN * (np.arange(4 * TABLE_BINS) / (4 * TABLE_BINS) - 0.5)
    error = np.interp(phase, corrected, TURN * table_turns, period=TURN)
    return np.array([2.0 * np.mean(error * np.exp(1j * k * phase)) for k in orders])


@dataclass(frozen=True)
class _Regression:
    """Logarithm of the modulation, and mean of the samples, over harmonics of the phase."""

    orders: tuple[int, ...]
    coefficients: FloatMap
    """(2, 1 + 2 K): a constant, and cosine and sine of every order."""
    variance: FloatMap
    """The same: squared standard errors, by the scatter over places; 0 for those not needed."""
    places: int
    """Number of parts along the lines that pixels are in."""
    fringes: int | None
    """Number of fringes that pixels see; None where they are too few for a statement."""

    def at(self, order: int) -> slice:
        """Where cosine and sine of an order are."""
        first = 1 + 2 * self.orders.index(order)
        return slice(first, first + 2)

    def of_frames(self) -> Evidence:
        """Ripple of one and two per fringe, that of wrong frames."""
        places = [self.at(order) for order in FRAME_ORDERS]
        pairs = np.array([self.coefficients[0, at] for at in places])
        variance = np.array([self.variance[0, at].max() for at in places])
        errors = np.maximum(variance**0.5, TINY_RAD)
        return Evidence(pairs[:, 1] - 1j * pairs[:, 0], errors, self.places)

    @classmethod
    def of(cls, light: Light, steps: int) -> _Regression | None:
        """None where pixels are too few, or their phases too alike."""
        kept = light.used
        starts = _starts(kept)
        counts = np.add.reduceat(kept.astype(int), starts, axis=1)
        places, lines = (int(np.count_nonzero(counts.sum(axis=k))) for k in (0, 1))
        if counts.sum() < MIN_PIXELS or min(places, lines) < MIN_PLACES:
            return None
        orders = (*FRAME_ORDERS, steps, 2 * steps)
        waves = parts_of_orders(np.exp(1j * light.phase_rad[kept].astype(np.float64)), orders)
        waves = np.concatenate((np.ones((1, waves.shape[1])), waves))
        products = gram(waves)
        if np.linalg.cond(products) > MOST_ALIKE:
            return None
        seen = np.stack((np.log(light.modulation[kept], dtype=float), light.mean[kept]))
        seen -= np.median(seen, axis=1, keepdims=True)
        inverse = np.linalg.inv(products)
        coefficients = times(seen, waves.T) @ inverse
        left = seen - times(coefficients, waves)
        told = slice(1, 1 + 2 * orders.index(2 * steps))
        weights = times(inverse[told], waves)
        scores = np.zeros((2 * len(weights), *kept.shape))
        scores[:, kept] = (left[:, None] * weights).reshape(2 * len(weights), -1)
        pieces = np.add.reduceat(scores, starts, axis=2)
        # Neither neighbours along a line nor lines next to each other are independent.
        scatter = [
            np.sum(pieces.sum(axis=axis) ** 2, axis=1) * count / (count - 1.0)
            for axis, count in ((1, places), (2, lines))
        ]
        variance = np.zeros_like(coefficients)
        variance[:, told] = np.sum(scatter, axis=0).reshape(2, -1)
        low = 2 * len(FRAME_ORDERS)
        between, fringes = _between_fringes(light, scores[:low])
        variance[0, 1 : 1 + low] = np.maximum(variance[0, 1 : 1 + low], between)
        return cls(orders, coefficients, variance, places, fringes)


def _starts(kept: BoolMap) -> NDArray[np.intp]:
    """Where the parts along lines begin: those that pixels are in, however narrow the body."""
    columns = np.flatnonzero(kept.any(axis=0))
    first, end = (columns[0], columns[-1] + 1) if columns.size else (0, kept.shape[1])
    parts = int(np.clip((end - first) // PART, MIN_PLACES, PLACES))
    return np.linspace(first, max(end, first + parts), parts, endpoint=False).astype(np.intp)


def _between_fringes(light: Light, scores: FloatMap) -> tuple[FloatMap, int | None]:
    """Squared standard errors by the scatter from fringe to fringe, and the number of fringes."""
    nothing = np.zeros(len(scores))
    if light.fringe is None:
        return nothing, None
    known = light.used & np.isfinite(light.fringe)
    _, of_pixel = np.unique(light.fringe[known], return_inverse=True)
    pixels = np.bincount(of_pixel)
    # Of unequal numbers of pixels, as many as equal ones that are known as well.
    count = int(pixels.sum() ** 2 / np.sum(pixels**2)) if pixels.size else 0
    if count < MIN_PLACES:
        return nothing, None
    sums = np.stack([np.bincount(of_pixel, score[known]) for score in scores])
    return np.asarray(np.sum(sums**2, axis=1) * count / (count - 1.0)), count


def _harmonic(regression: _Regression, light: Light, steps: int) -> tuple[float, float]:
    """Difference of the harmonics N − 1 and N + 1 of the response, and its standard error."""
    at = regression.at(steps)
    lower, odd, own = (float(value) for value in regression.coefficients[:, at].ravel()[:3])
    variance = regression.variance[:, at].ravel()
    upper = NEXT_OF_EVEN * abs(lower)
    if steps % 2:
        middle = float(np.median(light.modulation[light.used]))
        limit = (abs(own) + variance[2] ** 0.5) / middle
        upper = NEXT_OF_ODD * min(abs(lower), limit)
    # The brightness of a response is even about its maximum.
    error = variance[0] + odd**2 + (2.0 * upper) ** 2
    usual = max(usual_rad(steps, steps), abs(lower)) ** 2
    share = usual / (usual + error)
    return float(share * lower), float(share * error) ** 0.5
