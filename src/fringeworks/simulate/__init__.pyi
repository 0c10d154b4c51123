"""Simulation: artificial objects and bodies, and the frames that a camera would deliver of them."""

from .bayer import (
    Bayer as Bayer,
)
from .bodies import (
    Body as Body,
)
from .bodies import (
    Box as Box,
)
from .bodies import (
    Cylinder as Cylinder,
)
from .bodies import (
    Mesh as Mesh,
)
from .bodies import (
    Paraboloid as Paraboloid,
)
from .bodies import (
    Plane as Plane,
)
from .bodies import (
    Sphere as Sphere,
)
from .bodies import (
    height_field as height_field,
)
from .exposure import (
    Transport as Transport,
)
from .exposure import (
    photograph as photograph,
)
from .exposure import (
    photograph_moving as photograph_moving,
)
from .fringes import (
    PairOptions as PairOptions,
)
from .lens import (
    ThinLens as ThinLens,
)
from .optics import (
    Optics as Optics,
)
from .response_curve import (
    SCurve as SCurve,
)
from .response_curve import (
    TabulatedResponse as TabulatedResponse,
)
from .rig_pair import (
    pair_displacement as pair_displacement,
)
from .rig_pair import (
    photograph_pair as photograph_pair,
)
from .scene import (
    standard_scene as standard_scene,
)
from .standard import (
    board_body as board_body,
)
from .standard import (
    board_poses as board_poses,
)
from .standard import (
    bust as bust,
)
from .standard import (
    cropped_field as cropped_field,
)
from .standard import (
    fringe_plan as fringe_plan,
)
from .standard import (
    standard_cameras as standard_cameras,
)
from .standard import (
    standard_rig as standard_rig,
)
from .standard import (
    truth_distance as truth_distance,
)
from .standard import (
    widened_frame as widened_frame,
)
from .virtual_rig import (
    View as View,
)
from .virtual_rig import (
    look as look,
)
