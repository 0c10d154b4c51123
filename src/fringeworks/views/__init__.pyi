"""Several views of one part: their poses, how they fit together, and the part that they show."""

from ..pipeline.merging import (
    MergedPart as MergedPart,
)
from ..surface.camera_blur import (
    remove_blur as remove_blur,
)
from .board_views import (
    BoardPose as BoardPose,
)
from .board_views import (
    board_pose as board_pose,
)
from .closing import (
    closed_mesh as closed_mesh,
)
from .fusion import (
    Fused as Fused,
)
from .pose_graph import (
    Closure as Closure,
)
from .poses import (
    TurntableAxis as TurntableAxis,
)
from .poses import (
    ViewPose as ViewPose,
)
from .poses import (
    turntable_axis as turntable_axis,
)
from .registration import (
    Registration as Registration,
)
