"""Everything that touches a disk, one file for each kind."""

from ..scan.setup_file import (
    read_setup as read_setup,
)
from ..scan.setup_file import (
    write_setup as write_setup,
)
from ..types import (
    Source as Source,
)
from .capture import (
    read_capture as read_capture,
)
from .coordinates import (
    read_coordinates as read_coordinates,
)
from .coordinates import (
    write_coordinates as write_coordinates,
)
from .exposures import (
    read_exposures as read_exposures,
)
from .folder import (
    FolderInUse as FolderInUse,
)
from .images import (
    read_frame as read_frame,
)
from .images import (
    write_frame as write_frame,
)
from .light import (
    read_light as read_light,
)
from .light import (
    write_light as write_light,
)
from .limits import (
    file_limits as file_limits,
)
from .merged import (
    write_merged_points as write_merged_points,
)
from .mesh import (
    read_mesh as read_mesh,
)
from .mesh import (
    read_model as read_model,
)
from .mesh_writer import (
    write_mesh as write_mesh,
)
from .multi_rig import (
    read_multi_rig as read_multi_rig,
)
from .multi_rig import (
    write_multi_rig as write_multi_rig,
)
from .pair import (
    read_pair as read_pair,
)
from .pair import (
    write_pair as write_pair,
)
from .plan import (
    read_plan as read_plan,
)
from .plan import (
    write_patterns as write_patterns,
)
from .plan import (
    write_plan as write_plan,
)
from .points import (
    read_cloud as read_cloud,
)
from .points import (
    read_points as read_points,
)
from .points import (
    write_points as write_points,
)
from .recipe import (
    read_recipe as read_recipe,
)
from .recipe import (
    write_recipe as write_recipe,
)
from .reference_plane import (
    read_reference_plane as read_reference_plane,
)
from .reference_plane import (
    write_reference_plane as write_reference_plane,
)
from .response import (
    read_response as read_response,
)
from .response import (
    write_response as write_response,
)
from .rig import (
    read_rig as read_rig,
)
from .rig import (
    write_rig as write_rig,
)
from .sequence import (
    FrameSequence as FrameSequence,
)
from .sequence import (
    read_sequence as read_sequence,
)
from .stack import (
    read_poses as read_poses,
)
from .stack import (
    read_stack as read_stack,
)
from .stack import (
    write_stack as write_stack,
)
from .surfaces import (
    read_surface as read_surface,
)
from .surfaces import (
    write_surface as write_surface,
)
from .wrapped import (
    read_phase as read_phase,
)
from .wrapped import (
    write_phase as write_phase,
)
