"""The picture of a plan: the light of every frame along the projector, in their order."""

from __future__ import annotations

import numpy as np

from fringeworks.patterns.plan import PatternPlan, Uniform
from fringeworks.report.maps import Picture
from fringeworks.types import Axis, FloatMap

ROW_INCH = 0.24
"""Height of a frame's strip, inches: its name beside it can be read."""
WIDTH_INCH = 10.5
"""Width of the picture, inches."""
SPARE_INCH = 1.1
"""Height of the title, and of the labels of one axis, inches."""


def plan_picture(title: str, plan: PatternPlan) -> Picture:
    """Draw the light of every frame over the projector's columns or rows.

    Parameters
    ----------
    title : str
    plan : PatternPlan

    Returns
    -------
    Picture with one chart for each axis: a strip for every frame that varies along it.
    """
    charts = {axis: _strips(plan, axis) for axis in plan.axes}
    counts = [len(names) for names, _ in charts.values()]
    height = ROW_INCH * sum(counts) + SPARE_INCH * (len(counts) + 0.4)
    figure = Picture(figsize=(WIDTH_INCH, height), layout="constrained")
    facts = f"{plan.frames} frames for a projector of {plan.width_px} × {plan.height_px} px"
    figure.suptitle(f"{title}\n{facts}", fontsize=12)
    grid = figure.add_gridspec(len(counts), 1, height_ratios=counts)
    for k, (axis, (names, light)) in enumerate(charts.items()):
        axes = figure.add_subplot(grid[k, 0])
        axes.imshow(
            light,
            cmap="gray",
            vmin=0.0,
            vmax=1.0,
            aspect="auto",
            interpolation="nearest",
            extent=(-0.5, plan.length_px(axis) - 0.5, len(names) - 0.5, -0.5),
        )
        axes.set_yticks(range(len(names)), names, fontsize=9)
        for border in np.arange(1, len(names)) - 0.5:
            axes.axhline(border, color="white", linewidth=2.0)
        axes.set_xlabel(f"projector {'column x' if axis == 'x' else 'row y'} / px")
        axes.set_ylabel("frame")
        axes.set_title(
            "frames that vary from " + ("column to column" if axis == "x" else "row to row")
        )
    return figure


def _strips(plan: PatternPlan, axis: Axis) -> tuple[list[str], FloatMap]:
    """Names and light of the frames along an axis; uniform ones are drawn with the first axis."""
    position = np.arange(plan.length_px(axis), dtype=np.float64)
    labels = plan.labels()
    names, light = [], []
    patterns = [(block, n) for _, block in plan.placed for n in range(block.frames)]
    for frame, k in enumerate(plan.order):
        block, n = patterns[k]
        along = plan.axes[0] if isinstance(block, Uniform) else block.axis
        if along == axis:
            names.append(f"{frame + 1}: {labels[frame]}")
            light.append(block.values(position, n))
    return names, np.stack(light)
