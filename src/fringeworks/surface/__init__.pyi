"""Surfaces: normals, triangles and heights of point clouds; points of height maps; fitted forms."""

from ..types import (
    Placement as Placement,
    Points as Points,
    Profile as Profile,
)
from .clean import (
    clean_cloud as clean_cloud,
    crop_cloud as crop_cloud,
)
from .cloud import (
    height_over_plane as height_over_plane,
    normals as normals,
)
from .mesh import (
    cloud_mesh as cloud_mesh,
    height_map_mesh as height_map_mesh,
    decimate as decimate,
)
from .relief import (
    solid_relief as solid_relief,
)
from .form_geometry import (
    BodyKind as BodyKind,
)
from .form import (
    Form as Form,
    fit_form as fit_form,
    fit_region as fit_region,
)
from .form_report import (
    find_spheres as find_spheres,
)
from .section import (
    difference as difference,
)
