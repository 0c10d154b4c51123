"""Sheets of maps before they are drawn: which maps, in which order, with which words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.report.windows import Window
from fringeworks.types import Finding, FloatMap, InputError
from fringeworks.types.numbers import percent, sigma_text

UNMEASURED_WORDS = "hatched: not measured"
"""How pixels without a value look, in words."""
SIGMA = "standard deviation σ"
"""Title of every panel of standard deviations."""
REASONS = "measured, or why not"
"""Title of every panel of reasons."""

PanelKind = Literal["values", "depth", "sigma", "signed", "grey", "phase", "reasons"]


@dataclass(frozen=True)
class Panel:
    """One map of a sheet."""

    title: str
    """Name of the quantity; panels of one name and unit have one scale unless they name another."""
    values: FloatMap | NDArray[Any]
    """The map, (h, w); of the kind "reasons", its ``Reason`` per pixel."""
    kind: PanelKind
    unit: str = ""
    scale: str = ""
    """Name of the scale, for panels of one quantity with titles of their own."""
    limits: tuple[float, float] | None = None
    """Ends of the scale, such as those of a tolerance; by default those of nearly all values."""

    @property
    def name(self) -> str:
        """What it is asked for by: its kind where that tells it, else its title's first word."""
        own = self.title.split()[0].lower().rstrip(",;:")
        return self.kind if self.kind in ("sigma", "reasons", "depth") else own

    @property
    def shares(self) -> tuple[str, str, str]:
        """What panels with one scale have in common."""
        return self.scale or self.title, self.kind, self.unit


@dataclass(frozen=True)
class Sheet:
    """Maps in rows below two lines of text."""

    title: str
    facts: str
    """Second line, or lines, above the maps."""
    panels: Sequence[Panel | None]
    """Of one shape, line by line; None leaves a place empty."""
    columns: int
    """Panels on a line."""
    findings: Sequence[Finding] = ()
    """Listed below the maps in one line each."""
    window: Window | None = None
    """The part of the frame that is drawn; None for all of it."""

    def panel(self, name: str) -> Panel:
        """The first panel of a kind, or whose title begins with a name.

        Raises
        ------
        InputError for another name, with those that there are.
        """
        wanted = name.strip().lower()
        panels = [panel for panel in self.panels if panel is not None]
        for panel in panels:
            if wanted and (panel.kind == wanted or panel.title.lower().startswith(wanted)):
                return panel
        known = ", ".join(panel.name for panel in panels)
        raise InputError(f"panel: expected one of {known}, got {name!r}")

    def untitled(self) -> Sheet:
        """The sheet without titles, facts and findings; scales name their quantities."""
        panels = [
            None
            if one is None
            else replace(one, title="", unit=f"{one.title} / {one.unit}" if one.unit else one.title)
            for one in self.panels
        ]
        return replace(self, title="", facts="", panels=panels, findings=())


def titled(name: str | None, title: str) -> str:
    """The title of a picture, with the name of the object or capture before it."""
    return f"{name}: {title[0].lower()}{title[1:]}" if name else title


def map_facts(measured: float, sigma: FloatMap, unit: str, *more: str) -> str:
    """Size, share of measured pixels and usual σ in one line."""
    height, width = sigma.shape
    found = sigma[np.isfinite(sigma)]
    usual = f"median σ {sigma_text(float(np.median(found)), unit)}" if found.size else ""
    words = UNMEASURED_WORDS if measured < 1.0 else ""
    parts = (f"{width} × {height} px", f"{percent(measured)} measured", usual, *more, words)
    return "   ·   ".join(part for part in parts if part)
