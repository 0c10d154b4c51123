"""Fringe orders that noise leaves ambiguous, by the votes of neighbouring pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks import _core
from fringeworks._lazy import scipy
from fringeworks.patterns.order_chain import TURN, separation
from fringeworks.signal.filters import box_mean
from fringeworks.stack.kernel_settings import Decoding, lit_pixels
from fringeworks.statistics.chi_square import chi_square_quantile
from fringeworks.statistics.quantiles import median
from fringeworks.types import BoolMap, FloatMap, Reason

WORTH_VOTING = 0.02
"""Share of the lit pixels in areas with an ambiguous order from which on neighbours vote: a dark
part of a scene is lost without. In seven simulated photographs with 1 to 10 % of ambiguous pixels,
votes of neighbours measured 0 to 10 % more pixels, and at most 80 per million more of them wrongly.
"""

MANY = 0.1
"""Share of the lit pixels with an ambiguous order from which on it is noise that takes the margin
of the plan, everywhere. Edges and light of other surfaces leave up to 5 % ambiguous."""

AREA = 0.5
"""Share of the pixels around a pixel that are ambiguous in an area that is dark or noisy. In lines
beside edges, which show light of two surfaces, fewer are. In ten simulated views, votes on lines
put 280 points off by more than a millimetre, and none with this share."""

AROUND = 5
"""Side of the window of that share, px: edges leave lines of one or two pixels ambiguous."""

UNKNOWN_TURNS = 1.0
"""Error of a rounding, turns, from which on neighbours do not vote: errors that they share look
like those of another order. Whole regions may decide."""

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

CELLS_AHEAD = 8
"""By how many more pixels of a window the order must be allowed than any other. Four would do if
the cells of neighbours were in error independently, each of them one in 20; a second surface in the
window puts several in error at once."""

CELLS_OTHERS = 0.05
"""Share of the pixels of a window whose cells may contradict the order. Noise takes one in 20 of
those next to the end of a cell beyond two standard deviations of it, and few are next to it."""

CELLS_CONTINUED = 0.7
"""Share of the lit pixels of a window that must continue the phase of its middle. On one surface
all do but those beyond strong curvature; beside a depth step, half do. Empirical."""

WORTH_ASKING = 0.01
"""Share of the lit pixels with an ambiguous order from which on the cells of neighbours decide.
Fewer are those of edges, which are not worth a second look at all pixels."""

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
    if decoding.gray is not None:
        return len(decoding.sets) == 1 and _ambiguous(results) > WORTH_ASKING
    if len(decoding.sets) < 2:
        return False
    if np.inf in decoding.order_errors:
        return False
    share = _ambiguous(results)
    if not WORTH_VOTING < share <= MANY:
        return share > MANY
    # Rows may be far from each other: areas show along them.
    ambiguous = results["reason"] == Reason.ORDER_AMBIGUOUS
    around = scipy.ndimage.uniform_filter1d(ambiguous.astype(np.float32), AROUND, axis=1)
    inside = int(np.count_nonzero(ambiguous & (around > AREA)))
    return inside > WORTH_VOTING * int(np.count_nonzero(lit_pixels(results)))


def _ambiguous(results: dict[str, Any]) -> float:
    """Share of the lit pixels with an ambiguous order."""
    ambiguous = int(np.count_nonzero(results["reason"] == Reason.ORDER_AMBIGUOUS))
    return ambiguous / max(1, int(np.count_nonzero(lit_pixels(results))))


def lines_in_doubt(decoding: Decoding, results: dict[str, Any]) -> BoolMap:
    """Mark ambiguous pixels in lines, as beside edges.

    Their light is that of two surfaces. Doubt is right there, whatever neighbours say.

    Parameters
    ----------
    decoding : Decoding
    results : the kernel's maps
    """
    ambiguous = results["reason"] == Reason.ORDER_AMBIGUOUS
    if decoding.gray is not None or _ambiguous(results) > MANY:
        return np.zeros_like(ambiguous)
    return np.asarray(ambiguous & (box_mean(ambiguous.astype(np.float32), AROUND) < AREA))


def leave_in_doubt(results: dict[str, Any], pixels: BoolMap) -> None:
    """Make pixels ambiguous that others have decided, in place."""
    results["coordinate"][pixels] = results["sigma"][pixels] = np.nan
    results["reason"][pixels] = Reason.ORDER_AMBIGUOUS


def maps_of_votes(decoding: Decoding, shape: tuple[int, int]) -> dict[str, list[FloatMap]]:
    """New arrays that ``vote`` needs beside the kernel's usual maps."""
    sets, cells = len(decoding.sets), 0 if decoding.gray is None else 2
    phases, variances = np.empty((2, sets, *shape), np.float32)
    ranges = np.empty((cells, *shape), np.float32)
    return {"phases": list(phases), "variances": list(variances), "cells": list(ranges)}


def vote(decoding: Decoding, kernel: _core.DecodeSettings, results: dict[str, Any]) -> None:
    """Decide ambiguous orders by the phases of neighbours, or by their Gray-code cells, in place.

    Parameters
    ----------
    decoding : Decoding
    kernel : settings that the results were decoded with
    results : the kernel's maps, with those of ``maps_of_votes``

    Notes
    -----
    A window of n pixels of one surface has the noise of one phase over √n. The window is as large
    as the distance between two orders demands at the noise of the ambiguous pixels. With a Gray
    code, the right order is the one that the cells of all pixels of a window have in common.
    """
    if decoding.gray is not None:
        cells: _core._CellRules = {
            "radius": MOST_RADIUS,  # from the end of a cell of up to 15 px to its middle
            "ahead": CELLS_AHEAD,
            "others": CELLS_OTHERS,
            "continued": CELLS_CONTINUED,
        }
        _core.vote_cells(kernel, results, cells)
        return
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
    asked = results["reason"] == Reason.ORDER_AMBIGUOUS
    if not asked.any():
        # Judged with the noise of uneven scenes, orders that were ambiguous may be none of it.
        asked = results["reason"] == Reason.OK
    if not asked.any():
        return 1
    weights = [TURN**2 / median(v[asked]) for v in results["variances"]]
    periods = [phases.period_px for phases in decoding.sets]
    apart = separation(periods, decoding.length_px, weights)
    # The likelihood of an order falls by exp(-d²/2) at d standard deviations from another one.
    # Means scatter themselves: half of the distance is left where they miss by as much.
    needed = 2.0 * (-2.0 * np.log(ERROR_RATE)) ** 0.5
    side = (SPARSE * (needed / max(apart, 1e-6)) ** 2) ** 0.5
    return int(np.clip(np.ceil(0.5 * (side - 1.0)), 1, MOST_RADIUS))
