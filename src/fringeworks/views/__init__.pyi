"""Several views of one part: their poses, how they fit together, and the part that they show."""

from .poses import (
    TurntableAxis as TurntableAxis,
    ViewPose as ViewPose,
    turntable_axis as turntable_axis,
)
from ..surface.camera_blur import (
    remove_blur as remove_blur,
)
from .photograph_colours import (
    colour_by_photograph as colour_by_photograph,
)
from .closing import (
    closed_mesh as closed_mesh,
)
from .standing import (
    stand_mesh as stand_mesh,
)
from .board_views import (
    BoardPose as BoardPose,
    board_pose as board_pose,
)
from .registration import (
    Registration as Registration,
)
from .pose_graph import (
    Closure as Closure,
)
from .fusion import (
    Fused as Fused,
)
from ..pipeline.merging import (
    MergedPart as MergedPart,
)
