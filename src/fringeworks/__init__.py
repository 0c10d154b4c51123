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
from fringeworks.formats import write_surface
from fringeworks.geometry import (
    displacement_from_height,
    height_from_displacement,
    to_surface,
)
from fringeworks.patterns import GrayCode, Level, PatternPlan, PhaseSteps, encode, equal_steps
from fringeworks.pipeline import Reconstruction, reconstruct
from fringeworks.plan_file import read_plan, write_patterns, write_plan
from fringeworks.planner import Proposal, propose
from fringeworks.simulate import standard_scene
from fringeworks.stack_file import Stack, read_stack
from fringeworks.types import (
    CameraNoise,
    Capture,
    CoordinateMap,
    Decoded,
    HeightMap,
    InputError,
    PhaseMap,
    Reason,
    ReferencePlaneGeometry,
)
from fringeworks.unwrap import unwrap

if not _core.optimised:
    _warnings.warn(
        "fringeworks runs on a debug build of its kernels; build with `maturin develop --release`",
        RuntimeWarning,
        stacklevel=2,
    )

__all__ = [
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
    "Proposal",
    "Reason",
    "Reconstruction",
    "ReferencePlaneGeometry",
    "Stack",
    "StreamingDecoder",
    "analyse",
    "compare",
    "decode",
    "displacement_from_height",
    "encode",
    "equal_steps",
    "errors",
    "estimate_shifts",
    "height_from_displacement",
    "methods",
    "propose",
    "read_capture",
    "read_coordinates",
    "read_pair",
    "read_plan",
    "read_stack",
    "reconstruct",
    "standard_scene",
    "to_surface",
    "unwrap",
    "wavelet_frequencies",
    "wavelet_ridge",
    "windowed_fourier_filter",
    "windowed_fourier_ridge",
    "write_capture",
    "write_coordinates",
    "write_patterns",
    "write_plan",
    "write_surface",
]
