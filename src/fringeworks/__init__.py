"""Fringe projection profilometry: from photographs of projected fringes to heights."""

import warnings as _warnings

from fringeworks import _core
from fringeworks.analysis import (
    analyse,
    methods,
    wavelet_frequencies,
    wavelet_ridge,
    windowed_fourier_filter,
    windowed_fourier_ridge,
)
from fringeworks.capture import read_capture, read_pair, write_capture
from fringeworks.evaluate import compare, errors
from fringeworks.formats import write_surface
from fringeworks.geometry import (
    displacement_from_height,
    height_from_displacement,
    to_surface,
)
from fringeworks.pipeline import Reconstruction, reconstruct
from fringeworks.simulate import standard_scene
from fringeworks.types import (
    Capture,
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
    "Capture",
    "HeightMap",
    "InputError",
    "PhaseMap",
    "Reason",
    "Reconstruction",
    "ReferencePlaneGeometry",
    "analyse",
    "compare",
    "displacement_from_height",
    "errors",
    "height_from_displacement",
    "methods",
    "read_capture",
    "read_pair",
    "reconstruct",
    "standard_scene",
    "to_surface",
    "unwrap",
    "wavelet_frequencies",
    "wavelet_ridge",
    "windowed_fourier_filter",
    "windowed_fourier_ridge",
    "write_capture",
    "write_surface",
]
