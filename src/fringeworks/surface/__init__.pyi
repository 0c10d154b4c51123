"""Surfaces: normals, triangles and heights of point clouds; points of height maps; fitted forms."""

from ..types import (
    Points as Points,
)
from ..types import (
    Profile as Profile,
)
from .clean import (
    clean_cloud as clean_cloud,
)
from .clean import (
    crop_cloud as crop_cloud,
)
from .cloud import (
    height_over_plane as height_over_plane,
)
from .cloud import (
    normals as normals,
)
from .form import (
    Form as Form,
)
from .form import (
    fit_form as fit_form,
)
from .form import (
    fit_region as fit_region,
)
from .form_geometry import (
    BodyKind as BodyKind,
)
from .form_report import (
    find_spheres as find_spheres,
)
from .mesh import (
    cloud_mesh as cloud_mesh,
)
from .mesh import (
    decimate as decimate,
)
from .section import (
    difference as difference,
)
