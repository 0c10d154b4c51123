"""What is shown of the frames of a stack."""

from __future__ import annotations

import numpy as np

from fringeworks.report.kind import Kind, describe
from fringeworks.report.sheets import Panel, Sheet, titled
from fringeworks.stack.frames import Stack

MOST_SHOWN = 24
"""Frames that a picture shows; of more, every second, third and so on."""
COLUMNS = 4
"""Frames beside each other: as many as usual phase steps."""


def picture(stack: Stack, name: str | None) -> Sheet:
    """The raw frames in the order of the plan, on one scale."""
    count = len(stack.frames)
    every = -(-count // MOST_SHOWN)
    labels = stack.plan.labels()
    panels = [
        Panel(f"{k + 1}: {labels[k]}", np.asarray(stack.frames[k], float), "grey", "counts", "all")
        for k in range(0, count, every)
    ]
    shown = f"{count} frames" if every == 1 else f"{count} frames, one of {every} is shown"
    rows, columns = panels[0].values.shape
    return Sheet(
        titled(name, "Frames of the stack"),
        f"{shown}, {columns} × {rows} px",
        panels,
        columns=COLUMNS,
    )


describe(Stack, Kind(picture=picture))
