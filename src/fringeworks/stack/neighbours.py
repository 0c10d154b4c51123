"""Fringe orders that noise leaves ambiguous, by the votes of neighbouring pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks import _core
from fringeworks.patterns.order_chain import TURN, separation
from fringeworks.stack.kernel_settings import Decoding, lit_pixels
from fringeworks.statistics.chi_square import chi_square_quantile
from fringeworks.types import Reason

WORTH_VOTING = 0.1
"""Share of the lit pixels with an ambiguous order from which on neighbours vote. Edges and light of
other surfaces leave up to 5 % of simulated scenes ambiguous: there, doubt is right, and a vote of
neighbours would hide it. Noise that takes the margin of a plan leaves far more."""

UNKNOWN_TURNS = 1.0
"""Errors of all roundings, turns, from which on no order is known: sets that are shifted against
each other, as by motion, agree at wrong orders, too. Neighbours share the shift."""

ERROR_RATE = 1e-5
"""Largest posterior probability that a voted order is wrong."""

NEAR_ERROR_RATE = 1e-3
"""The same for the next neighbours of a pixel whose window lies across a depth step. A decided
pixel has the same order, which by itself is right on one of the two sides."""

OWN_DOUBT = 2.0
"""By how much χ² of a voted order may exceed that of the pixel's own best order: 1.4 standard
deviations. A thin object whose depth differs by a whole period shows in its own phases only."""

FITTING = 0.999
"""Share of the windows on one surface that fit their order. The pixel of one that does not is
judged by its next neighbours, so a strict test loses nothing."""

MOST_RADIUS = 7
"""Largest distance of a window's edge from its middle, px, that the kernel allows."""

SPARSE = 2.0
"""Pixels of a window per pixel that the vote needs: shadows and edges take some of them."""

USUAL = (0.5, 0.9)
"""Quantiles of χ² that systematic errors are estimated at: the middle and the tail."""


def worth_voting(decoding: Decoding, results: dict[str, Any]) -> bool:
    """Whether so many orders are ambiguous that neighbours should vote.

    Parameters
    ----------
    decoding : Decoding
    results : the kernel's maps
    """
    if len(decoding.sets) < 2 or decoding.gray is not None:
        return False
    if decoding.order_errors and min(decoding.order_errors) >= UNKNOWN_TURNS:
        return False
    ambiguous = int(np.count_nonzero(results["reason"] == Reason.ORDER_AMBIGUOUS))
    lit = int(np.count_nonzero(lit_pixels(results)))
    return ambiguous > WORTH_VOTING * lit


def vote(decoding: Decoding, kernel: _core.DecodeSettings, results: dict[str, Any]) -> None:
    """Decide ambiguous orders by the phases of neighbours, in place.

    Parameters
    ----------
    decoding : Decoding
    kernel : settings that the results were decoded with
    results : the kernel's maps, with the phases of all sets and their variances

    Notes
    -----
    A window of n pixels of one surface has the noise of one phase over √n. The window is as large
    as the distance between two orders demands at the noise of the ambiguous pixels.
    """
    freedom = len(decoding.sets) - 1
    rules: _core._VoteRules = {
        "radius": _radius(decoding, results),
        "error_rate": ERROR_RATE,
        "near_error_rate": NEAR_ERROR_RATE,
        "largest_misfit": chi_square_quantile(FITTING, freedom),
        "own_doubt": OWN_DOUBT,
        "usual_misfit": (
            chi_square_quantile(USUAL[0], freedom),
            chi_square_quantile(USUAL[1], freedom),
        ),
    }
    _core.vote_orders(kernel, results, rules)


def _radius(decoding: Decoding, results: dict[str, Any]) -> int:
    """Distance from the middle of a window to its edges, px."""
    ambiguous = results["reason"] == Reason.ORDER_AMBIGUOUS
    weights = [TURN**2 / float(np.median(v[ambiguous])) for v in results["variances"]]
    periods = [phases.period_px for phases in decoding.sets]
    apart = separation(periods, decoding.length_px, weights)
    # The likelihood of an order falls by exp(-d²/2) at d standard deviations from another one.
    # Means scatter themselves: half of the distance is left where they miss by as much.
    needed = 2.0 * (-2.0 * np.log(ERROR_RATE)) ** 0.5
    side = (SPARSE * (needed / max(apart, 1e-6)) ** 2) ** 0.5
    return int(np.clip(np.ceil(0.5 * (side - 1.0)), 1, MOST_RADIUS))
