"""Everything that touches a disk, one file for each kind."""

from .plan import (
    read_plan as read_plan,
    write_plan as write_plan,
    write_patterns as write_patterns,
)
from .certificate import (
    read_acceptance_test as read_acceptance_test,
)
from .watch_log import (
    WatchLog as WatchLog,
    append_watch_log as append_watch_log,
    read_watch_log as read_watch_log,
)
from .check_history import (
    CheckHistory as CheckHistory,
    append_check as append_check,
    read_check_history as read_check_history,
)
from .drawn_tolerances import (
    DrawnTolerances as DrawnTolerances,
    read_tolerances as read_tolerances,
)
from .study_table import (
    StudyTable as StudyTable,
    read_study as read_study,
)
from .flash_images import (
    write_flash_images as write_flash_images,
)
from .capture import (
    read_capture as read_capture,
)
from .pair import (
    read_pair as read_pair,
    write_pair as write_pair,
)
from .sequence import (
    FrameSequence as FrameSequence,
    read_sequence as read_sequence,
)
from .stack import (
    read_poses as read_poses,
    read_stack as read_stack,
    write_stack as write_stack,
)
from .exposures import (
    read_exposures as read_exposures,
)
from .images import (
    read_frame as read_frame,
    write_frame as write_frame,
)
from .limits import (
    file_limits as file_limits,
)
from .folder import (
    FolderInUse as FolderInUse,
)
from .response import (
    read_response as read_response,
    write_response as write_response,
)
from .reference_plane import (
    read_reference_plane as read_reference_plane,
    write_reference_plane as write_reference_plane,
)
from .archives import (
    read_coordinates as read_coordinates,
    write_coordinates as write_coordinates,
    read_light as read_light,
    write_light as write_light,
    read_phase as read_phase,
    write_phase as write_phase,
)
from .multi_rig import (
    read_multi_rig as read_multi_rig,
    write_multi_rig as write_multi_rig,
)
from .stereo_rig import (
    read_stereo_rig as read_stereo_rig,
)
from .robot_poses import (
    parse_robot_pose as parse_robot_pose,
    read_robot_poses as read_robot_poses,
)
from .rig import (
    read_rig as read_rig,
    write_rig as write_rig,
)
from .setup import (
    read_setup as read_setup,
    write_setup as write_setup,
)
from .surfaces import (
    read_surface as read_surface,
    write_surface as write_surface,
)
from .points import (
    read_cloud as read_cloud,
    read_points as read_points,
    write_points as write_points,
    write_merged_points as write_merged_points,
)
from .mesh_writer import (
    write_mesh as write_mesh,
)
from .mesh import (
    read_mesh as read_mesh,
    read_model as read_model,
)
from .recipe import (
    read_recipe as read_recipe,
    write_recipe as write_recipe,
)
from ..types import (
    Source as Source,
)
