"""Whether the coordinates of a plan repeat within the projector's frame."""

from __future__ import annotations

from fringeworks.patterns.plan import PatternPlan
from fringeworks.types import InputError


def repeats(plan: PatternPlan) -> bool:
    """Whether the phases and Gray codes of a plan leave coordinates that repeat along an axis.

    Examples
    --------
    >>> from fringeworks.patterns.plan import PhaseSteps, equal_steps
    >>> repeats(PatternPlan(640, 480, (PhaseSteps("x", 80.0, equal_steps(4)),)))
    True
    """
    try:
        for axis in plan.axes:
            if plan.phase_sets(axis):
                plan.chain(axis)
    except InputError:
        return True
    return False
