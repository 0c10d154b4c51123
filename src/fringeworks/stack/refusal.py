"""Stacks, and axes of them, of which hardly a pixel can be measured, and why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

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
    sealed,
    unsealed,
)
from fringeworks.types.finding import LEFT_OUT, MOVING

MIN_MEASURED = 0.02
"""Share of the pixels with fringes that must be measured, at least. The few that pass every test
where nearly all others fail may have passed by chance. An empirical choice."""
ALL_DARK = 0.99
"""Share of pixels in shadow from which on no light of the projector is seen: noise alone makes a
pixel look lit once in a hundred."""

LIKE_OTHERS = ("saturated", MOVING)
"""Kinds of findings whose cause makes frames look as under another fault; they are named first."""


@contextmanager
def causes_first(findings: Sequence[Finding]) -> Iterator[None]:
    """Add findings to the refusals of the block, and name those first that make frames look as
    under another fault: saturation, and a scene that moves."""
    try:
        yield
    except InputError as error:
        told = [f for kind in LIKE_OTHERS for f in findings if f.kind == kind and f.rank]
        if not told or str(error).startswith(LIKE_OTHERS):
            raise explained(error, findings) from None
        message = f"{told[0].kind}: {told[0].seen}; {told[0].advice}; besides, {error}"
        raise type(error)(message, findings=(*findings, *error.findings)) from error


def without_lacking_axes(decoded: Decoded, axes: Mapping[Axis, Refined]) -> Decoded:
    """Leave out axes of which hardly a pixel that shows fringes can be measured.

    Parameters
    ----------
    decoded : Decoded
        With the orders that neighbours have voted for. Its maps of these axes are overwritten.
    axes : decoding of each axis, with the disagreement of its sets

    Returns
    -------
    Decoded
        With a finding for every axis that is left out: all of its pixels are NaN.

    Raises
    ------
    InputError
        Where no axis is left, with the reasons, the margin that the plan lacks, and what was found.
    """
    lacking = {
        axis: _lacking_in_words(axis, found, axes[axis], decoded.noise)
        for axis, found in decoded.maps.items()
        if _hardly_measured(found)
    }
    if not lacking:
        return decoded
    if len(lacking) == len(decoded.maps):
        raise InputError(
            "; ".join(f"frames {words}" for words in lacking.values()),
            findings=(*decoded.findings, *unmeasured(decoded)),
        )
    for axis in lacking:
        leave_out(decoded.maps[axis])
    findings = tuple(
        Finding(
            LEFT_OUT,
            words,
            advice="the other axis is measured; take this one with more light or another plan",
            axis=axis,
        )
        for axis, words in lacking.items()
    )
    return replace(decoded, findings=(*decoded.findings, *findings))


def leave_out(found: CoordinateMap) -> None:
    """Set the pixels of a map that are measured to NaN, with ``ORDER_AMBIGUOUS``."""
    measured = found.reason == Reason.OK
    for array, value in (
        (found.coordinate_px, np.nan),
        (found.sigma_px, np.nan),
        (found.reason, Reason.ORDER_AMBIGUOUS),
    ):
        unsealed(array)[measured] = value
        sealed(array)


def _hardly_measured(found: CoordinateMap) -> bool:
    """Whether hardly a pixel that shows fringes is measured."""
    measured = found.reason.size - np.count_nonzero(found.reason)
    if measured > MIN_MEASURED * found.reason.size:
        return False  # counting the rest takes time
    ambiguous = np.count_nonzero(found.reason == Reason.ORDER_AMBIGUOUS)
    return bool(measured <= MIN_MEASURED * (measured + ambiguous))


def _lacking_in_words(
    axis: Axis, found: CoordinateMap, refined: Refined, noise: CameraNoise
) -> str:
    """What keeps the pixels of an axis from being measured."""
    reasons = ", ".join(
        f"{100.0 * count / found.reason.size:.0f} % {name}"
        for name, count in count_reasons(found.reason).items()
    )
    got = "none" if found.reason.all() else "hardly any"
    return (
        f"along {axis}: expected pixels that can be measured, got {got}: {reasons}"
        f"{_lacking_light(found)}{_lacking_margin(found, refined.decoding, noise)}"
    )


def _lacking_light(found: CoordinateMap) -> str:
    """What to look for where hardly a pixel changes with the patterns; empty elsewhere."""
    dark = np.count_nonzero(found.reason == Reason.SHADOW)
    if dark < ALL_DARK * found.reason.size:
        return ""
    return (
        " (hardly a pixel changes from frame to frame by more than noise: was the projector on and "
        "in view, and did every frame wait for its pattern?)"
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
