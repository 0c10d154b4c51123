"""Simulation: artificial objects and bodies, and the frames that a camera would deliver of them."""

from .scene import (
    standard_scene as standard_scene,
)
from .fringes import (
    PairOptions as PairOptions,
)
from .standard import (
    standard_rig as standard_rig,
    standard_cameras as standard_cameras,
    fringe_plan as fringe_plan,
    bust as bust,
    board_body as board_body,
    board_poses as board_poses,
)
from .virtual_rig import (
    look as look,
    View as View,
)
from .exposure import (
    photograph as photograph,
)
from .optics import (
    Optics as Optics,
)
from .bodies import (
    Body as Body,
    Plane as Plane,
    Box as Box,
    Sphere as Sphere,
    Cylinder as Cylinder,
    Paraboloid as Paraboloid,
    Mesh as Mesh,
    height_field as height_field,
)
from .exposure import (
    photograph_moving as photograph_moving,
)
from .rig_pair import (
    photograph_pair as photograph_pair,
    pair_displacement as pair_displacement,
)
from .standard import (
    truth_distance as truth_distance,
    cropped_field as cropped_field,
    widened_frame as widened_frame,
)
from .lens import (
    ThinLens as ThinLens,
)
from .bayer import (
    Bayer as Bayer,
)
from .response_curve import (
    SCurve as SCurve,
    TabulatedResponse as TabulatedResponse,
)
from .exposure import (
    Transport as Transport,
)
