"""Plots of the studio: each on white, as commands write it, and once more for dark pages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fringeworks.report.display import plot
from fringeworks.report.drawing import rc_context
from fringeworks.report.figures import save_figure

DARK_FOLDER = ".dark"
"""Folder of the plots for dark pages; a dot hides it from lists."""
INK, PAPER, PLATE, LINE = "#e8eaed", "#14171b", "#1c2026", "#3b424c"
"""Colours of words, page, axes and grid on dark pages, as in studio.css."""
DARK: Any = {
    "figure.facecolor": PAPER,
    "axes.facecolor": PLATE,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": LINE,
    "legend.facecolor": PLATE,
    "legend.edgecolor": LINE,
    "patch.edgecolor": INK,
}
"""Matplotlib's settings for dark pages."""


def draw(result: Any, path: Path, name: str | None = None) -> None:
    """Write the plot of a result, and beside it the one for dark pages."""
    save_figure(plot(result, name), path)
    dark = path.parent / DARK_FOLDER
    dark.mkdir(exist_ok=True)
    with rc_context(DARK):
        save_figure(plot(result, name), dark / path.name)
