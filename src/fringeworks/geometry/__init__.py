"""From fringes to lengths."""

from fringeworks.geometry.board import Board, parse_board
from fringeworks.geometry.calibrate import Calibration, Observation, calibrate, observe
from fringeworks.geometry.cloud import height_over_plane, normals, triangles
from fringeworks.geometry.corners import BoardView, find_board
from fringeworks.geometry.diagnosis import Finding, coverage, diagnose, pose_figures
from fringeworks.geometry.pinhole import inverse, look_at, pose, project, rays, rotation, transform
from fringeworks.geometry.plane_calibration import (
    PixelCalibration,
    PlaneCalibration,
    calibrate_pixels,
    calibrate_reference_plane,
    height_by_pixel,
)
from fringeworks.geometry.reference_plane import (
    displacement_from_height,
    height_from_displacement,
    to_surface,
)
from fringeworks.geometry.rig import triangulate

__all__ = [
    "Board",
    "BoardView",
    "Calibration",
    "Finding",
    "Observation",
    "PixelCalibration",
    "PlaneCalibration",
    "calibrate",
    "calibrate_pixels",
    "calibrate_reference_plane",
    "coverage",
    "diagnose",
    "displacement_from_height",
    "find_board",
    "height_by_pixel",
    "height_from_displacement",
    "height_over_plane",
    "inverse",
    "look_at",
    "normals",
    "observe",
    "parse_board",
    "pose",
    "pose_figures",
    "project",
    "rays",
    "rotation",
    "to_surface",
    "transform",
    "triangles",
    "triangulate",
]
