"""A value of measured surfaces, freed of the noise that is left, with its standard deviation."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fringeworks.evaluate.quantified import Quantified
from fringeworks.evaluate.shares import Share, Shares, joined, total
from fringeworks.evaluate.tolerances.skins import Skin
from fringeworks.types import FloatMap

DRAWS = 40
"""Number of times that noise is added at each level: the scatter of the value is then known to a
ninth, and its mean to a sixth of it."""
LEVELS = (0.1, 1.0, 3.0)
"""Variances of added noise, in variances of the noise that is in the surface already. The first is
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
    What noise of variance v adds is a vᵖ, with p from 0.5 to 1: 0.5 where the range is one of
    noise, 1 where noise moves the ends of a form. The noise that the smooth surface still has is
    drawn from its covariance and added again, with the same and with three times its variance; the
    two means tell a and p, and a vᵖ is taken off (simulation extrapolation: Cook & Stefanski, JASA
    89, 1994). The variance by noise is 2 s₀² − s₁², with the variances s₁² of the draws and s₀²
    of weak ones over their level: extrapolation counts the points that limit the zone now double,
    and takes off what the draws make of others (Stefanski & Cook, JASA 90, 1995). It is raised by
    the form that the choice of the spline cannot see. Each independent part of the calibration's
    errors moves all surfaces at once by one standard deviation to either side.
    """
    seen = value([np.zeros(len(skin.foot)) for skin in skins])
    random = np.random.default_rng(0)
    drawn = np.zeros((DRAWS // 2, 2, len(LEVELS)))
    for pair in drawn:
        noises = [skin.noise(random) for skin in skins]
        for side, row in zip((1.0, -1.0), pair, strict=True):
            for k, level in enumerate(LEVELS):
                row[k] = value([side * level**0.5 * noise for noise in noises])
    small, one, _ = np.var(drawn, axis=(0, 1), ddof=1)
    unseen = max(skin.unseen for skin in skins)
    scatter = float(np.sqrt(max(2.0 * small / LEVELS[0] - one, one)))
    parts = (
        Share("noise", scatter, DRAWS - 1.0),
        *common_shares(value, skins),
        Share("form filter", scatter * float(np.sqrt(unseen)), DRAWS - 1.0),
    )
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
