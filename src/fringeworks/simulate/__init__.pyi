"""Simulation: artificial objects and bodies, and the frames that a camera would deliver of them."""

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
    photograph as photograph,
)
from .fringes import (
    PairOptions as PairOptions,
)
from .optics import (
    Optics as Optics,
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
    fringe_plan as fringe_plan,
)
from .standard import (
    standard_cameras as standard_cameras,
)
from .standard import (
    standard_rig as standard_rig,
)
from .virtual_rig import (
    View as View,
)
from .virtual_rig import (
    look as look,
)
