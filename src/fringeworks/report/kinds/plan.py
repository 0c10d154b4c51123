"""What is shown of a plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fringeworks.patterns.plan import PatternPlan
from fringeworks.report.kind import Kind, describe
from fringeworks.report.sheets import titled

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure


def picture(plan: PatternPlan, name: str | None) -> Figure:
    """The light of every frame."""
    from fringeworks.report.plan_picture import plan_picture  # which needs Matplotlib

    return plan_picture(titled(name, "The light of every frame, in the order of projection"), plan)


describe(PatternPlan, Kind(picture=picture))
