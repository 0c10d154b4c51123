"""A calibrated camera and projector: the pinhole model, calibration, triangulation."""

from ..pipeline.cameras import (
    MultiMeasurement as MultiMeasurement,
)
from ..pipeline.rig_check import (
    adjust_rig as adjust_rig,
)
from ..pipeline.rig_check import (
    check_rig as check_rig,
)
from ..pipeline.verbs import (
    observe as observe,
)
from ..types import (
    MultiRig as MultiRig,
)
from ..types import (
    Pinhole as Pinhole,
)
from .calibration.board import (
    Board as Board,
)
from .calibration.board import (
    BoardKind as BoardKind,
)
from .calibration.board import (
    parse_board as parse_board,
)
from .calibration.board_view import (
    BoardView as BoardView,
)
from .calibration.calibrate import (
    Observation as Observation,
)
from .calibration.cameras import (
    MultiCalibration as MultiCalibration,
)
from .calibration.corners import (
    find_board as find_board,
)
from .calibration.diagnosis import (
    diagnose as diagnose,
)
from .calibration.drift import (
    Cause as Cause,
)
from .calibration.drift import (
    RigCheck as RigCheck,
)
from .calibration.verdict import (
    Verdict as Verdict,
)
from .calibration.verdict import (
    verdict as verdict,
)
from .camera_points import (
    CameraPoints as CameraPoints,
)
from .depth_range import (
    DepthRange as DepthRange,
)
from .device_pairs import (
    camera_pair as camera_pair,
)
from .triangulate import (
    Triangulator as Triangulator,
)
