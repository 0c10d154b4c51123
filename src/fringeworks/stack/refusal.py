"""Refusal of a stack of which hardly a pixel can be measured, with the figures that explain it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from fringeworks.patterns.chain_search import ORDER_SIGMAS
from fringeworks.stack.kernel_settings import Decoding
from fringeworks.stack.refine import Refined
from fringeworks.stack.unmeasured import unmeasured
from fringeworks.types import (
    Axis,
    CameraNoise,
    CoordinateMap,
    Decoded,
    Finding,
    InputError,
    Reason,
    count_reasons,
    explained,
)

MIN_MEASURED = 0.02
"""Share of the pixels with fringes that must be measured, at least. The few that pass every test
where nearly all others fail may have passed by chance. An empirical choice."""


@contextmanager
def saturation_first(findings: Sequence[Finding]) -> Iterator[None]:
    """Add findings to the refusals of the block, and name saturation first where they warn of it.

    What saturation leaves of the frames may look like another fault.
    """
    try:
        yield
    except InputError as error:
        told = [f for f in findings if f.kind == "saturated" and f.rank]
        if not told or str(error).startswith("saturated"):
            raise explained(error, findings) from None
        message = f"saturated: {told[0].seen}; {told[0].advice}; besides, {error}"
        raise type(error)(message, findings=(*findings, *error.findings)) from error


def refuse_nothing_measured(decoded: Decoded, axes: Mapping[Axis, Refined]) -> None:
    """Refuse a stack of which hardly a pixel that shows fringes can be measured.

    Parameters
    ----------
    decoded : Decoded
        With the orders that neighbours have voted for.
    axes : decoding of each axis, with the disagreement of its sets

    Raises
    ------
    InputError
        With the reasons, the margin that the plan lacks, and what was found.
    """
    for axis, found in decoded.maps.items():
        measured = found.reason.size - np.count_nonzero(found.reason)
        if measured > MIN_MEASURED * found.reason.size:
            continue  # counting the rest takes time
        ambiguous = np.count_nonzero(found.reason == Reason.ORDER_AMBIGUOUS)
        if measured > MIN_MEASURED * (measured + ambiguous):
            continue
        reasons = ", ".join(
            f"{100.0 * count / found.reason.size:.0f} % {name}"
            for name, count in count_reasons(found.reason).items()
        )
        lacking = _lacking_margin(found, axes[axis].decoding, decoded.noise)
        raise InputError(
            f"frames along {axis}: expected pixels that can be measured, "
            f"got {'hardly any' if measured else 'none'}: {reasons}{lacking}",
            findings=(*decoded.findings, *unmeasured(decoded)),
        )


def _lacking_margin(found: CoordinateMap, decoding: Decoding, noise: CameraNoise) -> str:
    """The margin that the plan lacks at the noise of the ambiguous pixels; empty if it has one."""
    ambiguous = (found.reason == Reason.ORDER_AMBIGUOUS) & (found.modulation > 0)
    chain = decoding.chain
    if chain is None or not ambiguous.any():
        return ""
    modulation = float(np.median(found.modulation[ambiguous]))
    variance = float(noise.variance(float(np.median(found.background[ambiguous]))))
    variance *= decoding.noise_factor / modulation**2
    sigma = [(2.0 / len(phases.frames) * variance) ** 0.5 for phases in decoding.sets]
    margin = chain.margin(chain.judged_sigma(sigma))
    if margin >= ORDER_SIGMAS:
        return ""
    return (
        f". The fringe orders have a margin of {margin:.1f} standard deviations at the noise of "
        f"{max(sigma):.2g} rad ({noise.read_counts:.2g} counts at a modulation of {modulation:.3g})"
        f"; {ORDER_SIGMAS:g} are needed, and neighbours do not make up for it: "
        f"{ORDER_SIGMAS / max(margin, 0.1):.1f} times the modulation, or a plan with more margin"
    )
