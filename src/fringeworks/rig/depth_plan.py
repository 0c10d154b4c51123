"""Plans of few frames, for a rig and a range of depths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from fringeworks.patterns.propose import MIN_MARGIN, Proposal, propose
from fringeworks.rig.depth_range import ROOM_SIGMAS, DepthRange
from fringeworks.rig.ray_depth import main_axis
from fringeworks.types import Axis, InputError, Rig

MOST_ROOM = 0.5
"""Largest share of a period that may be room for noise. With more, the period is mostly noise."""


def propose_for_depth(
    rig: Rig,
    depth_mm: Sequence[float],
    frames: int,
    *,
    axes: Sequence[Axis] | None = None,
    noise: float = 2.0,
    modulation: float = 100.0,
    min_period_px: float = 16.0,
    max_period_px: float = math.inf,
    robust: bool = False,
) -> list[Proposal]:
    """Propose plans whose coordinates repeat, for a range of depths that resolves them.

    Parameters
    ----------
    rig : Rig
    depth_mm : (near, far)
        Smallest and largest z of what the projector lights, in camera coordinates, mm.
    frames : int
        Number of frames; ≥ 3 per axis.
    axes : sequence of "x", "y" or both, optional
        By default the axis along which a point moves the more when its depth changes.
    noise, modulation, min_period_px, max_period_px, robust
        As for ``propose``.

    Returns
    -------
    list of Proposal, the smallest predicted error first. The shortest distance after which all
    phases repeat has room for the range, for the rig's calibration by 5 σ and for noise by 6 σ.

    Raises
    ------
    InputError
        As ``propose`` and ``DepthRange``, for a range in which the projector lights nothing, and
        for noise that takes more than half of a period.

    Examples
    --------
    >>> from fringeworks.simulate import standard_rig
    >>> best = propose_for_depth(standard_rig(scale=0.5), (480.0, 520.0), 4)[0]
    >>> best.kind, best.summary
    ('single', 'x: 88 px × 4')
    """
    depth, chosen = DepthRange(rig, depth_mm), tuple(axes or (main_axis(rig),))
    share = max(3, frames // len(chosen))
    room = 2.0 * MIN_MARGIN * math.sqrt(2.0 / share) * noise / modulation / math.tau
    if not room < MOST_ROOM:
        raise InputError(
            f"noise: expected room for {MIN_MARGIN:g} standard deviations in half a period, got "
            f"{noise:g} counts at a modulation of {modulation:g}"
        )
    for axis in chosen:
        depth.check_lit(axis)
    spans = {axis: depth.period_px(axis) for axis in chosen}
    found = propose(
        rig.projector.width_px,
        rig.projector.height_px,
        frames,
        axes=chosen,
        noise=noise,
        modulation=modulation,
        min_period_px=min_period_px,
        max_period_px=max_period_px,
        robust=robust,
        range_px={axis: span / (1.0 - room) for axis, span in spans.items()},
    )
    reason = (
        f"the depth range of {depth.depth_mm[0]:g} to {depth.depth_mm[1]:g} mm spans "
        + " and ".join(f"{span:.0f} px along {axis}" for axis, span in spans.items())
        + f" with {ROOM_SIGMAS:g} σ of the calibration; it resolves the fringe orders, so that "
        "periods need not reach across the projector"
    )
    return [_with_room(proposal, spans, reason) for proposal in found]


def _with_room(proposal: Proposal, spans: dict[Axis, float], reason: str) -> Proposal:
    """The proposal with the margin that the depth range leaves, and its reason."""
    plan, sigma = proposal.plan, proposal.sigma_px
    lengths = {axis: plan.chain(axis, absolute=False).high_px + 0.5 for axis in spans}
    rooms = [(lengths[axis] - span) / (2.0 * sigma) for axis, span in spans.items()]
    margin = min(proposal.margin, *rooms)
    both = "; ".join(part for part in (reason, proposal.reason) if part)
    return replace(proposal, margin=margin, reason=both)
