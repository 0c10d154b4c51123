"""Simulation: artificial objects and bodies, and the frames that a camera would deliver of them."""

from fringeworks.simulate.bayer import Bayer, demosaiced, mosaic
from fringeworks.simulate.boards import BoardErrors, real_board_body, real_points
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
from fringeworks.simulate.exposure import Transport, photograph, photograph_moving
from fringeworks.simulate.fringes import PairSettings, Row, capture_pair, deformed_row
from fringeworks.simulate.interreflection import interreflection
from fringeworks.simulate.jpeg import jpeg_compressed
from fringeworks.simulate.lens import ThinLens
from fringeworks.simulate.objects import OBJECTS, make_object, paint, parabola_1d
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.response_curve import (
    DLP_BRIGHT,
    LCD,
    ResponseCurve,
    SCurve,
    TabulatedResponse,
)
from fringeworks.simulate.rig_pair import pair_displacement, photograph_pair
from fringeworks.simulate.scene import STANDARD_GEOMETRY, standard_scene
from fringeworks.simulate.standard import (
    board_body,
    board_poses,
    bust,
    cropped_field,
    fringe_plan,
    standard_cameras,
    standard_rig,
    truth_distance,
    widened_frame,
)
from fringeworks.simulate.subsurface import subsurface
from fringeworks.simulate.virtual_rig import View, highlight, look

__all__ = [
    "DLP_BRIGHT",
    "LCD",
    "OBJECTS",
    "STANDARD_GEOMETRY",
    "Bayer",
    "BoardErrors",
    "Body",
    "Box",
    "Cylinder",
    "Mesh",
    "Optics",
    "PairSettings",
    "Paraboloid",
    "Plane",
    "ResponseCurve",
    "Row",
    "SCurve",
    "Sphere",
    "TabulatedResponse",
    "ThinLens",
    "Transport",
    "View",
    "board_body",
    "board_poses",
    "bust",
    "capture_pair",
    "cropped_field",
    "deformed_row",
    "demosaiced",
    "fringe_plan",
    "height_field",
    "highlight",
    "interreflection",
    "jpeg_compressed",
    "look",
    "make_object",
    "mosaic",
    "paint",
    "pair_displacement",
    "parabola_1d",
    "photograph",
    "photograph_moving",
    "photograph_pair",
    "real_board_body",
    "real_points",
    "standard_cameras",
    "standard_rig",
    "standard_scene",
    "subsurface",
    "truth_distance",
    "widened_frame",
]
