"""The frozen types that pass between the stages, with units in the field docs.

``Pair`` → ``DisplacementMap`` → ``HeightMap`` for two frames, ``Decoded`` → ``PointCloud`` for
stacks. Frames are ``(h, w)``, pixel centres lie on integers, x is the column, y the row.
"""

from fringeworks.types.alignment import (
    AlignBy,
    Alignment,
    Ball,
    BestFit,
    DatumPlanes,
    DatumPoints,
    KnownPose,
    Where,
)
from fringeworks.types.area import Area
from fringeworks.types.arrays import (
    Axis,
    BoolMap,
    ByteMap,
    FloatMap,
    Reason,
    count_reasons,
    reason_counts,
)
from fringeworks.types.camera import CameraNoise, CameraSettings, ColourPlane, Region
from fringeworks.types.camera_blur import CameraBlur
from fringeworks.types.checks import (
    LARGEST,
    MOST_PX,
    MOST_SEED,
    NUMBERS,
    check_layout,
    finite,
    fits_axes,
    layout_words,
    positive,
    unmasked,
    whole,
)
from fringeworks.types.coordinates import CoordinateMap, Decoded
from fringeworks.types.delay import Delay
from fringeworks.types.displayed import Plotted, Sectioned
from fringeworks.types.errors import (
    BoardNotFound,
    DeviceProblem,
    FileProblem,
    FramesContradictPlan,
    InputError,
    MissingPackage,
    RigMismatch,
    UnknownMethod,
    check_fields,
    explained,
    found_before,
)
from fringeworks.types.finding import (
    Finding,
    Noted,
    Pixels,
    Severity,
    as_notes,
    by_effect,
    numbered,
    region_of,
)
from fringeworks.types.frozen import Frozen, check_reusable, fingerprint, sealed, unsealed
from fringeworks.types.lens_field import LensField
from fringeworks.types.multi_rig import MultiRig, multi_rig_parameters
from fringeworks.types.nominal import FaceKind, NominalFace, face_named
from fringeworks.types.pair import DisplacementMap, Pair, ReferencePlaneGeometry
from fringeworks.types.placement import CAMERA_FRAME, Placement
from fringeworks.types.points import Points, TriangleMesh
from fringeworks.types.profile import Line, Profile
from fringeworks.types.provenance import Provenance, Source, day, made_by, provenance_from, today
from fringeworks.types.recipe import Datum, PartModel, PartTolerance, Recipe, ToleranceZone
from fringeworks.types.rig import RIG_PARAMETERS, Pinhole, Rig
from fringeworks.types.robot import (
    Mount,
    RobotFrame,
    RobotNoise,
    check_pose_covariance,
    check_rigid,
)
from fringeworks.types.surface import HeightMap, PointCloud, need_camera_frame
from fringeworks.types.uncertainty import StatedUncertainty

__all__ = [
    "CAMERA_FRAME",
    "LARGEST",
    "MOST_PX",
    "MOST_SEED",
    "NUMBERS",
    "RIG_PARAMETERS",
    "AlignBy",
    "Alignment",
    "Area",
    "Axis",
    "Ball",
    "BestFit",
    "BoardNotFound",
    "BoolMap",
    "ByteMap",
    "CameraBlur",
    "CameraNoise",
    "CameraSettings",
    "ColourPlane",
    "CoordinateMap",
    "Datum",
    "DatumPlanes",
    "DatumPoints",
    "Decoded",
    "Delay",
    "DeviceProblem",
    "DisplacementMap",
    "FaceKind",
    "FileProblem",
    "Finding",
    "FloatMap",
    "FramesContradictPlan",
    "Frozen",
    "HeightMap",
    "InputError",
    "KnownPose",
    "LensField",
    "Line",
    "MissingPackage",
    "Mount",
    "MultiRig",
    "NominalFace",
    "Noted",
    "Pair",
    "PartModel",
    "PartTolerance",
    "Pinhole",
    "Pixels",
    "Placement",
    "Plotted",
    "PointCloud",
    "Points",
    "Profile",
    "Provenance",
    "Reason",
    "Recipe",
    "ReferencePlaneGeometry",
    "Region",
    "Rig",
    "RigMismatch",
    "RobotFrame",
    "RobotNoise",
    "Sectioned",
    "Severity",
    "Source",
    "StatedUncertainty",
    "ToleranceZone",
    "TriangleMesh",
    "UnknownMethod",
    "Where",
    "as_notes",
    "by_effect",
    "check_fields",
    "check_layout",
    "check_pose_covariance",
    "check_reusable",
    "check_rigid",
    "count_reasons",
    "day",
    "explained",
    "face_named",
    "fingerprint",
    "finite",
    "fits_axes",
    "found_before",
    "layout_words",
    "made_by",
    "multi_rig_parameters",
    "need_camera_frame",
    "numbered",
    "positive",
    "provenance_from",
    "reason_counts",
    "region_of",
    "sealed",
    "today",
    "unmasked",
    "unsealed",
    "whole",
]
