"""Artificial objects, and the frames a camera would deliver of them."""

from fringeworks.simulate.fringes import PairSettings, Row, capture_pair, deformed_row
from fringeworks.simulate.objects import OBJECTS, make_object, paint, parabola_1d
from fringeworks.simulate.scene import STANDARD_GEOMETRY, standard_scene

__all__ = [
    "OBJECTS",
    "STANDARD_GEOMETRY",
    "PairSettings",
    "Row",
    "capture_pair",
    "deformed_row",
    "make_object",
    "paint",
    "parabola_1d",
    "standard_scene",
]
