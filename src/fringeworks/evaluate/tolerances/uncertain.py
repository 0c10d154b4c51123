"""A value of measured surfaces, freed of the noise that is left, with its standard deviation."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fringeworks.evaluate.quantified import Quantified
from fringeworks.evaluate.shares import Share, Shares, joined, total
from fringeworks.evaluate.tolerances.skins import Skin
from fringeworks.types import FloatMap

DRAWS = 60
"""Number of surfaces that are drawn: the scatter of the value is then known to a tenth, and its
mean to an eighth of it."""
LEVELS = (0.1, 1.0, 3.0)
"""Variances of added noise, in variances of the noise that points have already. The first is
small: its effect is that of the points that limit the zone now."""
POWERS = (0.5, 1.0)
"""Smallest and largest power of the noise's variance with which a range may grow: 0.5 where noise
makes the range, 1 where it only moves the place of a peak."""

Value = Callable[[Sequence[FloatMap]], float]
"""A value of some surfaces whose distances from their bodies change by (m,), mm."""


def quantified(value: Value, skins: Sequence[Skin]) -> Quantified:
    """Return a value of surfaces without what noise adds to it, and its standard deviation.

    Parameters
    ----------
    value : function
        Of the changes of the distances of each surface.
    skins : sequence of Skin

    Notes
    -----
    The value is the mean of its posterior: of likely surfaces, see ``likely``. Forms with several
    equal peaks, or with one alone, are no draws of its prior, and bias it. How much is told by a
    parametric bootstrap (Efron & Tibshirani, An introduction to the bootstrap, 1993, ch. 10): the
    mean surface is measured again, under new noise. If the mean of these values exceeds the value
    of the mean surface, the excess is subtracted. For the true form, the bias may be zero or twice
    as large, so its standard deviation is the bias itself.

    If the mean is smaller instead, smoothing has removed peaks a second time. Whether it removed as
    much the first time is not known, because likely surfaces restore what their prior expects of
    the peaks. Nothing is added, and the loss counts as a standard deviation.

    Where no spline describes a surface, see ``_of_points``. Each independent part of the
    calibration's errors moves all surfaces at once by one standard deviation to either side.
    """
    seen = value([np.zeros(len(skin.foot)) for skin in skins])
    if not all(skin.resolved for skin in skins):
        return _of_points(value, skins, seen)
    random = np.random.default_rng(0)
    likely, again = np.zeros((2, DRAWS // 2, 2))
    for k in range(DRAWS // 2):
        noises = [skin.noise(random) for skin in skins]
        for side in range(2):
            likely[k, side] = value([one.likely[side] for one in noises])
            again[k, side] = value([one.again[side] for one in noises])
    bias = float(again.mean()) - seen
    pairs = (likely - again if bias > 0.0 else likely).mean(axis=1)
    parts = (
        Share("noise", float(np.std(likely, ddof=1)), DRAWS - 1.0),
        Share("noise", float(np.std(pairs, ddof=1)) / len(pairs) ** 0.5, len(pairs) - 1.0),
        *common_shares(value, skins),
        Share("form filter", abs(bias)),
    )
    found = float(likely.mean()) - max(bias, 0.0)
    return Quantified(max(found, 0.0), joined(parts), "mm")


def _of_points(value: Value, skins: Sequence[Skin], seen: float) -> Quantified:
    """The same where the points of a surface stand for themselves.

    Notes
    -----
    What noise of variance v adds is a vᵖ, with p from 0.5 to 1: 0.5 where the range is one of
    noise, 1 where noise moves the ends of a form. Noise is added again, with the same and with
    three times its variance; the two means tell a and p, and a vᵖ is taken off (simulation
    extrapolation: Cook & Stefanski, JASA 89, 1994). The variance by noise is 2 s₀² − s₁², with the
    variances s₁² of the draws and s₀² of weak ones over their level: extrapolation counts the
    points that limit the zone now double, and takes off what the draws make of others (Stefanski &
    Cook, JASA 90, 1995).
    """
    random = np.random.default_rng(0)
    drawn = np.zeros((DRAWS // 2, 2, len(LEVELS)))
    for pair in drawn:
        noises = [skin.noise(random).likely for skin in skins]
        for side, row in enumerate(pair):
            for k, level in enumerate(LEVELS):
                row[k] = value([level**0.5 * noise[side] for noise in noises])
    small, one, _ = np.var(drawn, axis=(0, 1), ddof=1)
    scatter = float(np.sqrt(max(2.0 * small / LEVELS[0] - one, one)))
    parts = (Share("noise", scatter, DRAWS - 1.0), *common_shares(value, skins))
    share, uncertain = _share(drawn.mean(axis=(0, 1))[1:] - seen)
    share = min(share, seen)
    shares = joined((*parts, Share("form filter", uncertain)))
    return Quantified(seen - share, shares, "mm", share, total(parts))


def _share(grown: FloatMap) -> tuple[float, float]:
    """What noise has added, from how much a value grows with noise of one and of three times its
    variance more; and its standard deviation, that of a power anywhere between the two limits."""
    if not grown[0] > 0:
        return 0.0, 0.0
    most, least = (1.0 / (2.0**power - 1.0) for power in POWERS)
    growth = max(float(grown[1] / grown[0]) - 2.0, 1.0 / most)
    factor = min(max(1.0 / growth, least), most)
    return float(grown[0]) * factor, float(grown[0]) * (most - least) / 12.0**0.5


def common_shares(value: Value, skins: Sequence[Skin]) -> Shares:
    """Return the parts of σ of a value by errors that points have in common."""
    still = [np.zeros(len(skin.foot)) for skin in skins]
    sources = max((skin.sources for skin in skins), key=len)
    moves = [
        (source, [_column(skin.parts, k) for skin in skins]) for k, source in enumerate(sources)
    ]
    for number, skin in enumerate(skins):
        for column in skin.own.T:
            alone = [*still[:number], column, *still[number + 1 :]]
            moves.append((Share("neighbours", 1.0), alone))
    found = []
    for source, move in moves:
        if any(change.any() for change in move):
            up, down = (value([sign * change for change in move]) for sign in (1.0, -1.0))
            found.append(source._replace(sigma=abs(0.5 * (up - down))))
    return joined(found)


def _column(parts: FloatMap, k: int) -> FloatMap:
    return parts[:, k] if k < parts.shape[1] else np.zeros(len(parts))
