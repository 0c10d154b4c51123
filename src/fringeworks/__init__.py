"""Fringe projection profilometry: from photographs of projected fringes to heights and points."""

import warnings as _warnings

from fringeworks import _core
from fringeworks.analysis import (
    StreamingDecoder,
    analyse,
    decode,
    estimate_shifts,
    methods,
    wavelet_frequencies,
    wavelet_ridge,
    windowed_fourier_filter,
    windowed_fourier_ridge,
)
from fringeworks.capture import read_capture, read_pair, write_capture
from fringeworks.coordinate_file import read_coordinates, write_coordinates
from fringeworks.evaluate import compare, errors
from fringeworks.form import fit_form
from fringeworks.formats import write_surface
from fringeworks.geometry import (
    Board,
    Calibration,
    calibrate,
    calibrate_reference_plane,
    diagnose,
    displacement_from_height,
    find_board,
    height_from_displacement,
    height_over_plane,
    normals,
    observe,
    parse_board,
    to_surface,
    triangulate,
)
from fringeworks.patterns import GrayCode, Level, PatternPlan, PhaseSteps, encode, equal_steps
from fringeworks.pipeline import (
    Reconstruction,
    calibrate_stacks,
    reconstruct,
    reconstruct_points,
)
from fringeworks.plan_file import read_plan, write_patterns, write_plan
from fringeworks.planner import Proposal, propose
from fringeworks.point_files import read_points, write_points
from fringeworks.rig_file import read_rig, write_rig
from fringeworks.simulate import standard_scene
from fringeworks.stack_file import Stack, read_stack, write_stack
from fringeworks.types import (
    CameraNoise,
    Capture,
    CoordinateMap,
    Decoded,
    HeightMap,
    InputError,
    PhaseMap,
    Pinhole,
    PointCloud,
    Reason,
    ReferencePlaneGeometry,
    Rig,
)
from fringeworks.unwrap import unwrap

if not _core.optimised:
    _warnings.warn(
        "fringeworks runs on a debug build of its kernels; build with `maturin develop --release`",
        RuntimeWarning,
        stacklevel=2,
    )

__all__ = [
    "Board",
    "Calibration",
    "CameraNoise",
    "Capture",
    "CoordinateMap",
    "Decoded",
    "GrayCode",
    "HeightMap",
    "InputError",
    "Level",
    "PatternPlan",
    "PhaseMap",
    "PhaseSteps",
    "Pinhole",
    "PointCloud",
    "Proposal",
    "Reason",
    "Reconstruction",
    "ReferencePlaneGeometry",
    "Rig",
    "Stack",
    "StreamingDecoder",
    "analyse",
    "calibrate",
    "calibrate_reference_plane",
    "calibrate_stacks",
    "compare",
    "decode",
    "diagnose",
    "displacement_from_height",
    "encode",
    "equal_steps",
    "errors",
    "estimate_shifts",
    "find_board",
    "fit_form",
    "height_from_displacement",
    "height_over_plane",
    "methods",
    "normals",
    "observe",
    "parse_board",
    "propose",
    "read_capture",
    "read_coordinates",
    "read_pair",
    "read_plan",
    "read_points",
    "read_rig",
    "read_stack",
    "reconstruct",
    "reconstruct_points",
    "standard_scene",
    "to_surface",
    "triangulate",
    "unwrap",
    "wavelet_frequencies",
    "wavelet_ridge",
    "windowed_fourier_filter",
    "windowed_fourier_ridge",
    "write_capture",
    "write_coordinates",
    "write_patterns",
    "write_plan",
    "write_points",
    "write_rig",
    "write_stack",
    "write_surface",
]
