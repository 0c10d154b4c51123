"""Which method is best where: a sweep over scenes, its winners, and why they win."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fringeworks.evaluate.captures import Row
from fringeworks.types.numbers import number, percent

TIE = 1.02
"""Errors within this factor count as equal: that much changes from seed to seed."""
CELL = ("object", "gamma", "noise", "bits", "fringes")
"""Columns that make a scene."""
UNMEASURED = 0.01
"""Share of additional unmeasured pixels that explains a lower mean error."""


@dataclass(frozen=True)
class Cell:
    """One scene of the sweep and who measured it best."""

    scene: dict[str, Any]
    best: str
    error_mm: float
    windowed_mm: float
    """Mean error of ``windowed`` on the same scene; NaN where it did not run."""
    why: str
    """Why another method than ``windowed`` has the lowest error; empty where none has."""

    @property
    def disturbed(self) -> bool:
        """Whether the scene has noise or quantisation."""
        return bool(self.scene["noise"] or self.scene["bits"])


def best_methods(rows: Sequence[Row]) -> list[Cell]:
    """The method with the lowest mean error in every scene of a comparison.

    Parameters
    ----------
    rows : rows of ``compare``

    Returns
    -------
    A cell per scene, in the order in which scenes first appear; ``windowed`` wins ties.
    """
    scenes: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        scenes.setdefault(tuple(row[key] for key in CELL), []).append(row)
    cells = []
    for key, entries in scenes.items():
        best = min(entries, key=lambda row: row["mean_abs_error_mm"])
        windowed = next((row for row in entries if row["method"] == "windowed"), None)
        why = ""
        if windowed is not None and best is not windowed:
            if windowed["mean_abs_error_mm"] <= TIE * best["mean_abs_error_mm"]:
                best = windowed
            else:
                why = _why(best, windowed)
        cells.append(
            Cell(
                scene=dict(zip(CELL, key, strict=True)),
                best=best["method"],
                error_mm=best["mean_abs_error_mm"],
                windowed_mm=windowed["mean_abs_error_mm"] if windowed else float("nan"),
                why=why,
            )
        )
    return cells


def _why(best: Row, windowed: Row) -> str:
    """Why the winner's mean error is below that of ``windowed``, by their own figures."""
    if not best["noise"] and not best["bits"]:
        return "ideal frames: a row method needs no window"
    unmeasured = best["failed_fraction"] - windowed["failed_fraction"]
    if unmeasured > UNMEASURED:
        return f"it leaves {percent(unmeasured)} more unmeasured"
    inner, own_inner = (row["inner_mean_abs_error_mm"] for row in (best, windowed))
    if np.isfinite(best["edge_mean_abs_error_mm"]):
        errors = f"{number(inner, digits=2)} against {number(own_inner, digits=2)} mm"
        off = f"{errors} more than 5 px off them"
        return f"cliffs: windows reach across them ({off})"
    if not best["noise"]:
        return "rounding without noise repeats along the fringes: windows do not average it"
    return f"errs less all over, s.d. {number(best['std_error_mm'], digits=2)} against " + (
        f"{number(windowed['std_error_mm'], digits=2)} mm"
    )


def format_map(cells: Sequence[Cell]) -> list[Row]:
    """The map as rows: a line per object, γ, noise and quantisation, a column per fringes."""
    columns = sorted({cell.scene["fringes"] for cell in cells})
    lines: dict[tuple[Any, ...], Row] = {}
    for cell in cells:
        key = tuple(cell.scene[name] for name in CELL[:-1])
        line = lines.setdefault(key, dict(zip(CELL[:-1], key, strict=True)))
        for f in columns:
            line.setdefault(f"{f:g} fringes", "–")
        line[f"{cell.scene['fringes']:g} fringes"] = f"{cell.best} {number(cell.error_mm)}"
    return list(lines.values())
