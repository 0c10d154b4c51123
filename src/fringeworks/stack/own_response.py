"""The response of projector and camera from the stack itself: a ripple that all sets share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.signal.phase_table import TABLE_BINS
from fringeworks.stack import words
from fringeworks.stack.agreement import decode_sample
from fringeworks.stack.kernel_settings import Decoding
from fringeworks.stack.ripple import Ripple
from fringeworks.stack.ripple_removal import line_ripple
from fringeworks.stack.sample import Sample
from fringeworks.stack.set_residuals import Known
from fringeworks.types import Finding, InputError

RESPONSE_PASSES = 3
"""Passes of measuring and subtracting the ripple. Its size is known to a tenth after the first one,
because errors of 0.3 rad bend the phases that it is measured over. Empirical."""

FIRST_ORDER = 3
"""Lowest order that a response makes, periods per fringe; lower ones come from steps and gains."""


def with_own_response(
    decoding: Decoding, sample: Sample, known: Known
) -> tuple[Decoding, list[Finding]]:
    """The decoding with tables that subtract the ripple of a response that is not linear.

    Parameters
    ----------
    decoding : Decoding
    sample : Sample
    known : Known

    Returns
    -------
    decoding : Decoding
    findings : list of Finding

    Raises
    ------
    InputError
        If no line crosses enough whole fringes of any set.

    Notes
    -----
    The response makes the same ripple in all sets with the same steps. It is measured where lines
    cross enough fringes, and used for the other sets as well.
    """
    lines = [sample.lines[decoding.axis][k] for k in decoding.frames]
    tables = [np.zeros(TABLE_BINS) for _ in decoding.sets]
    for _ in range(RESPONSE_PASSES):
        maps = decode_sample(decoding, lines, known.noise, known.limits.open)
        ripples = [line_ripple(p, maps, k, known) for k, p in enumerate(decoding.sets)]
        if not any(ripples):
            raise InputError(
                f"response along {decoding.axis}: expected lines across several fringes of a "
                "smooth surface to measure it from, got none"
            )
        sets = []
        for k, phases in enumerate(decoding.sets):
            alike = [
                r
                for r, p in zip(ripples, decoding.sets, strict=True)
                if r is not None and p.shifts_rad == phases.shifts_rad
            ]
            own = ripples[k]
            tables[k] += _table([own] if own is not None else alike)
            turns = tuple(float(v) for v in tables[k] / TURN)
            sets.append(replace(phases, table_turns=turns, brightness=(0.0,)))
        decoding = replace(decoding, sets=tuple(sets))
    found = [
        words.own_response(phases, _rms(table), decoding.axis)
        for phases, table in zip(decoding.sets, tables, strict=True)
    ]
    return decoding, found


def _rms(table: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(table**2)))


def _table(ripples: list[Ripple]) -> NDArray[np.float64]:
    """Mean phase error of ripples at the middles of the bins of a table, rad."""
    phase = TURN * ((np.arange(TABLE_BINS) + 0.5) / TABLE_BINS - 0.5)
    error = np.zeros(TABLE_BINS)
    for ripple in ripples:
        for order in ripple.orders:
            z = ripple.significant(order) if order >= FIRST_ORDER else 0.0
            error += np.real(z * np.exp(-1j * order * phase)) / len(ripples)
    return error
