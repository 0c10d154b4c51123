"""Fringe projection profilometry: from photographs of projected fringes to heights."""

from fringeworks import _core
from fringeworks.analysis import analyse, methods
from fringeworks.types import (
    Capture,
    HeightMap,
    InputError,
    PhaseMap,
    Reason,
    ReferencePlaneGeometry,
)

__all__ = [
    "Capture",
    "HeightMap",
    "InputError",
    "PhaseMap",
    "Reason",
    "ReferencePlaneGeometry",
    "analyse",
    "methods",
]
