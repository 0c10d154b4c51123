"""Simulation: artificial objects and bodies, and the frames that a camera would deliver of them."""

from fringeworks.simulate.boards import BoardErrors, real_points
from fringeworks.simulate.bodies import (
    Body,
    Box,
    Cylinder,
    Mesh,
    Paraboloid,
    Plane,
    Sphere,
    height_field,
)
from fringeworks.simulate.fringes import PairSettings, Row, capture_pair, deformed_row
from fringeworks.simulate.objects import OBJECTS, make_object, paint, parabola_1d
from fringeworks.simulate.scene import STANDARD_GEOMETRY, standard_scene
from fringeworks.simulate.standard_rig import (
    board_body,
    board_poses,
    bust,
    fringe_plan,
    standard_rig,
    truth_distance,
)
from fringeworks.simulate.virtual_rig import Optics, View, look, photograph

__all__ = [
    "OBJECTS",
    "STANDARD_GEOMETRY",
    "BoardErrors",
    "Body",
    "Box",
    "Cylinder",
    "Mesh",
    "Optics",
    "PairSettings",
    "Paraboloid",
    "Plane",
    "Row",
    "Sphere",
    "View",
    "board_body",
    "board_poses",
    "bust",
    "capture_pair",
    "deformed_row",
    "fringe_plan",
    "height_field",
    "look",
    "make_object",
    "paint",
    "parabola_1d",
    "photograph",
    "real_points",
    "standard_rig",
    "standard_scene",
    "truth_distance",
]
