"""What is shown of a comparison: every method's map, its difference, its error where known."""

from __future__ import annotations

import numpy as np

from fringeworks.evaluate.captures import OTHERS, CaptureComparison
from fringeworks.report.kind import Kind, describe
from fringeworks.report.sheets import UNMEASURED_WORDS, Panel, Sheet, titled

MAPS_ABREAST = 4
"""Most methods on one line: more would make the maps too small to read."""


def picture(found: CaptureComparison, name: str | None) -> Sheet:
    """The maps of all methods on one scale, and their differences on another one."""
    methods = list(found.results)
    lines: list[list[Panel | None]] = []
    abreast = -(-len(methods) // -(-len(methods) // MAPS_ABREAST))
    for first in range(0, len(methods), abreast):
        chosen = methods[first : first + abreast]
        lines.append([_map(found, method) for method in chosen])
        lines.append([_difference(found, method) for method in chosen])
        if found.truth_mm is not None:
            lines.append([*(_error(found, method) for method in chosen), _bound(found)])
    lines = [line for line in lines if any(panel is not None for panel in line)]
    columns = max(len(line) for line in lines)
    panels = [panel for line in lines for panel in line + [None] * (columns - len(line))]
    surface = next(iter(found.surfaces.values()))
    facts = (
        f"{surface.shape[1]} × {surface.shape[0]} px   ·   one scale for all maps, and one for all "
        f"differences   ·   {UNMEASURED_WORDS}\ndifferences show where methods disagree, "
        "not which of them is right"
    )
    title = titled(name, f"Methods compared on {found.name}")
    return Sheet(title, facts, panels, columns=columns)


def _map(found: CaptureComparison, method: str) -> Panel:
    surface = found.surfaces[method]
    return Panel(method, surface.values, "values", surface.unit, surface.quantity)


def _difference(found: CaptureComparison, method: str) -> Panel | None:
    difference = found.difference[method]
    if not np.isfinite(difference).any():
        return None
    other = "median of the others" if found.against == OTHERS else found.against
    unit = found.surfaces[method].unit
    return Panel(f"{method} − {other}", difference, "signed", unit, "difference")


def _bound(found: CaptureComparison) -> Panel:
    unit = next(iter(found.surfaces.values())).unit
    return Panel("smallest error possible", found.bound, "sigma", unit, "Cramér–Rao bound")


def _error(found: CaptureComparison, method: str) -> Panel:
    assert found.truth_mm is not None
    error = found.surfaces[method].values - found.truth_mm
    return Panel(f"{method} − truth", error, "signed", "mm", "error")


describe(CaptureComparison, Kind(picture=picture))
