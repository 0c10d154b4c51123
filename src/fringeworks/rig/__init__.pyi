"""A calibrated camera and projector: the pinhole model, calibration, triangulation."""

from ..types import (
    CameraBlur as CameraBlur,
    LensField as LensField,
    Pinhole as Pinhole,
    MultiRig as MultiRig,
)
from .calibration.board import (
    Board as Board,
    BoardKind as BoardKind,
)
from .calibration.board_view import (
    BoardView as BoardView,
)
from .calibration.board import (
    parse_board as parse_board,
)
from .calibration.corners import (
    find_board as find_board,
)
from .calibration.calibrate import (
    Observation as Observation,
)
from ..pipeline.verbs import (
    observe as observe,
)
from .calibration.cameras import (
    MultiCalibration as MultiCalibration,
)
from .calibration.diagnosis import (
    diagnose as diagnose,
)
from .calibration.verdict import (
    Verdict as Verdict,
    verdict as verdict,
)
from .calibration.drift import (
    RigCheck as RigCheck,
    Cause as Cause,
)
from ..pipeline.rig_check import (
    check_rig as check_rig,
    adjust_rig as adjust_rig,
)
from .scan_evidence import (
    EpipolarEvidence as EpipolarEvidence,
    epipolar_evidence as epipolar_evidence,
)
from .drift_watch import (
    RigWatch as RigWatch,
    WatchedScan as WatchedScan,
    judge_scans as judge_scans,
)
from ..pipeline.rig_watch import (
    watch_rig as watch_rig,
)
from .depth_range import (
    DepthRange as DepthRange,
)
from .triangulate import (
    Triangulator as Triangulator,
)
from .sensor_region import (
    for_frames as for_frames,
)
from .device_pairs import (
    camera_pair as camera_pair,
)
from ..pipeline.projector import (
    calibrate_projector as calibrate_projector,
)
from .camera_points import (
    CameraPoints as CameraPoints,
)
from ..pipeline.cameras import (
    MultiMeasurement as MultiMeasurement,
)
from ..types import (
    Mount as Mount,
    RobotFrame as RobotFrame,
    RobotNoise as RobotNoise,
)
from .robot.readings import (
    Reading as Reading,
    RobotPoses as RobotPoses,
    robot_poses as robot_poses,
)
from .robot.base import (
    in_base as in_base,
)
from .robot.hand_eye import (
    HandEye as HandEye,
)
from ..pipeline.hand_eye import (
    hand_eye as hand_eye,
)
